"""The package's exceptions: each carries the one line that the program prints."""


class BoresightError(Exception):
    """What keeps a simulation from being opened, going on or being finished."""


class ScenarioError(BoresightError):
    """A scenario that cannot be read or is not valid; names the place and the mend."""


class OrderError(BoresightError):
    """An order that nobody can obey; names the value and what would be right."""


class RecordingError(BoresightError):
    """A recording that cannot be read."""


for _error in (BoresightError, ScenarioError, OrderError, RecordingError):
    # Tracebacks name them as a program catches them.
    _error.__module__ = "boresight"
