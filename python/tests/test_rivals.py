"""The paper's rule as benches/peers/rivals.py has it; needs NumPy alone."""

import importlib.util
import math
import sys
from pathlib import Path

import numpy as np
import pytest

FILE = Path(__file__).parents[2] / "benches" / "peers" / "rivals_paper.py"
SPEC = importlib.util.spec_from_file_location("rivals_paper", FILE)
paper = importlib.util.module_from_spec(SPEC)
sys.modules[SPEC.name] = paper
SPEC.loader.exec_module(paper)

FRAME_S = 1 / 120
COARSE, PRECISE = (paper.Field(math.tan(math.radians(half)), 0.75 * math.tan(math.radians(half))) for half in (1.5, 0.5))
AHEAD = np.array([0.0, 1.0, 0.0])


def ray(right_rad, down_rad=0.0):
    """A direction beside north, on the horizon's level."""
    return np.array([math.tan(right_rad), 1.0, -math.tan(down_rad)]) / math.hypot(1, math.tan(right_rad), math.tan(down_rad))


def test_eqs_9_and_10_by_hand():
    pid, total, before = paper.Pid(paper.COARSE), np.zeros(2), None
    for error in np.array([[0.02, -0.01], [0.03, -0.02], [0.01, 0.05]]):
        total = total + error * FRAME_S
        slope = 0 if before is None else (error - before) / FRAME_S
        before = error
        assert pid.step(error, FRAME_S) == pytest.approx(0.015 * error + 0.002 * total + 0.001 * slope, abs=1e-17)
    # Only the first term saturates.
    u_rad = paper.Pid(paper.PRECISE, 0.1).step([1.0, -0.01], FRAME_S)
    assert u_rad == pytest.approx([0.005 * 0.1 + 0.0005 * FRAME_S, -0.01 * (0.005 + 0.0005 * FRAME_S)], abs=1e-17)


@pytest.mark.parametrize("toward", [(0.3, 0.9, 0.1), (-0.7, -0.2, 0.4), (0.0, -1.0, 0.0), (1.0, 0.0, 0.8)])
def test_a_level_camera_looks_along_its_axis(toward):
    axis = np.array(toward) / np.linalg.norm(toward)
    q = paper.looking(axis)
    assert paper.turned(q, (0, 0, 1)) == pytest.approx(axis, abs=1e-15)
    # Its right is level, and its down is down.
    assert paper.turned(q, (1, 0, 0))[2] == pytest.approx(0, abs=1e-15)
    assert paper.turned(q, (0, 1, 0))[2] < 0


@pytest.mark.parametrize(("reading", "factor"), [("seconds", FRAME_S), ("frames", 1.0)])
def test_one_frame_turns_by_its_reading(reading, factor):
    pursuit = paper.Pursuit(reading, COARSE, PRECISE, AHEAD)
    pursuit.look(True, [ray(1e-3, -2e-3)], FRAME_S)
    gain = (0.005 + 0.0005 * FRAME_S) * factor
    # Right and up; eq. 8's linear angles differ from the true ones by some millionths here.
    assert pursuit.axis_enu()[[0, 2]] == pytest.approx([gain * 1e-3, gain * 2e-3], rel=1e-4)


def test_as_printed_the_loop_stands_and_by_frames_it_closes():
    left = {}
    for reading in paper.READINGS:
        pursuit = paper.Pursuit(reading, COARSE, PRECISE, AHEAD)
        for _ in range(120):
            pursuit.look(True, [ray(1e-3)], FRAME_S)
        left[reading] = 1 - pursuit.axis_enu()[0] / 1e-3
    # 0.005 rad/s and 0.6 rad/s over a second; the integral adds little, and a still target no slope but by the axis's own turn.
    assert left["seconds"] == pytest.approx(math.exp(-0.005), abs=1e-3)
    assert left["frames"] == pytest.approx(math.exp(-0.6), abs=0.08)


def test_what_is_nearest_to_the_centre_is_the_target():
    pursuit = paper.Pursuit("frames", COARSE, PRECISE, AHEAD)
    own, other, outside = ray(2e-3), ray(-3e-3), ray(0.1)
    assert pursuit.look(True, [other, own, outside], FRAME_S) is own
    # One picture without it, and the other one is followed.
    assert pursuit.look(True, [other, outside], FRAME_S) is other
    assert pursuit.look(True, [outside], FRAME_S) is None
    assert pursuit.look(True, [], FRAME_S) is None


def test_the_precise_camera_rides_on_the_coarse_one():
    pursuit = paper.Pursuit("seconds", COARSE, PRECISE, AHEAD)
    pursuit.look(False, [ray(0.01)], 1 / 60)
    turn = (0.015 + 0.002 / 60) * 0.01
    assert pursuit.axis_enu()[0] == pytest.approx(turn, rel=1e-3)
