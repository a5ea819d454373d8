"""The front door from Python, held to what the same run is elsewhere."""

import gc
import re
import shutil
import subprocess
import sys
import threading

import numpy as np
import pytest

import boresight

URBAN = "scenarios/urban_intercept.toml"


def opened(**more):
    return boresight.Simulation(URBAN, **{"detector__kind": "truth", "seed": 7, **more})


def test_a_run_steps_and_shows_itself():
    run = opened()
    assert (run.tick, run.t_s, run.seed, run.tick_hz) == (0, 0.0, 7, 960)
    assert run.step(96) is False
    assert run.tick == 96 and run.t_s == pytest.approx(0.1)
    station = run.stations[0]
    mount = station.mount
    assert mount.az_el_rad.shape == (2,) and mount.az_el_rad.dtype == np.float64
    assert mount.laser_pose.shape == (4, 4)
    turn = mount.laser_pose[:3, :3]
    assert np.allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    uav = run.uavs[0]
    assert uav.status == "flying" and uav.distractor is None
    assert np.linalg.norm(uav.v_enu_mps) > 1.0
    assert run.air.visibility_m > 100.0
    # What the station follows is what flies there.
    run.run_until(1.0)
    track = station.target
    towards = uav.r_enu_m - mount.r_enu_m
    assert track is not None and track.uav_probability > 0.5
    now = run.uavs[0].r_enu_m - mount.r_enu_m
    azimuth = np.arctan2(now[0], now[1])
    assert abs(track.az_el_rad[0] - azimuth) < 0.01
    assert not np.array_equal(now, towards)


def test_steps_of_any_length_are_the_same_run():
    one, many = opened(), opened()
    one.run_until(0.5)
    while many.tick < one.tick:
        many.step(7 if many.tick + 7 <= one.tick else 1)
    assert one.state_hash == many.state_hash != 0
    other = opened(seed=8)
    other.run_until(0.5)
    assert other.state_hash != one.state_hash


def test_orders_are_obeyed_and_repeat(tmp_path):
    run = opened()
    run.give(fire=False)
    run.run_until(0.5)
    run.drive(rates_radps=np.array([0.05, 0.0]), mirror_rad=[0.0, 0.0])
    run.run_until(1.0)
    assert run.station().beam.energy_j == 0.0
    orders = [event.data for event in run.events if event.kind == "order"]
    assert [(order["order"], order["answer"]) for order in orders] == [("drive", "obeyed")]
    again = tmp_path / "again.toml"
    again.write_text(run.scenario_with_orders())
    repeated = boresight.Simulation(again)
    repeated.run_until(1.0)
    assert repeated.state_hash == run.state_hash


def test_frames_have_pixels_and_truth():
    run = boresight.Simulation(URBAN, seed=7, detector__kind="truth", pictures=True)
    frames = []
    while not frames:
        run.step()
        frames = run.frames
    frame = frames[0]
    width, height = frame.size_px
    pixels = frame.pixels
    assert pixels.shape == (height, width, 3) and pixels.dtype == np.uint8 and pixels.std() > 0
    # A fresh array each time, and the frame outlives its run.
    pixels[:] = 0
    del run
    gc.collect()
    assert frame.pixels.std() > 0
    for seen in frame.truth:
        x0, y0, x1, y1 = seen.box_px
        assert x0 < x1 and y0 < y1 and seen.range_m > 0
        # The pose projects the UAV to where its box is.
    assert frame.pose.shape == (4, 4)


class GimbalAlone:
    """The law of examples/own_law.rs."""

    def __init__(self, plant):
        assert plant.dt_s == pytest.approx(1 / 960) and plant.mirror_stroke_rad > 0

    def command(self, at):
        return at.gimbal_rates([8.0, 8.0]), at.mirror([0.0, 0.0])


@pytest.mark.skipif(shutil.which("cargo") is None, reason="the law in Rust needs cargo")
def test_a_law_in_python_is_that_in_rust():
    run = boresight.Simulation(
        URBAN,
        laws={"gimbal_alone": GimbalAlone},
        controller__preset="gimbal_alone",
        detector__kind="truth",
    )
    run.run_until(2.0)
    assert run.station().law == "gimbal_alone"
    words = ["cargo", "run", "--release", "--quiet", "--locked", "--example", "own_law"]
    in_rust = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert f"state {run.state_hash:016x}" in in_rust.splitlines()[1]


@pytest.mark.parametrize(
    ("says", "line"),
    [
        (lambda at: 1 / 0, "division by zero"),
        (lambda at: ([float("nan"), 0.0], [0.0, 0.0]), "must be finite"),
        (lambda at: [1.0, 2.0, 3.0], "two pairs"),
        (lambda at: None, "two pairs"),
    ],
)
def test_a_law_that_fails_ends_the_run_with_its_own_error(says, line):
    class Law:
        def __init__(self, plant):
            pass

        def command(self, at):
            return says(at)

    run = opened(laws={"mine": Law}, controller__preset="mine")
    with pytest.raises(boresight.BoresightError, match=line) as caught:
        run.run_until(1.0)
    assert caught.value.__cause__ is not None and "mine" in str(caught.value)
    with pytest.raises(boresight.BoresightError, match="failed before"):
        run.step()


