"""The scripts of examples/python that are run for their pictures."""

import importlib.util
from pathlib import Path

import numpy as np

EXAMPLES = Path(__file__).parents[2] / "examples/python"


def loaded(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_edges_are_less_sharp_in_strong_turbulence():
    calm, strong = [loaded("waving_edge").look(cn2).astype(float) for cn2 in (1e-15, 1e-13)]
    assert calm.shape == strong.shape == (480, 640, 3)
    steepest = [np.abs(np.diff(picture.mean(axis=2), axis=1)).max() for picture in (calm, strong)]
    assert steepest[0] > 10.0  # the towers are in the picture
    assert steepest[1] < 0.8 * steepest[0]


def test_a_filter_keeps_the_lasers_light_out_of_the_picture():
    example = loaded("laser_in_haze")
    for name, whether in [("bare", True), ("filter", False)]:
        precise, coarse = example.look(f"haze_{name}")
        for before, firing in (precise, coarse):
            brightest = [int(picture.sum(axis=2).max()) for picture in (before, firing)]
            assert (brightest[1] > brightest[0] + 30) == whether, (name, brightest)
