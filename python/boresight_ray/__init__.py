"""Boresight's sweeps on a Ray cluster: shards as tasks, one table."""

from .sweep import Bundle, SweepError, sweep

__all__ = ["Bundle", "SweepError", "sweep"]
