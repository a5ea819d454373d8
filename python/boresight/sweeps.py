"""Sweeps: an experiment file over its factors and seeds."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .errors import BoresightError

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Swept:
    """What a sweep left."""

    #: Its folder: `table.csv`, `failed.csv`, a page and more.
    folder: Path
    #: 0 where every run has its figures, 1 where some failed.
    exit_code: int

    def table(self, name: str = "table") -> pandas.DataFrame:
        """One of its tables as a pandas table; needs `pip install boresight[tables]`."""
        import pandas

        path = self.folder / f"{name}.csv"
        if not path.exists():
            there = ", ".join(sorted(file.stem for file in self.folder.glob("*.csv")))
            raise BoresightError(f"{path}: is not there; the sweep left {there}")
        return pandas.read_csv(path)


def sweep(
    experiment: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    jobs: int | None = None,
    arguments: Sequence[str] = (),
) -> Swept:
    """Runs an experiment file, as `boresight sweep` does, in a process of its own: it goes on where one was stopped.

    Args:
        experiment: the file.
        out: folder for tables and page.
        jobs: runs side by side; as many as there are cores without it.
        arguments: further arguments of the command.

    Raises:
        BoresightError: with the program's own line.
    """
    words = [sys.executable, "-m", "boresight", "sweep", os.fspath(experiment), "--out", os.fspath(out)]
    if jobs is not None:
        words += ["--jobs", str(jobs)]
    done = subprocess.run([*words, *arguments], stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode not in (0, 1):
        lines = done.stderr.strip().splitlines() or [f"boresight sweep ended with {done.returncode}"]
        raise BoresightError(lines[-1].removeprefix("error: "))
    return Swept(Path(out), done.returncode)
