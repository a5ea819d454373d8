"""Runs that go back, and what they are told meanwhile."""

import numpy as np
import pytest

import boresight

SCENARIO = "scenarios/urban_intercept.toml"


class Integrator:
    """A law with a memory: it counts how often it was asked."""

    def __init__(self, plant):
        self.asked = np.zeros(1)

    def command(self, at):
        self.asked += 1
        gain_per_s = 8.0 + 0.001 * self.asked[0]
        return at.gimbal_rates([gain_per_s] * 2), at.mirror([0.0, 0.0])


def opened(**more):
    return boresight.Simulation(SCENARIO, detector__kind="truth", seed=3, **more)


def hashes(run, ticks):
    out = []
    for _ in range(ticks):
        run.step()
        out.append(run.state_hash)
    return out


def test_a_run_goes_back_with_the_memory_of_its_law():
    with opened(laws={"integrator": Integrator}, controller__preset="integrator") as run:
        run.run_until(1.0)
        there = run.snapshot()
        assert there.tick == run.tick
        first = hashes(run, 300)
        run.restore(there)
        assert run.tick == there.tick
        assert hashes(run, 300) == first


def test_a_branch_is_another_run_and_the_way_back_the_same():
    with opened() as run:
        run.run_until(1.0)
        there = run.snapshot()
        run.run_until(2.0)
        straight = run.state_hash
        run.restore(there)
        run.drive(rates_radps=[0.2, 0.0])
        run.run_until(2.0)
        assert run.state_hash != straight
        run.restore(there)
        run.run_until(2.0)
        assert run.state_hash == straight


def test_a_snapshot_of_another_run_or_a_recorded_run_is_one_error(tmp_path):
    with opened() as one, opened(record=tmp_path) as other:
        with pytest.raises(boresight.BoresightError, match="of another run"):
            one.restore(other.snapshot())
        with pytest.raises(boresight.BoresightError, match="recorded does not go back"):
            other.restore(other.snapshot())


def test_a_uav_flies_and_a_camera_exposes_as_told():
    with opened() as run:
        run.give(fire=False)
        goal = run.uavs[0].r_enu_m + [5.0, 5.0, 5.0]
        run.give(fly={"uav": "intruder", "path_enu_m": [goal], "speed_mps": 6.0})
        run.give(camera={"name": "ctv", "exposure_s": 2e-4})
        run.run_until(10.0)
        np.testing.assert_allclose(run.uavs[0].r_enu_m, goal, atol=1.0)
        with pytest.raises(boresight.OrderError, match="fly.uav: no UAV 'nobody'"):
            run.give(fly={"uav": "nobody"})
        with pytest.raises(boresight.OrderError, match=r"fly.rotors\[1\]"):
            run.give(fly={"uav": "intruder", "rotors": [0.5, 1.5, 0.5, 0.5]})
