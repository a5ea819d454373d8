"""Pointing: keep the laser's axis on a UAV, by gimbal and mirror."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ..simulation import Simulation
from .episode import Episodes
from .geometry import Vector, between_rad, clipped, direction_enu, to_turn_rad

#: Fastest turn of either axis that an action commands [rad/s]: several times what the drawn flights need.
MOST_RATE_RADPS = math.radians(15.0)
#: Throw of the mirror either way, as an angle of the line of sight [rad].
MIRROR_RAD = 5e-3
#: Angles still to turn are told twice, over these [rad]: the whole field's order, and the beam's.
COARSE_RAD, FINE_RAD = 10e-3, 200e-6
#: A line of sight turns by no more than this [rad/s].
MOST_SIGHT_RADPS = 0.3
#: Errors count by the logarithm of one plus their ratio to this [rad], some beam divergence.
GOOD_RAD = 10e-6
#: Half of the coarse camera's field [rad]: beyond it the UAV is lost.
LOST_RAD = math.radians(1.5)
#: The station has so long to find the UAV before the agent takes over [s].
FOUND_WITHIN_S = 3.0
#: States in which a camera holds the target: the coarse one, or the precise one.
COARSE, PRECISE = ("coarse",), ("precise", "engage")
#: The camera behind the mirror, by name.
PRECISE_CAMERA = "ptv"
#: Numbers of an observation.
NUMBERS = 18

#: Drawn: distance on the map when the UAV is nearest, height, speed.
NEAREST_M, HEIGHT_M, SPEED_MPS = (250.0, 800.0), (90.0, 200.0), (4.0, 18.0)
#: Drawn: sideways acceleration of those that weave, and its period.
WEAVE_MPS2, WEAVE_S = (0.5, 3.0), (3.0, 8.0)
MODELS = ("phantom4", "mavic2", "mavic_air", "matrice200", "matrice600", "fpv5")


def flight(rng: np.random.Generator, nearest_s: float) -> dict[str, Any]:
    """A flight past the station: straight on, or weaving; nearest after so long [s]."""
    towards, crossing = rng.uniform(0.0, math.tau), rng.choice([-1.0, 1.0])
    course = towards + crossing * (0.5 * math.pi + rng.uniform(-0.6, 0.6))
    nearest_m, height_m, speed_mps = (rng.uniform(*of) for of in (NEAREST_M, HEIGHT_M, SPEED_MPS))
    velocity = speed_mps * direction_enu(np.array([course, 0.0]))
    start = nearest_m * direction_enu(np.array([towards, 0.0])) - nearest_s * velocity
    start[2] = height_m
    path = {"start_enu_m": start.round(3).tolist(), "velocity_enu_mps": velocity.round(4).tolist()}
    weave = {
        "lateral_acceleration_mps2": round(rng.uniform(*WEAVE_MPS2), 3),
        "period_s": round(rng.uniform(*WEAVE_S), 3),
    }
    if rng.random() < 0.5:
        return {"kind": "straight", **path}
    return {"kind": "weave", **path, **weave}


class PointErrors(Episodes):
    """Pointing from errors: `boresight/PointErrors-v0`.

    Args:
        episode_s: length of an episode [s].
        decision_hz: actions a second; must divide the 480 ticks.
        hands_off: actions are ignored, and the station's own law points.

    An action is four numbers from -1 to 1: rates of azimuth and elevation relative to the base, over 15 degrees a second;
    deflection of the line of sight by the mirror, right and up, over 5 mrad.

    The reward of a decision is 1 for a laser axis on the aim point, and falls with the logarithm of the angle between them
    to 0 at 1.5 degrees: 0.9 at 11 µrad, a half at 0.5 mrad. The truth makes it. The episode ends where the UAV is
    lost: 1.5 degrees off, or no longer the station's target.
    """

    scenario = "point.toml"

    def __init__(self, episode_s: float = 8.0, decision_hz: float = 120.0, hands_off: bool = False) -> None:
        super().__init__(self.scenario, episode_s, decision_hz)
        self.hands_off = hands_off
        self.action_space = spaces.Box(-1.0, 1.0, (4,), np.float32)
        self.observation_space = spaces.Box(-1.0, 1.0, (NUMBERS,), np.float32)
        self._error_rad = math.pi

    def drawn(self, rng: np.random.Generator) -> dict[str, Any]:
        nearest_s = rng.uniform(0.0, self.episode_s)
        return {
            "uavs.0.model": str(rng.choice(MODELS)),
            "uavs.0.trajectory": flight(rng, nearest_s),
            "weather.wind_speed_mps": round(rng.uniform(0.0, 6.0), 2),
            "weather.wind_from_deg": round(rng.uniform(0.0, 360.0), 1),
            "duration_s": FOUND_WITHIN_S + self.episode_s + 1.0,
        }

    def begin(self) -> None:
        """The station finds the UAV by itself; the agent takes over once the precise camera holds it."""
        run = self.run
        self._station = run.stations[0]
        while self._station.state not in PRECISE and run.t_s < FOUND_WITHIN_S:
            run.step(self._ticks)
        self._look()

    def act(self, action: Any) -> None:
        wanted = checked_action(action, self.action_space)
        if not self.hands_off:
            self.run.drive(rates_radps=MOST_RATE_RADPS * wanted[:2], mirror_rad=MIRROR_RAD * wanted[2:])

    def outcome(self) -> tuple[float, bool]:
        self._look()
        lost = self._track is None or self._error_rad > LOST_RAD
        return (0.0 if lost else reward_of(self._error_rad)), lost

    def observation(self) -> NDArray[Any]:
        mount, track = self._mount, self._track
        to_turn = rates = np.zeros(2)
        if track is not None:
            to_turn = to_turn_rad(mount.believed_axis_enu, track.az_el_rad)
            rates = track.rates_radps
        return clipped(
            [
                *(to_turn / COARSE_RAD),
                *(to_turn / FINE_RAD),
                *(rates / MOST_SIGHT_RADPS),
                *(mount.measured_rates_radps / MOST_SIGHT_RADPS),
                *(mount.mirror_rad / MIRROR_RAD),
                *(mount.commanded_rates_radps / MOST_RATE_RADPS),
                *(mount.commanded_mirror_rad / MIRROR_RAD),
                float(mount.measured_az_el_rad[1]) / (0.5 * math.pi),
                float(self._state in COARSE),
                float(self._state in PRECISE),
                1.0 - self._steps / self._most_steps,
            ]
        )

    def info(self) -> dict[str, Any]:
        """`error_rad`: the true angle between the laser's axis and the aim point [rad]."""
        return {"error_rad": self._error_rad}

    def _look(self) -> None:
        station = self._station
        self._mount, self._track, self._state = station.mount, station.target, station.state
        self._error_rad = error_rad(self.run, self._mount)


