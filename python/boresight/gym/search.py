"""Search: where to look for a UAV of which no radar tells."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from .episode import Episodes
from .geometry import az_el_rad, clipped, direction_enu, wrapped_rad
from .point import MODELS, checked_action

#: The sector that is searched: azimuths and elevations, to either side of its middle [rad].
MIDDLE_RAD = np.radians([0.0, 6.75])
HALF_RAD = np.radians([45.0, 6.75])
#: Cells of the maps in elevation and azimuth: each about as large as the search camera's field, 6 by 4.5 degrees.
ROWS, COLUMNS = 3, 15
#: Half of that field [rad].
FIELD_RAD = np.radians([3.0, 2.25])
#: The map of looks forgets over this time [s].
FORGOTTEN_S = 30.0
#: A station that turns faster than this sees nothing worth counting as a look [rad/s].
STEADY_RADPS = math.radians(3.0)
#: Height of the station over the plain [m].
STATION_UP_M = 48.0
#: Drawn: distance on the map and elevation at both ends of the flight, which lie in the sector; the speed that follows
#: must lie between these.
FAR_M, ELEVATION_RAD, SPEED_MPS = (500.0, 1300.0), np.radians([1.0, 12.5]), (3.0, 15.0)


class Search(Episodes):
    """Uncued search: `boresight/Search-v0`.

    Args:
        episode_s: longest search [s].
        decision_hz: actions a second.
        hands_off: actions are ignored, and the station searches as it does by itself: a raster over the sector.

    An action is a direction in the sector, two numbers from -1 to 1: azimuth over 45 degrees, elevation over 6.75 degrees
    about 6.75 degrees. The station turns there and searches about it.

    An observation is a dictionary: `look`, where it looks, as an action has it, and its rates over 60 degrees a second;
    `looked`, for each cell of the sector how long ago it was looked at, over 30 s, 1 for longer or never; `seen`, for each
    cell the greatest probability that a track there is a UAV. Rows rise with elevation, columns with azimuth.

    The reward is minus the time of a decision [s], so that the return is minus the time until the UAV was acquired: a coarse
    or precise camera of the station held it. That ends the episode.
    """

    def __init__(self, episode_s: float = 60.0, decision_hz: float = 4.0, hands_off: bool = False) -> None:
        super().__init__("search.toml", episode_s, decision_hz)
        self.hands_off = hands_off
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = spaces.Dict(
            {
                "look": spaces.Box(-1.0, 1.0, (4,), np.float32),
                "looked": spaces.Box(0.0, 1.0, (ROWS, COLUMNS), np.float32),
                "seen": spaces.Box(0.0, 1.0, (ROWS, COLUMNS), np.float32),
            }
        )

    def drawn(self, rng: np.random.Generator) -> dict[str, Any]:
        while True:
            start, end = place(rng), place(rng)
            velocity = (end - start) / self.episode_s
            if SPEED_MPS[0] <= np.linalg.norm(velocity) <= SPEED_MPS[1]:
                break
        return {
            "uavs.0.model": str(rng.choice(MODELS)),
            "uavs.0.trajectory": {
                "kind": "straight",
                "start_enu_m": start.round(3).tolist(),
                "velocity_enu_mps": velocity.round(4).tolist(),
            },
            "weather.wind_speed_mps": round(rng.uniform(0.0, 6.0), 2),
            "duration_s": self.episode_s + 1.0,
        }

    def begin(self) -> None:
        self._station = self.run.stations[0]
        self._looked_s = np.full((ROWS, COLUMNS), -math.inf)
        self._note()

    def act(self, action: Any) -> None:
        wanted = checked_action(action, self.action_space)
        if not self.hands_off:
            azimuth, elevation = np.degrees(MIDDLE_RAD + HALF_RAD * wanted)
            self.run.give(slew_deg=[float(azimuth) % 360.0, float(elevation)])

    def outcome(self) -> tuple[float, bool]:
        self._note()
        return -self._ticks / self.run.tick_hz, self.run.uavs[0].acquired_s is not None

    def observation(self) -> dict[str, NDArray[np.float32]]:
        run, mount = self.run, self._station.mount
        age_s = np.minimum(run.t_s - self._looked_s, FORGOTTEN_S)
        seen = np.zeros((ROWS, COLUMNS), np.float32)
        for track in self._station.tracks:
            cell = cell_of(track.az_el_rad)
            if cell is not None:
                seen[cell] = max(seen[cell], track.uav_probability)
        at = az_el_rad(mount.believed_axis_enu)
        off = [wrapped_rad(float(at[0] - MIDDLE_RAD[0])), float(at[1] - MIDDLE_RAD[1])]
        look = [*(np.array(off) / HALF_RAD), *(mount.measured_rates_radps / math.radians(60.0))]
        return {"look": clipped(look), "looked": (age_s / FORGOTTEN_S).astype(np.float32), "seen": seen}

    def info(self) -> dict[str, Any]:
        """`acquired`: whether the station holds the UAV."""
        return {"acquired": self.run.uavs[0].acquired_s is not None}

    def _note(self) -> None:
        """Notes where the station looks, if it stands still enough to see."""
        mount = self._station.mount
        if np.abs(mount.measured_rates_radps).max() > STEADY_RADPS:
            return
        at = az_el_rad(mount.believed_axis_enu)
        for row in range(ROWS):
            for column in range(COLUMNS):
                middle = middle_rad(row, column)
                across = math.cos(middle[1]) * wrapped_rad(float(middle[0] - at[0]))
                if abs(across) <= FIELD_RAD[0] and abs(middle[1] - at[1]) <= FIELD_RAD[1]:
                    self._looked_s[row, column] = self.run.t_s


def place(rng: np.random.Generator) -> NDArray[np.float64]:
    """A drawn place in the sector, east, north, up [m]."""
    azimuth = MIDDLE_RAD[0] + HALF_RAD[0] * rng.uniform(-0.95, 0.95)
    far_m = rng.uniform(*FAR_M)
    drawn = far_m * direction_enu(np.array([azimuth, 0.0]))
    drawn[2] = STATION_UP_M + far_m * math.tan(rng.uniform(*ELEVATION_RAD))
    return drawn


def middle_rad(row: int, column: int) -> NDArray[np.float64]:
    """Azimuth and elevation of a cell's middle [rad]."""
    shares = np.array([(2 * column + 1) / COLUMNS - 1.0, (2 * row + 1) / ROWS - 1.0])
    return MIDDLE_RAD + HALF_RAD * shares


def cell_of(at_rad: NDArray[np.float64]) -> tuple[int, int] | None:
    """Row and column of the cell in which a direction lies [rad]; None outside the sector.

    >>> cell_of(np.radians([0.5, 0.5])), cell_of(np.radians([46.0, 9.0]))
    ((0, 7), None)
    """
    off = np.array([wrapped_rad(float(at_rad[0] - MIDDLE_RAD[0])), float(at_rad[1] - MIDDLE_RAD[1])]) / HALF_RAD
    if (np.abs(off) >= 1.0).any():
        return None
    column, row = (0.5 * (off + 1.0) * [COLUMNS, ROWS]).astype(int)
    return int(row), int(column)
