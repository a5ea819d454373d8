"""Scenarios that are no files."""

import datetime
import doctest
import importlib
import tomllib
from pathlib import Path

import numpy as np
import pytest

import boresight
from boresight import scenario

URBAN = Path("scenarios/urban_intercept.toml")
URBAN_TEXT = (Path(__file__).parents[2] / URBAN).read_text()


def hash_of(given, **more):
    with boresight.Simulation(given, detector__kind="truth", **more) as run:
        run.run_until(0.3)
        return run.state_hash


@pytest.mark.parametrize("name", ["boresight", "boresight.scenario", "boresight.recording"])
def test_what_the_docstrings_show(name):
    failed, tried = doctest.testmod(importlib.import_module(name))
    assert failed == 0 and tried > 0


def test_text_and_tables_are_the_same_run_as_the_file(tmp_path, monkeypatch):
    text = URBAN.read_text()
    of_file = hash_of(URBAN)
    # From anywhere.
    monkeypatch.chdir(tmp_path)
    assert hash_of(boresight.Scenario.from_text(text)) == of_file
    assert hash_of(tomllib.loads(text)) == of_file
    assert hash_of(boresight.Scenario.from_dict(tomllib.loads(text)), seed=3) != of_file


@pytest.mark.parametrize("path", sorted(Path(__file__).parents[2].glob("scenarios/*.toml")), ids=lambda path: path.stem)
def test_tables_of_every_shipped_scenario_come_back(path):
    tables = tomllib.loads(path.read_text())
    assert tomllib.loads(scenario.document(tables)) == tables


def test_all_that_toml_has_comes_back():
    tables = {
        "text": 'a "b" \\ ä\n',
        "odd key": {"x.y": [1, 2.5, True], "empty": [], "none": {}},
        "at": datetime.datetime(2025, 9, 20, 8, 50, tzinfo=datetime.UTC),
        "mixed": [1, {"a": 2}],
        "tables": [{"name": "a", "inner": [{"b": 1}, {"b": 2}]}, {}],
        "last": 1e300,
    }
    assert tomllib.loads(scenario.document(tables)) == tables
    arrays = {"r_enu_m": np.array([1.0, 2.0]), "count": np.int64(3), "file": Path("a/b")}
    assert tomllib.loads(scenario.document(arrays)) == {"r_enu_m": [1.0, 2.0], "count": 3, "file": "a/b"}
    with pytest.raises(TypeError, match="no place in a scenario"):
        scenario.document({"what": object()})


def test_paths_lead_on_from_the_folder(tmp_path):
    (tmp_path / "path.csv").write_text("t_s,east_m,north_m,up_m\n0,-350,350,250\n30,-300,400,250\n")
    tables = tomllib.loads(URBAN.read_text())
    tables["uavs"][0]["trajectory"] = {"kind": "recorded", "file": "path.csv"}
    assert hash_of(boresight.Scenario.from_dict(tables, tmp_path))
    with pytest.raises(boresight.ScenarioError, match=r"^scenario text, line \d+: uavs\[0\]\.trajectory.*path\.csv"):
        hash_of(boresight.Scenario.from_dict(tables))


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("\n\nname = ", "scenario text, line 3: not TOML"),
        (URBAN.name, "scenario text, line 1: not TOML"),
        (URBAN_TEXT.replace("power_w = 800.0", "power_w = -1"), "scenario text, line 24: station.laser.power_w: "),
        ("", "scenario text, line 1: name: is missing"),
    ],
)
def test_an_error_names_the_line_of_the_text(text, line):
    with pytest.raises(boresight.ScenarioError) as caught:
        boresight.Simulation(boresight.Scenario.from_text(text))
    assert str(caught.value).startswith(line) and len(str(caught.value).splitlines()) == 1
    with pytest.raises(boresight.ScenarioError, match="^scenario text: --set seed=.x.: seed: "):
        boresight.Simulation(boresight.Scenario.from_text(URBAN.read_text()), seed=None, set={"seed": "x"})
