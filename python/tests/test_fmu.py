"""A station as a co-simulation unit, by another implementation of FMI 3.0, FMPy: held to the standard's schema, and to a run
of the package that is driven in the same way."""

import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

from boresight import Simulation

fmpy = pytest.importorskip("fmpy")
validation = pytest.importorskip("fmpy.validation")
fmi3 = pytest.importorskip("fmpy.fmi3")

URBAN = "scenarios/urban_intercept.toml"
STEP_S = 1 / 96
#: Rate per angle of the controller outside [1/s].
GAIN = 4.0


def exactly(rate_radps):
    """The rate nearest to one that is the same in both units to the last bit, and in JSON, which has 15 digits without loss."""
    grid = round(math.degrees(rate_radps), 6)
    for away in sorted(range(-50, 51), key=abs):
        degps = round(grid + 1e-6 * away, 6)
        near = math.radians(degps)
        for radps in (near, math.nextafter(near, math.inf), math.nextafter(near, -math.inf)):
            if math.degrees(radps) == degps:
                return radps, degps
    pytest.fail(f"no such rate near {rate_radps}")


def library():
    """The unit's library as cargo builds it, where there is one."""
    named = os.environ.get("BORESIGHT_FMU_LIBRARY")
    if named:
        return Path(named)
    built = Path(os.environ.get("CARGO_TARGET_DIR", "target")) / "release/libboresight_fmu.so"
    if not built.is_file():
        pytest.skip(f"{built} is not there: cargo build --release --workspace, or set BORESIGHT_FMU_LIBRARY")
    return built


def exported(out, *options):
    words = [sys.executable, "-m", "boresight", "fmu", URBAN, "--library", library(), "--out", out, *options]
    return subprocess.run(words, capture_output=True, text=True)


@pytest.fixture(scope="module")
def unit(tmp_path_factory):
    out = tmp_path_factory.mktemp("fmu") / "station.fmu"
    checkout = Path(__file__).parents[2]
    before = Path.cwd()
    os.chdir(checkout)
    try:
        done = exported(out, "--set", "detector.kind=truth", "--set", "duration_s=6")
    finally:
        os.chdir(before)
    assert done.returncode == 0, done.stderr
    return out


class Unit:
    """A unit that is stepped, and what it has logged."""

    def __init__(self, unit, seed=None):
        described = fmpy.read_model_description(unit)
        self.references = {variable.name: variable.valueReference for variable in described.modelVariables}
        self.lines = []
        self.fmu = fmi3.FMU3Slave(
            guid=described.guid,
            unzipDirectory=fmpy.extract(unit),
            modelIdentifier=described.coSimulation.modelIdentifier,
            instanceName="station",
        )
        self.fmu.instantiate(loggingOn=True, logMessage=lambda _, status, category, line: self.lines.append(line.decode()))
        self.fmu.enterInitializationMode(startTime=0.0)
        if seed is not None:
            self.fmu.setUInt64([self.references["seed"]], [seed])
        self.fmu.exitInitializationMode()
        self.t_s = 0.0

    def get(self, name, kind="Float64"):
        return getattr(self.fmu, f"get{kind}")([self.references[name]])[0]

    def set(self, name, value, kind="Float64"):
        getattr(self.fmu, f"set{kind}")([self.references[name]], [value])

    def step(self, step_s=STEP_S):
        self.fmu.doStep(currentCommunicationPoint=self.t_s, communicationStepSize=step_s)
        self.t_s += step_s

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()


def test_the_description_is_valid_and_names_what_the_guide_does(unit):
    assert validation.validate_fmu(str(unit)) == []
    described = fmpy.read_model_description(unit)
    guide = Path("docs/fmu.md").read_text()
    assert not [variable.name for variable in described.modelVariables[1:] if f"`{variable.name}`" not in guide]
    assert described.coSimulation.canGetAndSetFMUstate is False


