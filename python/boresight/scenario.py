"""Scenarios that a program makes: from text, or from dictionaries."""

from __future__ import annotations

import datetime
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from . import _data


@dataclass(frozen=True)
class Scenario:
    """A scenario that is no file.

    >>> import boresight
    >>> scenario = boresight.Scenario.from_text(Path("scenarios/urban_intercept.toml").read_text())
    >>> with boresight.Simulation(scenario, detector__kind="truth") as run:
    ...     run.run_until(0.5)
    False
    """

    #: The scenario as TOML.
    text: str
    #: Relative paths in it lead on from here; by default from the package's shipped scenarios.
    folder: Path = field(default_factory=_data.scenarios)

    @classmethod
    def from_text(cls, text: str, folder: str | os.PathLike[str] | None = None) -> Scenario:
        """A scenario from its TOML. Whether it is valid shows when a `Simulation` opens it.

        Args:
            text: what a scenario file holds.
            folder: where relative paths in it lead on from; without one from the package's shipped scenarios.
        """
        return cls(text) if folder is None else cls(text, Path(folder))

    @classmethod
    def from_dict(cls, tables: Mapping[str, Any], folder: str | os.PathLike[str] | None = None) -> Scenario:
        """The same from dictionaries and lists, such as `tomllib.loads` gives; arrays are lists of numbers.

        Raises:
            TypeError: it holds what TOML has no place for.
        """
        return cls.from_text(document(tables), folder)


def value(held: Any) -> str:
    """A value as TOML has it in one line.

    >>> value({"kind": "straight", "start_enu_m": [0, 1.5, 2]})
    '{ kind = "straight", start_enu_m = [0, 1.5, 2] }'
    """
    if isinstance(held, (np.ndarray, np.generic)):
        held = held.tolist()
    if isinstance(held, bool):
        return "true" if held else "false"
    if isinstance(held, str):
        return json.dumps(held, ensure_ascii=False)
    if isinstance(held, (int, float)):
        return repr(held)
    if isinstance(held, (datetime.datetime, datetime.date)):
        return held.isoformat()
    if isinstance(held, os.PathLike):
        return value(os.fspath(held))
    if isinstance(held, Mapping):
        fields = (f"{_key(key)} = {value(inner)}" for key, inner in held.items())
        return "{ " + ", ".join(fields) + " }"
    if isinstance(held, Sequence):
        return "[" + ", ".join(map(value, held)) + "]"
    raise TypeError(f"{held!r} has no place in a scenario; give numbers, text, lists or dictionaries")


def document(tables: Mapping[str, Any], at: str = "") -> str:
    r"""Dictionaries as a document of TOML: a table each, so that an error names a line of a few words.

    >>> document({"seed": 7, "site": {"altitude_m": 4.0}, "uavs": [{"name": "a"}]})
    'seed = 7\n\n[site]\naltitude_m = 4.0\n\n[[uavs]]\nname = "a"\n'
    """
    lines, below = "", ""
    for key, held in tables.items():
        name = at + _key(key)
        if isinstance(held, Mapping):
            below += f"\n[{name}]\n" + document(held, name + ".")
        elif isinstance(held, (list, tuple)) and held and all(isinstance(table, Mapping) for table in held):
            below += "".join(f"\n[[{name}]]\n" + document(table, name + ".") for table in held)
        else:
            lines += f"{_key(key)} = {value(held)}\n"
    return lines + below


def _key(key: object) -> str:
    """A key, quoted where it has to be."""
    name = str(key)
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)