class Contrast:
    """What stands out most from the mean of its picture."""

    start_score = 0.3
    weak_score = 0.15
    neutral_score = 0.3
    roi_px = 256

    def __init__(self):
        self.asked = 0

    def detect(self, picture):
        self.asked += 1
        green = picture.pixels[:, :, 1].astype(float)
        y, x = np.unravel_index(np.argmax(np.abs(green - np.median(green))), green.shape)
        return [[x - 2, y - 2, x + 3, y + 3, 0.8]]


def test_a_detector_in_python_is_in_the_loop():
    detector = Contrast()
    run = boresight.Simulation(
        URBAN,
        detectors={"contrast": detector},
        detector__kind="contrast",
        engage__authorised=False,
        uavs__0__trajectory={
            "kind": "straight",
            "start_enu_m": [-350, 350, 250],
            "velocity_enu_mps": [5, 5, 0],
        },
    )
    run.run_until(0.5)
    assert detector.asked > 5 and run.station().tracks


@pytest.mark.parametrize(
    ("rows", "line"),
    [
        ([[0, 0, 1, 1]], "rows of 4 numbers"),
        ([[0, 0, 1, 1, 2.0]], "score 2"),
        ([[5, 0, 1, 1, 0.5]], "ends before it begins"),
        ([[0, 0, 1, 1, 0.5, 3]], "none of the 1 classes"),
        ([[0, 0, 1, float("inf"), 0.5]], "not finite"),
        ("boxes", "rows of x0"),
    ],
)
def test_a_detector_that_answers_wrongly_ends_the_run(rows, line):
    class Wrong:
        wants_pictures = False

        def detect(self, picture):
            return rows

    run = opened(detectors={"wrong": Wrong()}, detector__kind="wrong", pictures=False)
    with pytest.raises(boresight.BoresightError, match=line):
        run.run_until(0.5)


@pytest.mark.parametrize(
    ("make", "error", "line"),
    [
        (lambda: boresight.Simulation("none.toml"), boresight.ScenarioError, "none.toml"),
        (lambda: opened(weather__visiblity_m=1), boresight.ScenarioError, "visibility_m"),
        (lambda: opened(weather__visibility_m="far"), boresight.ScenarioError, "visibility_m"),
        (lambda: opened(detector__kind="nobody"), boresight.BoresightError, "nobody"),
        (lambda: opened(weather__visibility_m=object()), TypeError, "no place"),
        (lambda: opened().give(slew_deg=[0, 200]), boresight.OrderError, "slew_deg"),
        (lambda: opened().give(shoot=True), boresight.OrderError, "shoot"),
        (lambda: opened().give(slew_deg=[0, float("nan")]), boresight.OrderError, "finite"),
        (lambda: opened().station("north"), ValueError, "north"),
        (lambda: boresight.Recording("README.md"), boresight.RecordingError, "README.md"),
    ],
)
def test_bad_input_gets_one_line(make, error, line):
    with pytest.raises(error, match=line) as caught:
        make()
    assert len(str(caught.value).splitlines()) == 1


def test_runs_side_by_side_and_from_thread_to_thread():
    runs = [opened(), opened()]
    threads = [threading.Thread(target=run.run_until, args=(1.0,)) for run in runs]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert runs[0].state_hash == runs[1].state_hash
    with pytest.raises(RuntimeError, match="middle of a step"):
        class Asks:
            def __init__(self, plant):
                pass

            def command(self, at):
                return run.t_s, run.t_s

        run = opened(laws={"asks": Asks}, controller__preset="asks")
        try:
            run.run_until(1.0)
        except boresight.BoresightError as error:
            raise error.__cause__ from None


def test_a_recording_is_tables(tmp_path):
    with opened(record=tmp_path) as run:
        run.run_until(0.5)
    assert run.finish() is None
    with pytest.raises(RuntimeError, match="finished"):
        run.step()
    recording = boresight.Recording(tmp_path / "run.mcap")
    assert (recording.seed, recording.tick_hz, recording.whole) == (7, 960, True)
    topics = recording.topics()
    topic = next(topic for topic in topics if topic.endswith("/mount_state"))
    columns = recording.columns(topic)
    assert len(columns["t_s"]) == topics[topic] > 10
    assert columns["t_s"] == sorted(columns["t_s"])
    pandas = pytest.importorskip("pandas")
    assert isinstance(recording.table(topic), pandas.DataFrame)
    with pytest.raises(boresight.RecordingError, match="/none"):
        recording.messages("/none")
    again = boresight.Simulation(tmp_path / "run.mcap")
    again.run_until(0.5)
    assert again.seed == 7


def test_the_command_comes_with_it(tmp_path):
    words = [sys.executable, "-m", "boresight"]
    version = subprocess.run([*words, "--version"], capture_output=True, text=True, cwd=tmp_path)
    assert version.stdout.split() == ["boresight", boresight.__version__]
    # Shipped scenarios are found from anywhere.
    check = [*words, "check", "scenarios/urban_intercept.toml", "--set", "detector.kind=truth"]
    assert subprocess.run(check, capture_output=True, cwd=tmp_path).returncode == 0
    wrong = subprocess.run([*words, "run", "none.toml"], capture_output=True, text=True, cwd=tmp_path)
    assert wrong.returncode == 2 and wrong.stderr.startswith("error: ")


def test_the_guide_runs():
    blocks = re.findall(r"```python\n(.*?)```", open("docs/python.md").read(), re.DOTALL)
    assert len(blocks) == 4
    names = {}
    # The last shows what is made of runs that a reader has at hand.
    for block in blocks[:-1]:
        exec(block, names)
    assert names["run"].step(2) is False
