"""A run: opened, stepped, looked at, given orders, finished; and what parts of one's own are."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, Self, cast

import numpy as np
from numpy.typing import ArrayLike

from . import _boresight
from . import scenario as scenarios
from ._boresight import Picture, Plant, PointingInput
from .errors import OrderError


class PointingLaw(Protocol):
    """A pointing law. It is made for a `Plant` by what `Simulation(laws=...)` names, such as its class.

    It may have `lead_s`, how far ahead of a tick's start the line of sight is to be predicted [s], and `rest()`, called
    once when the station stops following a target.
    """

    def command(self, at: PointingInput) -> tuple[ArrayLike, ArrayLike]:
        """The commands of one tick: rates of azimuth and elevation [rad/s], and deflection right and up [rad]."""


class Detector(Protocol):
    """A detector. Besides `detect` it may have

    - `classes`: names, by their labels; ("uav",) without it. Bird, aeroplane, helicopter, balloon and other are no UAVs;
    - `start_score`: a detection of this score counts by itself (0.5);
    - `weak_score`: one of a lower score goes on with a track; below this one it is dropped (0.25);
    - `neutral_score`: the score that speaks neither for a UAV nor against it (0.289);
    - `roi_px`: side of the square about the target in which it looks for that [px]; None: in all that is read;
    - `wants_pictures`: False for one that reads no pixels.
    """

    def detect(self, picture: Picture) -> ArrayLike:
        """What is in the picture: rows of x0, y0, x1, y1 in its pixels, score (0 to 1) and, if wanted, label."""


class Simulation(_boresight.Simulation):
    """A run of a scenario, or of a recording, whose run is made again.

    Args:
        scenario: a scenario file (`.toml`) or a recording (`.mcap`), shipped scenarios being found from anywhere; or a
            `Scenario`, or a dictionary of its tables.
        seed: another seed than the scenario's.
        pictures: whether cameras render. By default they do unless the scenario's detector is the truth.
        record: a folder for recording, summary and report; without one nothing is written.
        threads: worker threads; they change no result.
        laws: pointing laws by name; each is called with a `Plant` and gives a `PointingLaw`. A scenario names one as
            `controller.preset`, an order as `law`.
        detectors: detectors by name; a scenario names one as `detector.kind`.
        set: changes to the scenario by dotted path: `{"weather.visibility_m": 5000}`.
        **overrides: the same, two underscores for a dot: `weather__visibility_m=5000`.

    Raises:
        ScenarioError: the scenario cannot be read or is not valid; the line names the place and the mend.
        RecordingError: the recording cannot be read.
        BoresightError: the run cannot be set up.

    It is its own context manager, which finishes the run at its end. A run belongs to one thread at a time; several run
    side by side, one a thread, and the interpreter's lock is let go while they step.
    """

    def __new__(
        cls,
        scenario: str | os.PathLike[str] | scenarios.Scenario | Mapping[str, Any],
        *,
        seed: int | None = None,
        pictures: bool | None = None,
        record: str | os.PathLike[str] | None = None,
        threads: int | None = None,
        laws: Mapping[str, Callable[[Plant], PointingLaw]] | None = None,
        detectors: Mapping[str, Detector] | None = None,
        set: Mapping[str, Any] | None = None,
        **overrides: Any,
    ) -> Self:
        changes = dict(set or {})
        changes.update((key.replace("__", "."), value) for key, value in overrides.items())
        if isinstance(scenario, Mapping):
            scenario = scenarios.Scenario.from_dict(scenario)
        text = None
        if isinstance(scenario, scenarios.Scenario):
            text, scenario = scenario.text, scenario.folder
        run = super().__new__(
            cls,
            scenario,
            text,
            seed,
            [f"{path}={scenarios.value(value)}" for path, value in changes.items()],
            pictures,
            record,
            threads,
            dict(laws or {}),
            dict(detectors or {}),
        )
        return cast(Self, run)

    def station(self, name: str | None = None) -> _boresight.Station:
        """The station of a name; without one the first."""
        stations = self.stations
        for station in stations:
            if name is None or station.name == name:
                return station
        names = ", ".join(station.name for station in stations)
        raise ValueError(f"no station '{name}'; there is {names}")

    def give(self, **order: Any) -> None:
        """Gives an order to the station that it names as `station`, or to every one.

        It holds what an `[[operator]]` table of a scenario holds: one of `designate`, `track`, `fire`, `slew_deg`, `law`,
        `gains`, `weather`, `drive`, `camera`, `fly`; without any the choice of the target goes back to the tracker. It counts from its
        `t_s` [s] on, or from the next tick.

        Raises:
            OrderError: nobody can obey it.
        """
        try:
            text = json.dumps({"t_s": 0.0, **order}, default=_plain, allow_nan=False)
        except ValueError as error:
            raise OrderError(f"order: {error}; give finite numbers") from None
        # As TOML, whose numbers are read bit for bit.
        self._give(scenarios.document(json.loads(text, object_hook=_given)))

    def drive(
        self,
        rates_radps: ArrayLike | None = None,
        mirror_rad: ArrayLike | None = None,
        station: str | None = None,
    ) -> None:
        """Drives gimbal and mirror from outside, in place of the pointing law, until another such order.

        Args:
            rates_radps: rates of azimuth and elevation relative to the base [rad/s]; None: as the law commands.
            mirror_rad: deflection of the line of sight right and up [rad]; None: as the law commands.
            station: name of the station; every one without it.
        """
        self._drive(
            None if rates_radps is None else np.degrees(np.asarray(rates_radps, dtype=float)).tolist(),
            None if mirror_rad is None else (1e6 * np.asarray(mirror_rad, dtype=float)).tolist(),
            station,
        )

    def summary(self) -> dict[str, Any]:
        """The run summed up as far as it went, as `summary.json` has it; nothing is written."""
        return cast(dict[str, Any], json.loads(self._summary()))

    def finish(self) -> dict[str, Any] | None:
        """Ends the run where it is: closes the recording and writes summary and report beside it, if it has a folder.

        Returns the summary; None where the run was finished before.
        """
        text = self._finish()
        return None if text is None else json.loads(text)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.finish()


def _given(table: dict[str, Any]) -> dict[str, Any]:
    """What of a table is given."""
    return {key: value for key, value in table.items() if value is not None}


def _plain(value: Any) -> Any:
    """Arrays and their numbers, for JSON."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError(f"{value!r} has no place in an order")