def test_driven_from_outside_it_is_the_run_of_the_package(unit):
    station = Unit(unit, seed=7)
    run = Simulation(URBAN, seed=7, set={"detector.kind": "truth", "duration_s": 6})
    ticks = round(run.tick_hz * STEP_S)
    assert station.get("state_hash", "UInt64") == run.state_hash
    given = None
    held = 0
    for at in range(round(2 / STEP_S)):
        # Half a second by itself; then a proportional controller outside.
        drive = at >= round(0.5 / STEP_S)
        rates, wanted = zip(*(exactly(GAIN * station.get(f"error.{axis}")) for axis in ("azimuth", "elevation")))
        station.set("drive", drive, "Boolean")
        station.set("gimbal_rate.azimuth", rates[0])
        station.set("gimbal_rate.elevation", rates[1])
        station.step()
        if drive and wanted != given:
            run.give(drive={"rates_degps": list(wanted), "mirror_urad": [0.0, 0.0]})
            given = wanted
        run.step(ticks)
        assert station.get("state_hash", "UInt64") == run.state_hash, f"step {at}"
        mount, beam = run.stations[0].mount, run.stations[0].beam
        encoders = [station.get("encoder.azimuth"), station.get("encoder.elevation")]
        assert encoders == list(mount.measured_az_el_rad)
        assert station.get("beam.energy") == beam.energy_j
        held += station.get("target.held", "Boolean")
    # The controller outside holds what it was given.
    assert held > 0 and station.get("target.held", "Boolean")
    assert abs(station.get("error.elevation")) < 0.01
    assert station.get("target.range") == pytest.approx(run.stations[0].target.range_m[0])
    station.close()


def test_authority_to_fire_is_an_input(unit):
    energies = []
    for authority in (True, False):
        station = Unit(unit)
        station.set("fire_authority", authority, "Boolean")
        for _ in range(5):
            station.step(1.0)
        energies.append(station.get("beam.energy"))
        station.close()
    assert energies[0] > 0 and energies[1] == 0


def test_what_cannot_be_done_is_an_error_with_a_line_and_the_run_goes_on(unit):
    station = Unit(unit)
    for step_s in (0.001, -STEP_S, 0.0):
        with pytest.raises(Exception):
            station.fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=step_s)
        assert "whole number of ticks" in station.lines[-1]
    with pytest.raises(Exception):
        station.fmu.doStep(currentCommunicationPoint=1.0, communicationStepSize=STEP_S)
    assert "the communication point is 1 s" in station.lines[-1]
    for name, value, kind, words in [
        ("seed", 3, "UInt64", "set before the run begins"),
        ("beam.energy", 3.0, "Float64", "is an output"),
        ("drive", 1.0, "Float64", "another type"),
    ]:
        with pytest.raises(Exception):
            station.set(name, value, kind)
        assert words in station.lines[-1]
    with pytest.raises(Exception):
        station.fmu.getFMUState()
    assert "is not offered" in station.lines[-1]
    station.set("drive", True, "Boolean")
    station.set("gimbal_rate.azimuth", math.nan)
    with pytest.raises(Exception):
        station.step()
    assert "rates_degps" in station.lines[-1]
    # None of them has let time pass.
    assert station.get("time") == 0.0
    station.set("gimbal_rate.azimuth", 0.1)
    station.step()
    assert station.get("time") == pytest.approx(STEP_S)
    # Again from the beginning.
    station.fmu.reset()
    station.fmu.enterInitializationMode(startTime=0.0)
    station.fmu.exitInitializationMode()
    assert station.get("time") == 0.0
    station.close()


def test_the_end_of_the_run_is_told(unit):
    result = fmpy.simulate_fmu(str(unit), stop_time=8.0, output_interval=0.5, output=["over", "beam.energy"])
    assert result["time"][-1] == pytest.approx(6.0, abs=0.51)
    assert bool(result["over"][-1])


def test_what_a_unit_has_no_part_for_is_refused(tmp_path):
    for options, words in [
        ([], "detector.kind = \"onnx\": is not offered in a unit"),
        (["--set", "detector.kind=truth", "--station", "west"], "--station west: there is no such station"),
    ]:
        done = exported(tmp_path / "none.fmu", *options)
        assert done.returncode == 2 and words in done.stderr, done.stderr
    assert not list(tmp_path.iterdir())


def test_a_unit_has_what_its_scenario_names(tmp_path):
    path = tmp_path / "from" / "flown.csv"
    path.parent.mkdir()
    rows = [f"{t},{-700 + 8 * t},650,80" for t in range(0, 30)]
    path.write_text("\n".join(["t_s,east_m,north_m,up_m", *rows]))
    text = Path(URBAN).read_text()
    flown = 'trajectory = { kind = "recorded", file = "flown.csv" }'
    lines = [flown if line.startswith("trajectory") else line for line in text.splitlines()]
    scenario = path.with_name("flown.toml")
    scenario.write_text("\n".join(lines))
    out = tmp_path / "flown.fmu"
    words = [sys.executable, "-m", "boresight", "fmu", scenario, "--set", "detector.kind=truth"]
    done = subprocess.run([*words, "--library", library(), "--out", out], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    run = Simulation(scenario, set={"detector.kind": "truth"})
    run.step(960)
    path.unlink()
    station = Unit(out)
    station.step(1.0)
    assert station.get("state_hash", "UInt64") == run.state_hash
    station.close()
