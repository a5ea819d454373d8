"""A program as a user with a type checker writes it: all that the guide names. `test_types.py` holds it to `mypy --strict`."""

import tomllib
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

import boresight
from boresight import client

URBAN = "scenarios/urban_intercept.toml"


class GimbalAlone:
    lead_s = 0.0

    def __init__(self, plant: boresight.Plant) -> None:
        self.gains_per_s = [8.0, 8.0] if plant.dt_s < 0.01 else [4.0, 4.0]

    def command(self, at: boresight.PointingInput) -> tuple[ArrayLike, ArrayLike]:
        rates_radps: NDArray[np.float64] = at.gimbal_rates(self.gains_per_s)
        return rates_radps, at.mirror(0.0 * at.deflection_rad)

    def rest(self) -> None:
        pass


class Brightest:
    classes = ("uav",)
    start_score, weak_score, roi_px = 0.3, 0.15, 256

    def detect(self, picture: boresight.Picture) -> ArrayLike:
        green = picture.pixels[:, :, 1].astype(float)
        y, x = np.unravel_index(np.argmax(green), green.shape)
        return np.array([[x - 2, y - 2, x + 3, y + 3, 0.8]])


def whole_run(out: Path) -> dict[str, object] | None:
    with boresight.Simulation(URBAN, seed=7, record=out, set={"detector.kind": "truth"}, weather__visibility_m=5000) as run:
        run.give(fire=False)
        run.drive(rates_radps=[0.1, 0.0], mirror_rad=np.zeros(2))
        while not run.step(96) and not run.run_until(run.t_s + 0.1):
            for station in run.stations:
                if station.target is not None and station.target.range_m is not None:
                    range_m, sigma_m = station.target.range_m
                    print(station.name, station.state, range_m + sigma_m, station.mount.az_el_rad + [0.0, 0.1])
                for frame, found in station.arrived:
                    print(frame.tick, [score for _, _, _, _, score, _ in found])
            for frame in run.frames:
                if (pixels := frame.pixels) is not None:
                    print(pixels.mean(), frame.believed_pose @ frame.pose, [seen.box_px[0] for seen in frame.truth])
            for event in run.events:
                print(event.t_s, event.kind, event.data["station"])
        print(run.uavs[0].r_enu_m, run.air.visibility_m, run.station().beam.energy_j, run.scenario_with_orders())
        return run.finish()


def own_parts() -> int:
    run = boresight.Simulation(
        Path(URBAN),
        laws={"gimbal_alone": GimbalAlone, "slow": lambda plant: GimbalAlone(plant)},
        controller__preset="gimbal_alone",
        detectors={"brightest": Brightest()},
        detector__kind="brightest",
    )
    kept = run.snapshot()
    run.step()
    run.restore(kept)
    return run.state_hash


def own_scenario(text: str) -> float:
    tables = tomllib.loads(text)
    tables["duration_s"] = 2.0
    with boresight.Simulation(tables) as run, boresight.Simulation(boresight.Scenario.from_text(text, "scenarios")) as other:
        return run.t_s + other.t_s + float(run.summary()["energy_j"])


def afterwards(out: Path) -> None:
    recording = boresight.Recording(out / "run.mcap")
    t_s, fields = recording.messages("/boresight/mount_state")[0]
    print(t_s + recording.tick_hz, fields["t_s"], recording.topics(), recording.columns("/boresight/mount_state")["t_s"])
    try:
        swept = boresight.sweep("experiments/dwell.toml", out=out, jobs=2)
    except boresight.ScenarioError as error:
        raise SystemExit(str(error)) from error
    print(swept.folder / "table.csv", swept.exit_code)


def served() -> None:
    with client.Run("127.0.0.1:7878") as run:
        while not (stepped := run.step(1, state=True)).over:
            if stepped.state is not None:
                print(stepped.state.stations[0].mount.az_el_rad if stepped.state.stations[0].mount else None)
            run.order(client.Order(drive=client.Drive(rates=client.AzElRates(azimuth_degps=1.0))))
