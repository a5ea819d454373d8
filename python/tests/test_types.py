"""The types that the package tells: the stubs are those of the module, and programs can be checked against them."""

import ast
import importlib.util
import inspect
import pkgutil
import re
import subprocess
import sys
import types
import typing
from pathlib import Path

import numpy as np
import pytest

import boresight
from boresight import _boresight

HERE = Path(__file__).parent
STUB = Path(boresight.__file__).with_name("_boresight.pyi")
URBAN = "scenarios/urban_intercept.toml"
#: They build on libraries: PettingZoo has no types, and Gymnasium's are at odds with its own documents.
UNTYPED = {"gym", "zoo"}

mypy = pytest.mark.skipif(importlib.util.find_spec("mypy") is None, reason="pip install mypy")


def checked(*words, cwd):
    # From elsewhere, so that the installed package is checked and not the checkout's folder.
    done = subprocess.run([sys.executable, "-m", *words], capture_output=True, text=True, cwd=cwd)
    return done.returncode, done.stdout + done.stderr


@mypy
def test_the_stubs_are_those_of_the_module(tmp_path):
    assert checked("mypy.stubtest", "boresight._boresight", cwd=tmp_path) == (
        0,
        "Success: no issues found in 1 module\n",
    )


@mypy
def test_the_package_is_typed(tmp_path):
    assert STUB.with_name("py.typed").exists()
    names = {found.name for found in pkgutil.iter_modules(boresight.__path__)} - UNTYPED
    words = [word for name in sorted(names) for word in ("-m", f"boresight.{name}")]
    code, said = checked("mypy", "--strict", "-m", "boresight", *words, cwd=tmp_path)
    assert code == 0, said


@mypy
def test_a_users_program_is_typed(tmp_path):
    code, said = checked("mypy", "--strict", str(HERE / "typed.py"), cwd=tmp_path)
    assert code == 0, said


@mypy
def test_mistakes_are_found(tmp_path):
    wrong = HERE / "mistyped.py"
    marked = [at for at, line in enumerate(wrong.read_text().splitlines(), 1) if line.endswith("# error")]
    code, said = checked("mypy", "--strict", str(wrong), cwd=tmp_path)
    found = {int(at) for at in re.findall(r"mistyped\.py:(\d+): error", said)}
    assert (code, sorted(found)) == (1, marked), said


def stub_classes():
    body = ast.parse(STUB.read_text()).body
    return {node.name: node for node in body if isinstance(node, ast.ClassDef)}


def members(node):
    return [member for member in node.body if isinstance(member, ast.FunctionDef) and not member.name.startswith("_")]


def test_every_class_says_what_it_is_and_the_stubs_say_the_same():
    classes = stub_classes()
    there = {name for name, held in vars(_boresight).items() if isinstance(held, type)}
    assert set(classes) == there
    for name, node in classes.items():
        held = getattr(_boresight, name)
        assert ast.get_docstring(node) == inspect.getdoc(held), name
        for member in members(node):
            said = inspect.getdoc(inspect.getattr_static(held, member.name))
            assert said and ast.get_docstring(member) == said, f"{name}.{member.name}"
            # Arrays say their shapes, and quantities their units.
            arrays = "NDArray" in ast.unparse(member.returns)
            assert bool(re.search(r"Shape \[.+\]", said)) == arrays, f"{name}.{member.name}"
            for ending, unit in UNITS.items():
                if member.name.endswith(ending):
                    assert f"[{unit}]" in said or "Rate" in said or "same" in said, f"{name}.{member.name}: {said}"


#: What a name ends in, and its unit.
UNITS = {
    "_enu_m": "m",
    "_range_m": "m",
    "_s": "s",
    "_hz": "Hz",
    "_px": "px",
    "_j": "J",
    "_k": "K",
    "_w": "W",
    "_pa": "Pa",
    "_rad": "rad",
    "_radps": "rad/s",
    "_mps": "m/s",
    "_wpm2": "W/m²",
}


def fits(value, kind):
    """Whether a value is of a type, as far down as the type says."""
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if kind is typing.Any:
        return True
    if origin in (typing.Union, types.UnionType):
        return any(fits(value, one) for one in inner)
    if origin is np.ndarray:
        (number,) = typing.get_args(inner[1])
        return isinstance(value, np.ndarray) and value.dtype == number
    if origin is list:
        return isinstance(value, list) and all(fits(one, inner[0]) for one in value)
    if origin is tuple:
        return isinstance(value, tuple) and len(value) == len(inner) and all(map(fits, value, inner))
    if origin is dict:
        return isinstance(value, dict) and all(fits(key, inner[0]) and fits(held, inner[1]) for key, held in value.items())
    if kind is int:
        return isinstance(value, int) and not isinstance(value, bool)
    return isinstance(value, kind if kind is not None else type(None))


def shapes(value):
    if isinstance(value, np.ndarray):
        return [value.shape]
    return [shape for one in value for shape in shapes(one)] if isinstance(value, tuple) else []


def of_a_run(folder):
    """Objects of every class."""
    seen = []

    class Law:
        def __init__(self, plant):
            seen.append(plant)

        def command(self, at):
            seen[1:] = [seen[1] if len(seen) > 1 else at]
            return at.gimbal_rates([8.0, 8.0]), at.mirror(at.deflection_rad)

    pictures = []

    class Found:
        def detect(self, picture):
            pictures[:] = [picture]
            (x, y), truth = picture.offset_px, picture.frame.truth
            boxes = [seen.visible_box_px for seen in truth if seen.visible_box_px]
            return [[x0 - x, y0 - y, x1 - x, y1 - y, 0.9] for x0, y0, x1, y1 in boxes]

    run = boresight.Simulation(
        URBAN,
        laws={"mine": Law},
        controller__preset="mine",
        detectors={"found": Found()},
        detector__kind="found",
        record=folder,
    )
    frames, events, arrived = [], [], []
    while not (run.station().target and arrived and events and len(seen) > 1) or run.t_s < 0.5:
        run.step()
        frames += run.frames
        events += run.events
        arrived += run.station().arrived
        assert run.t_s < 2.0
    station, uav = run.station(), run.uavs[0]
    yield from (run, station, station.mount, station.beam, station.target, *station.cameras, uav, run.air)
    yield from (*frames[:9], *(one for frame in frames for one in frame.truth), *events, *seen, *pictures, run.snapshot())
    run.finish()
    yield boresight.Recording(folder / "run.mcap")


def test_values_are_of_the_types_and_shapes_that_the_stubs_say(tmp_path):
    names = {**vars(_boresight), **vars(typing), "NDArray": np.typing.NDArray, "Path": Path}
    names |= {"float64": np.float64, "uint8": np.uint8}
    classes, visited = stub_classes(), set()
    for held in of_a_run(tmp_path):
        name = next(base.__name__ for base in type(held).__mro__ if base.__module__ in ("boresight", "boresight._boresight"))
        for member in members(classes[name]):
            if not member.decorator_list:
                continue
            kind = eval(ast.unparse(member.returns), names)  # noqa: S307 - of our own stub.
            value = getattr(held, member.name)
            assert fits(value, kind), f"{name}.{member.name}: {value!r} is no {kind}"
            said = re.search(r"Shape \[(.+?)\]", ast.get_docstring(member))
            for shape in shapes(value):
                sides = said[1].split(", ")
                assert len(sides) == len(shape), f"{name}.{member.name}: {shape}"
                assert all(not side.isdigit() or int(side) == at for side, at in zip(sides, shape))
            visited.add(name)
    assert visited == set(classes)