class PointPixels(PointErrors):
    """Pointing from pixels: `boresight/PointPixels-v0`.

    As `PointErrors`, but an observation is the middle of the precise camera's newest frame, in whose middle the laser's
    axis lies: uint8 of shape [size_px, size_px, 3], 27 µrad a pixel. It renders, and needs what rendering needs.

    Args:
        size_px: side of the crop [px], up to 256.
        episode_s: length of an episode [s].
        decision_hz: actions a second; at most the camera's 60, so that each sees a new frame.
        hands_off: actions are ignored, and the station's own law points.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 60}
    pictures = True
    scenario = "pixels.toml"

    def __init__(
        self,
        size_px: int = 128,
        episode_s: float = 8.0,
        decision_hz: float = 60.0,
        hands_off: bool = False,
        render_mode: str | None = None,
    ) -> None:
        if not 1 <= size_px <= 256:
            raise ValueError(f"size_px: {size_px} must be from 1 to the sensor's 256")
        if decision_hz > 60.0:
            raise ValueError(f"decision_hz: {decision_hz} must be at most the camera's 60")
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode: there is no '{render_mode}'; give 'rgb_array' or None")
        super().__init__(episode_s, decision_hz, hands_off)
        self.render_mode = render_mode
        self.observation_space = spaces.Box(0, 255, (size_px, size_px, 3), np.uint8)
        self._frame: NDArray[np.uint8] | None = None

    def observation(self) -> NDArray[Any]:
        side = self.observation_space.shape[0]
        for frame in self.run.frames:
            if frame.camera == PRECISE_CAMERA:
                self._frame = frame.pixels
        if self._frame is None:
            raise RuntimeError("the precise camera gave no picture; render it, or take boresight/PointErrors-v0")
        height, width = self._frame.shape[:2]
        top, left = (height - side) // 2, (width - side) // 2
        return self._frame[top : top + side, left : left + side].copy()

    def render(self) -> NDArray[np.uint8] | None:
        """The precise camera's whole newest frame, uint8 of shape [256, 256, 3]."""
        if self.render_mode is None:
            return None
        return None if self._frame is None else self._frame.copy()

    def begin(self) -> None:
        self._frame = None
        super().begin()


def checked_action(action: Any, space: spaces.Box) -> Vector:
    """An action as numbers within its space."""
    wanted = np.asarray(action, dtype=np.float64)
    if wanted.shape != space.shape or not np.isfinite(wanted).all():
        raise ValueError(f"action: {action!r} must be {space.shape[0]} finite numbers from -1 to 1")
    return np.clip(wanted, -1.0, 1.0)


def error_rad(run: Simulation, mount: Any) -> float:
    """The true angle between the laser's axis and the first UAV's aim point [rad]."""
    pose = mount.laser_pose
    towards = run.uavs[0].aim_enu_m - pose[:3, 3]
    return between_rad(pose[:3, 2], towards / np.linalg.norm(towards))


def reward_of(error: float) -> float:
    """The reward for an error [rad]: 1 at none, 0 from `LOST_RAD` on, by the logarithm between.

    >>> [round(reward_of(error), 2) for error in (0.0, 11e-6, 0.5e-3, LOST_RAD)]
    [1.0, 0.91, 0.5, 0.0]
    """
    return max(0.0, 1.0 - math.log1p(error / GOOD_RAD) / math.log1p(LOST_RAD / GOOD_RAD))
