"""Boresight: a deterministic simulator of urban laser counter-UAV systems.

It simulates; it drives no real mount, camera or laser.

>>> import boresight
>>> with boresight.Simulation("scenarios/urban_intercept.toml", detector__kind="truth", seed=7) as run:
...     run.run_until(0.5)
...     run.stations[0].state
False
'precise'
"""

from . import _data

_data.tell()

from ._boresight import (  # noqa: E402 - the module reads what was told above.
    Air,
    Beam,
    Camera,
    Event,
    Frame,
    Mount,
    Picture,
    Plant,
    PointingInput,
    Seen,
    Snapshot,
    Station,
    Track,
    Uav,
    __version__,
)
from .errors import BoresightError, OrderError, RecordingError, ScenarioError  # noqa: E402
from .recording import Recording  # noqa: E402
from .scenario import Scenario  # noqa: E402
from .simulation import Detector, PointingLaw, Simulation  # noqa: E402
from .sweeps import Swept, sweep  # noqa: E402

__all__ = [
    "Air",
    "Beam",
    "BoresightError",
    "Camera",
    "Detector",
    "Event",
    "Frame",
    "Mount",
    "OrderError",
    "Picture",
    "Plant",
    "PointingInput",
    "PointingLaw",
    "Recording",
    "RecordingError",
    "Scenario",
    "ScenarioError",
    "Seen",
    "Simulation",
    "Snapshot",
    "Station",
    "Swept",
    "Track",
    "Uav",
    "__version__",
    "sweep",
]
