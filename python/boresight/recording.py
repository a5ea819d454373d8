"""Recordings as tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from . import _boresight

if TYPE_CHECKING:
    import pandas


class Recording(_boresight.Recording):
    """The recording of a run (`run.mcap`): what it says of the run, its topics, and their messages as tables."""

    def columns(self, topic: str) -> dict[str, list[Any]]:
        """A topic as columns of equal length. `t_s` is the time [s]; fields within fields are joined by dots.

        A message that lacks a field has None there.
        """
        rows = [{"t_s": t_s, **_flat(fields)} for t_s, fields in self.messages(topic)]
        names = dict.fromkeys(name for row in rows for name in row)
        return {name: [row.get(name) for row in rows] for name in names}

    def table(self, topic: str) -> pandas.DataFrame:
        """A topic as a pandas table, a message a row; needs `pip install boresight[tables]`."""
        import pandas

        return pandas.DataFrame(self.columns(topic))


def _flat(fields: dict[str, Any], before: str = "") -> dict[str, Any]:
    """Fields within fields as one level; lists stay lists.

    >>> _flat({"mount": {"az": 1.0}, "law": "tuned"})
    {'mount.az': 1.0, 'law': 'tuned'}
    """
    flat: dict[str, Any] = {}
    for name, value in fields.items():
        if isinstance(value, dict):
            flat.update(_flat(value, f"{before}{name}."))
        else:
            flat[before + name] = value
    return flat
