"""Target assignment: which UAV of a swarm each station engages."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from .defence import NAMES, OF_OBJECT, OF_STATION, Defender, Swarm, stations, swarm
from .episode import Episodes


class Assign(Episodes):
    """Target assignment: `boresight/Assign-v0`.

    Args:
        uavs: how many UAVs come, 1 to 64.
        stations: how many stations defend, 1 to 4.
        episode_s: longest episode [s].
        decision_hz: actions a second.

    An action is a number: 0 leaves the choice to the station (the shipped rule), `i + 1` engages object i. What is no
    object now changes nothing. With several stations it is one such number for each.

    An observation is a dictionary. `objects`: a row of 15 numbers for each object, zeros for what the radar does not have;
    `station`: 6 numbers. With several stations both have one axis more, ahead. Each number lies between -1 and 1, and
    `defence.py` has the scales.

    The reward is the number of UAVs that were neutralised before they came within 80 m of the asset. The episode ends when
    none is left that could come.
    """

    def __init__(self, uavs: int = 12, stations: int = 1, episode_s: float = 75.0, decision_hz: float = 2.0) -> None:
        super().__init__("assign.toml", episode_s, decision_hz)
        check_sizes(uavs, stations)
        self.uavs, self.stations = uavs, stations
        lead = () if stations == 1 else (stations,)
        self.action_space = spaces.Discrete(uavs + 1) if stations == 1 else spaces.MultiDiscrete([uavs + 1] * stations)
        self.observation_space = spaces.Dict(
            {
                "objects": spaces.Box(-1.0, 1.0, (*lead, uavs, OF_OBJECT), np.float32),
                "station": spaces.Box(-1.0, 1.0, (*lead, OF_STATION), np.float32),
            }
        )

    def drawn(self, rng: np.random.Generator) -> dict[str, Any]:
        return {
            "swarms": [swarm(rng, self.uavs)],
            "stations": stations(self.stations),
            "weather.wind_speed_mps": round(rng.uniform(0.0, 6.0), 2),
            "duration_s": self.episode_s + 1.0,
        }

    def begin(self) -> None:
        run = self.run
        self._swarm = Swarm(run)
        self._defenders = [Defender(run, station, self.uavs) for station in run.stations]

    def act(self, action: Any) -> None:
        wanted = np.asarray(action)
        count = len(self._defenders)
        if wanted.size != count or not np.issubdtype(wanted.dtype, np.integer):
            raise ValueError(f"action: {action!r} must be {count} whole number{'s' if count > 1 else ''}")
        for defender, one in zip(self._defenders, wanted.reshape(count), strict=True):
            defender.order(int(one))

    def outcome(self) -> tuple[float, bool]:
        neutralised = self._swarm.look()
        for defender in self._defenders:
            defender.look(self._swarm.gone, self._ticks / self.run.tick_hz)
        return float(neutralised), self._swarm.over

    def observation(self) -> Any:
        seen = [defender.seen() for defender in self._defenders]
        if len(seen) == 1:
            return seen[0]
        return {key: np.stack([one[key] for one in seen]) for key in seen[0]}

    def info(self) -> dict[str, Any]:
        """`neutralised` and `at_asset`: how many UAVs so far."""
        return {"neutralised": len(self._swarm.neutralised), "at_asset": len(self._swarm.come)}


def check_sizes(uavs: int, stations: int) -> None:
    """Refuses sizes that the scenario has no place for."""
    if not 1 <= uavs <= 64:
        raise ValueError(f"uavs: {uavs} must be from 1 to 64")
    if not 1 <= stations <= len(NAMES):
        raise ValueError(f"stations: {stations} must be from 1 to {len(NAMES)}")
