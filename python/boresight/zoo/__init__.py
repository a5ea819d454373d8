"""Environments of several agents, by PettingZoo's interface.

    from boresight.zoo import stations_v0

    env = stations_v0.parallel_env(stations=3, uavs=12)
"""

from __future__ import annotations

try:
    import pettingzoo  # noqa: F401
except ModuleNotFoundError as error:
    raise ModuleNotFoundError("boresight.zoo needs PettingZoo: pip install 'boresight[gym]'", name="pettingzoo") from error

from . import stations_v0

__all__ = ["stations_v0"]
