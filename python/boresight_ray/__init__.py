"""Boresight's sweeps on a Ray cluster: shards as tasks, one table."""

from .sweep import RUNTIME_ENV, Bundle, Swept, SweepError, sweep

__all__ = ["RUNTIME_ENV", "Bundle", "Swept", "SweepError", "sweep"]
