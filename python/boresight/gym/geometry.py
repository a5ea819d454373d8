"""Directions and angles."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


def direction_enu(az_el_rad: Vector) -> Vector:
    """The unit vector, east, north, up, of an azimuth, clockwise from north, and an elevation [rad].

    >>> direction_enu(np.array([0.0, 0.0])).tolist()
    [0.0, 1.0, 0.0]
    """
    azimuth, elevation = float(az_el_rad[0]), float(az_el_rad[1])
    level = math.cos(elevation)
    return np.array([math.sin(azimuth) * level, math.cos(azimuth) * level, math.sin(elevation)])


def az_el_rad(towards_enu: Vector) -> Vector:
    """Azimuth, clockwise from north, and elevation [rad] of a direction, which may have any length.

    >>> az_el_rad(np.array([1.0, 0.0, 0.0])).round(3).tolist()
    [1.571, 0.0]
    """
    east, north, up = (float(of) for of in towards_enu)
    return np.array([math.atan2(east, north), math.atan2(up, math.hypot(east, north))])


def wrapped_rad(angle_rad: float) -> float:
    """An angle within half a turn to either side [rad].

    >>> round(wrapped_rad(1.5 * math.pi), 3)
    -1.571
    """
    return math.remainder(angle_rad, math.tau)


def between_rad(one: Vector, other: Vector) -> float:
    """The angle between two directions [rad]; small ones are exact to rounding."""
    return 2.0 * math.atan2(float(np.linalg.norm(one - other)), float(np.linalg.norm(one + other)))


def to_turn_rad(from_enu: Vector, to_az_el_rad: Vector) -> Vector:
    """The angles right and up [rad] by which a line of sight must turn to another, near it.

    >>> to_turn_rad(np.array([0.0, 1.0, 0.0]), np.array([0.001, 0.002])).round(6).tolist()
    [0.001, 0.002]
    """
    at = az_el_rad(from_enu)
    across = math.cos(0.5 * (float(at[1]) + float(to_az_el_rad[1])))
    return np.array([across * wrapped_rad(float(to_az_el_rad[0] - at[0])), float(to_az_el_rad[1] - at[1])])


def clipped(values: list[float] | Vector) -> NDArray[np.float32]:
    """Numbers as an observation has them: single precision, held between -1 and 1."""
    return np.clip(np.asarray(values, dtype=np.float64), -1.0, 1.0).astype(np.float32)
