"""The client of `boresight serve` in Python: held to the schema, to a run in this process, and to its guide."""

import dataclasses
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

import boresight
from boresight import client
from boresight.client import AzElRates, Box, Deflection, Drive, Order, Run, ServerError

URBAN = "scenarios/urban_intercept.toml"
#: What the client names otherwise than the schema: messages without fields share a class, `Seek` is like `Step`, and a
#: reply's text is one class.
ALIKE = {"Restore": "_Step", "Seek": "_Step", "Error": "_Text", "Scenario": "_Text"}
KINDS = {"u": {"uint32", "uint64"}, "b": {"bool"}, "s": {"string"}, "y": {"bytes"}, "d": {"double"}, "h": {"fixed64"}, "D": {"double"}, "S": {"string"}}


@contextmanager
def served(*options, detector="truth"):
    words = [sys.executable, "-m", "boresight", "serve", URBAN, "--listen", "127.0.0.1:0", "--no-capture"]
    words += ["--set", f"detector.kind={detector}", "--seed", "7", *options]
    server = subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    try:
        for line in server.stderr:
            if line.startswith("serve "):
                yield line.split()[1], server
                break
        else:
            pytest.fail("the server does not listen")
    finally:
        if server.poll() is None:
            server.send_signal(signal.SIGINT)
        server.communicate(timeout=60)


def test_the_client_has_the_fields_of_the_schema():
    text = re.sub(r"//.*", "", open("crates/lockstep/proto/lockstep.proto").read())
    messages = {}
    for name, body in re.findall(r"message (\w+) \{((?:[^{}]|\{[^{}]*\})*)\}", text):
        fields = re.findall(r"(repeated |optional )?(\w+) (\w+) = (\d+)(?: \[[^\]]*\])?;", body)
        messages[name] = {int(number): (field, kind, bool(many.strip() == "repeated")) for many, kind, field, number in fields}
    compared = 0
    for name, fields in messages.items():
        own = ALIKE.get(name, name)
        mirror = getattr(client, own, None) or getattr(client, f"_{own}", None)
        if not fields:
            continue
        if mirror is None:
            # A request that only leaves things out is sent empty.
            assert name in {"GetState"}, name
            continue
        if name in ALIKE and own == "_Text":
            assert list(fields) == [1]
            continue
        known = {of.metadata["number"]: of for of in dataclasses.fields(mirror)}
        for number, of in known.items():
            field, kind, many = fields[number]
            if name not in {"Seek", "Restore"}:
                assert of.name.rstrip("_") == field, (name, number)
            wanted = of.metadata["kind"]
            if isinstance(wanted, str):
                assert kind in KINDS[wanted], (name, field)
                assert many == (wanted in "DS"), (name, field)
            compared += 1
        missing = {fields[number][0] for number in fields.keys() - known.keys()}
        assert missing <= {"goal", "camera"}, (name, missing)
    assert compared > 150


def follow(station_az_el, target, rates):
    """Rates that turn the gimbal to its target [deg/s]: eight times what is left to turn, a second."""
    return [57.29577951308232 * (rate + 8.0 * (at - now)) for now, at, rate in zip(station_az_el, target, rates)]


def test_a_controller_outside_is_the_same_run_over_either_door():
    run = boresight.Simulation(URBAN, detector__kind="truth", seed=7)
    hashes = []
    run.step(480)
    for _ in range(240):
        station = run.station()
        target = station.target
        if target is not None:
            wanted = follow(station.mount.measured_az_el_rad, target.az_el_rad, target.rates_radps)
            run.give(drive={"rates_degps": [float(rate) for rate in wanted], "mirror_urad": [0.0, 0.0]})
        run.step()
        hashes.append(run.state_hash)
    with served() as (address, _), Run(address) as remote:
        state = remote.step(480, state=True).state
        for wanted_hash in hashes:
            station = state.stations[0]
            track = next((track for track in station.tracks if track.is_target), None)
            if track is not None:
                wanted = follow(station.mount.measured_az_el_rad, track.az_el_rad, track.az_el_rates_radps)
                remote.order(Order(drive=Drive(AzElRates(*wanted), Deflection(0.0, 0.0))))
            state = remote.step(1, state=True).state
            assert state.state_hash == wanted_hash
        assert remote.seek(480).tick == 480
        with pytest.raises(ServerError, match="nobody"):
            remote.order(Order(designate="nobody"))
        assert remote.events().events
        remote.finish()


def test_a_client_is_the_detector():
    def look(question):
        return [Box(list(seen.box_px), 0.9, "quadcopter") for seen in question.frame.truth]

    with served(detector="outside") as (address, _), Run(address) as run:
        run.detect(look, pixels=False, truth=True)
        state = run.run_until(1.0, state=True).state
        assert state.stations[0].tracks
        run.finish()


def test_a_server_that_is_not_there_is_one_line():
    with pytest.raises(ServerError, match="does `boresight serve` listen there"):
        Run("127.0.0.1:1")


def test_the_guide_runs():
    (block,) = re.findall(r"```python\n(.*?)```", open("docs/serve.md").read(), re.DOTALL)
    with served("--set", "duration_s=0.2") as (address, server):
        exec(block.replace("127.0.0.1:7878", address), {})
        assert server.wait(timeout=60) == 0


def test_ctrl_c_stops_between_two_ticks():
    code = (
        "import boresight, os, signal, threading\n"
        # Where a shell has started the tests in its background, the signal is ignored.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        f"run = boresight.Simulation('{URBAN}', detector__kind='truth', duration_s=3000.0, engage__authorised=False)\n"
        "threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()\n"
        "try:\n    run.step(10**9)\n"
        "except KeyboardInterrupt:\n    print(run.tick > 0 and not run.over, run.step(1))\n"
    )
    begun = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.stdout.split() == ["True", "False"], done.stderr
    assert time.monotonic() - begun < 60


def test_a_sweep_leaves_its_table(tmp_path):
    experiment = tmp_path / "small.toml"
    experiment.write_text(
        f'name = "small"\nscenario = "{Path(URBAN).resolve()}"\nset = ["detector.kind=truth"]\nseeds = "1..=2"\n'
        'keep = ["energy_j"]\n[[factors]]\nname = "power [W]"\nkey = "station.laser.power_w"\nvalues = [400.0, 800.0]\n'
    )
    swept = boresight.sweep(experiment, tmp_path / "out", jobs=1)
    assert swept.exit_code == 0 and (swept.folder / "sweep.html").exists()
    pandas = pytest.importorskip("pandas")
    table = swept.table()
    assert isinstance(table, pandas.DataFrame) and len(table) == 4
    with pytest.raises(boresight.BoresightError, match="the sweep left"):
        swept.table("none")
    with pytest.raises(boresight.BoresightError, match="none.toml"):
        boresight.sweep("none.toml", tmp_path / "no")
