"""A swarm against stations: what each station knows, and how it is told which UAV to engage."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..simulation import Simulation
from .geometry import Vector, az_el_rad, between_rad, clipped, direction_enu, wrapped_rad
from .point import MODELS

#: Numbers of an object, and of the station.
OF_OBJECT, OF_STATION = 15, 6
#: Scales of the numbers: range [m], range rate and climb [m/s], elevation [rad], times [s].
RANGE_M, RATE_MPS, CLIMB_MPS, ELEVATION_RAD = 1000.0, 30.0, 10.0, 0.5
ASSET_S, BURST_S, BARRED_S = 60.0, 10.0, 10.0
#: Scale of an object's size [m].
SIZE_M = 2.0
#: Rate at which a station turns to what it is told [rad/s], as its mount does at most.
SLEW_RADPS = math.radians(60.0)
#: The gap to the nearest other object counts by its logarithm, between these [rad].
GAPS_RAD = (1e-4, 0.1)
#: A camera's track this close to the radar's direction is of the same object [rad].
SAME_RAD = 10e-3
#: Share of a new measurement in the velocity of an object, which is its displacement over a decision.
NEW_SHARE = 0.4
#: Stations see that an object falls after this time, as their trackers do [s].
FALL_SEEN_S = 1.0
#: An object comes no slower than this at the asset, for the time that it needs [m/s].
LEAST_MPS = 2.0

#: Drawn: distance on the map from which a part of the swarm comes, its height over the asset, its speed, gap of neighbours.
FROM_M, ABOVE_M, SPEED_MPS, SPACING_M = (500.0, 800.0), (30.0, 90.0), (12.0, 18.0), (12.0, 30.0)
#: Drawn: the sides from which it comes, and its waves.
MOST_SIDES, MOST_WAVES, WAVE_S = 3, 2, 8.0
FORMATIONS = ("line", "wedge", "grid", "ring", "cloud", "stream")
#: Where the stations stand: the first beside the asset, others around it, east, north, up [m].
PLACES_ENU_M = ((0.0, 0.0, 48.0), (220.0, -120.0, 48.0), (-220.0, -120.0, 48.0), (0.0, 250.0, 48.0))
NAMES = ("centre", "east", "west", "north")
ASSET_ENU_M = np.array([0.0, 0.0, 30.0])


def swarm(rng: np.random.Generator, uavs: int) -> dict[str, Any]:
    """A drawn swarm of so many UAVs: sides, models, formation, speed, waves."""
    sides = int(rng.integers(1, MOST_SIDES + 1))
    turned = rng.uniform(0.0, 360.0)
    waves = int(rng.integers(1, MOST_WAVES + 1))
    origins = [
        {
            "azimuth_deg": round((turned + 360.0 * side / sides + rng.uniform(-30.0, 30.0)) % 360.0, 2),
            "distance_m": round(rng.uniform(*FROM_M), 1),
            "above_m": round(rng.uniform(*ABOVE_M), 1),
        }
        for side in range(sides)
    ]
    return {
        "name": "swarm",
        "count": uavs,
        "models": [str(model) for model in rng.permutation(MODELS)[:3]],
        "formation": str(rng.choice(FORMATIONS)),
        "from": origins,
        "keep_formation": False,
        "speed_mps": round(rng.uniform(*SPEED_MPS), 2),
        "spacing_m": round(rng.uniform(*SPACING_M), 1),
        "waves": waves,
        "wave_s": WAVE_S,
    }


def stations(count: int) -> list[dict[str, Any]]:
    """The first so many places, as stations of a scenario."""
    return [{"name": NAMES[at], "position_enu_m": list(PLACES_ENU_M[at])} for at in range(count)]


@dataclass
class Moving:
    """How an object moves, by where the radar had it at decisions."""

    at_s: float
    r_enu_m: Vector
    v_enu_mps: Vector = field(default_factory=lambda: np.zeros(3))
    measured: bool = False

    def take(self, t_s: float, r_enu_m: Vector) -> None:
        """Takes where it is now."""
        if t_s <= self.at_s:
            return
        v_enu_mps = (r_enu_m - self.r_enu_m) / (t_s - self.at_s)
        share = NEW_SHARE if self.measured else 1.0
        self.v_enu_mps = self.v_enu_mps + share * (v_enu_mps - self.v_enu_mps)
        self.at_s, self.r_enu_m, self.measured = t_s, r_enu_m, True


class Defender:
    """One station: what it knows of the swarm, and which object it was told to engage.

    An object's slot is its number at the radar. Nothing here reads the truth, but that what has come to the asset, and what
    has been falling for a second, is no object any more.
    """

    def __init__(self, run: Simulation, station: Any, slots: int) -> None:
        self.run, self.station, self.slots = run, station, slots
        self.names = [uav.name for uav in run.uavs]
        self.ordered: int | None = None
        self._in_hand = False
        self._moving: dict[int, Moving] = {}
        self._fired_s = np.zeros(slots)
        self._barred_s = np.zeros(slots)
        self.look(set(), 0.0)

    def look(self, gone: set[int], passed_s: float) -> None:
        """Takes the present in, `passed_s` after the last time; `gone`: what is no object any more."""
        run, station = self.run, self.station
        self.mount, self.beam, self.state = station.mount, station.beam, station.state
        self.interlocks, self.target = station.interlocks, station.target
        self.tracks = [(direction_enu(track.az_el_rad), track) for track in station.tracks]
        #: Directions of the objects, by their slots.
        self.objects: dict[int, Vector] = {}
        for slot, azimuth, elevation, range_m in station.radar:
            if slot < self.slots and slot not in gone:
                towards = direction_enu(np.array([azimuth, elevation]))
                r_enu_m = self.mount.r_enu_m + range_m * towards
                self._moving.setdefault(slot, Moving(run.t_s, r_enu_m)).take(run.t_s, r_enu_m)
                self.objects[slot] = towards
        if self.ordered not in self.objects:
            self.ordered = None
        self.followed = self._followed()
        if self.followed is not None:
            if self.beam.firing:
                self._fired_s[self.followed] += passed_s
                self._barred_s[self.followed] = 0.0
            elif self.state == "engage":
                self._barred_s[self.followed] += passed_s

    def order(self, action: int) -> None:
        """Obeys an action: 0 leaves the choice to the station, slot + 1 engages that object; an empty slot changes nothing."""
        if not 0 <= action <= self.slots:
            raise ValueError(f"action: {action} must be a whole number from 0 to {self.slots}")
        if action == 0:
            if self._in_hand:
                self.run.give(station=self.station.name)
            self._in_hand, self.ordered = False, None
            return
        slot = action - 1
        if slot not in self.objects:
            return
        new = slot != self.ordered
        # Where no camera has it, the station turns there, and on with it; once it is found it becomes the target.
        if self.target is None or new and self._track(slot) is None:
            azimuth, elevation = np.degrees(az_el_rad(self._met_enu(slot)))
            self.run.give(slew_deg=[float(azimuth) % 360.0, float(elevation)], station=self.station.name)
        if new:
            self.run.give(designate=self.names[slot], station=self.station.name)
            self._in_hand, self.ordered, self._barred_s[slot] = True, slot, 0.0

    def seen(self) -> dict[str, NDArray[np.float32]]:
        """What the station knows, over its scales: a row for each object, zeros where there is none; and itself."""
        rows = np.zeros((self.slots, OF_OBJECT), np.float32)
        axis, here = self.mount.believed_axis_enu, self.mount.r_enu_m
        looks = az_el_rad(axis)
        for slot, towards in self.objects.items():
            moving, track, at = self._moving[slot], self._track(slot), az_el_rad(towards)
            range_m = float(np.linalg.norm(moving.r_enu_m - here))
            to_asset = ASSET_ENU_M - moving.r_enu_m
            far_m = float(np.linalg.norm(to_asset))
            comes_mps = max(LEAST_MPS, float(moving.v_enu_mps @ to_asset) / max(far_m, 1.0))
            # A camera sees a fall long before the radar.
            climb_mps = float(moving.v_enu_mps[2]) if track is None else range_m * float(track.rates_radps[1])
            rows[slot] = [
                1.0,
                range_m / RANGE_M,
                float(moving.v_enu_mps @ towards) / RATE_MPS,
                between_rad(axis, towards) / math.pi,
                wrapped_rad(float(at[0] - looks[0])) / math.pi,
                float(at[1]) / ELEVATION_RAD,
                far_m / comes_mps / ASSET_S,
                0.0 if track is None else track.uav_probability,
                0.0 if track is None else range_m * track.size_rad / SIZE_M,
                climb_mps / CLIMB_MPS,
                self._gap(slot, track),
                float(slot == self.followed),
                float(slot == self.ordered),
                self._fired_s[slot] / BURST_S,
                self._barred_s[slot] / BARRED_S,
            ]
        itself = [
            float(self.state == "search"),
            float(self.state in ("precise", "engage")),
            float(self.beam.firing),
            float("another object in the beam" in self.interlocks),
            float("solid backstop" in self.interlocks),
            len(self.objects) / self.slots,
        ]
        return {"objects": np.clip(rows, -1.0, 1.0), "station": clipped(itself)}

    def _followed(self) -> int | None:
        """The slot of the object that the station follows: the one it was told, if that may be it, or else the nearest."""
        if self.target is None:
            return None
        at = direction_enu(self.target.az_el_rad)
        off_rad = {slot: between_rad(at, towards) for slot, towards in self.objects.items()}
        if self.ordered is not None and off_rad[self.ordered] < SAME_RAD:
            return self.ordered
        nearest = min(off_rad, key=lambda slot: (off_rad[slot], slot), default=None)
        return nearest if nearest is not None and off_rad[nearest] < SAME_RAD else None

    def _track(self, slot: int) -> Any | None:
        """The camera's track of an object, if one has it."""
        if slot == self.followed:
            return self.target
        near = [(between_rad(self.objects[slot], towards), track.id, track) for towards, track in self.tracks]
        nearest = min(near, default=(math.inf, 0, None))
        return nearest[2] if nearest[0] < SAME_RAD else None

    def _met_enu(self, slot: int) -> Vector:
        """Where an object will be, seen from the station, when that has turned to it."""
        moving = self._moving[slot]
        off_rad = between_rad(self.mount.believed_axis_enu, self.objects[slot])
        return moving.r_enu_m + (off_rad / SLEW_RADPS) * moving.v_enu_mps - self.mount.r_enu_m

    def _gap(self, slot: int, track: Any | None) -> float:
        """The gap to the nearest other object on the sky, 0 to 1: as the cameras see it, or else the radar."""
        if track is None:
            at, others = self.objects[slot], [other for of, other in self.objects.items() if of != slot]
        else:
            at, others = direction_enu(track.az_el_rad), [other for other, of in self.tracks if of.id != track.id]
        least, most = GAPS_RAD
        gap = min((between_rad(at, other) for other in others), default=most)
        return math.log(min(max(gap, least), most) / least) / math.log(most / least)


class Swarm:
    """The swarm's fate, in truth."""

    def __init__(self, run: Simulation) -> None:
        self.run = run
        self.neutralised: set[int] = set()
        self.come: set[int] = set()
        self.gone: set[int] = set()
        self.over = False

    def look(self) -> int:
        """How many UAVs were neutralised since the last look, none of which had come to the asset."""
        uavs = self.run.uavs
        before, t_s = len(self.neutralised), self.run.t_s
        flying = 0
        for uav in uavs:
            if uav.at_asset_s is not None:
                self.come.add(uav.index)
                self.gone.add(uav.index)
            elif uav.neutralised_s is not None:
                self.neutralised.add(uav.index)
                if t_s >= uav.neutralised_s + FALL_SEEN_S:
                    self.gone.add(uav.index)
            elif uav.status != "flying":
                self.gone.add(uav.index)
            else:
                flying += 1
        self.over = flying == 0
        return len(self.neutralised) - before
