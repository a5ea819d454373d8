"""The driver: ships program and files once a node, makes shards, gathers their journals, merges them.

A shard's task returns its journal. Ray runs the task again elsewhere when its node is lost. Which node made a shard, and when,
leaves no trace: on nodes of one kind (processor, C library) the table is that of one machine, bit for bit.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import stat
import subprocess
import tarfile
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

import ray

#: How often a shard is made again when its node is lost.
RETRIES = 20
#: What ``ray.init`` needs for :func:`sweep`: it ships this package to the workers.
RUNTIME_ENV = {"py_modules": [str(Path(__file__).parent)]}


class SweepError(Exception):
    """What keeps a sweep from its table, in a line."""


@dataclass(frozen=True)
class Swept:
    """How it went."""

    #: The program's line on it.
    text: str
    #: 0 where every run has its figures, 1 where some failed.
    exit_code: int


@dataclass(frozen=True)
class Bundle:
    """What a node needs, as a tar file: the program, the experiment, its scenario, further files."""

    #: The tar file.
    data: bytes
    #: Name of its folder on a node.
    name: str
    #: The experiment in it.
    experiment: str

    @staticmethod
    def of(experiment: Path, binary: Path, more: list[Path]) -> Bundle:
        """Packs files under their paths from the working directory."""
        root = Path.cwd()
        try:
            description = tomllib.loads(experiment.read_text())
        except (OSError, tomllib.TOMLDecodeError) as error:
            raise SweepError(f"{experiment}: {error}") from error
        scenario = experiment.parent / str(description.get("scenario", ""))
        if not binary.is_file():
            raise SweepError(f"{binary}: is no file: name the program with --binary")
        buffer, named = io.BytesIO(), []
        # What a link leads to is not on the node: the file itself goes.
        with tarfile.open(fileobj=buffer, mode="w", dereference=True) as tar:
            for path in [experiment, scenario, *more]:
                inside = Path(os.path.relpath(path, root))
                if inside.parts[:1] == ("..",):
                    # The way to the working directory may hold links.
                    inside = Path(os.path.relpath(path.parent.resolve() / path.name, root))
                if inside.parts[:1] == ("..",):
                    raise SweepError(f"{path}: lies outside {root}; start in a folder above all files")
                if not path.exists():
                    raise SweepError(f"{path}: is not there")
                tar.add(path, arcname=str(Path("files") / inside))
                named.append(inside)
            tar.add(binary, arcname="boresight")
        data = buffer.getvalue()
        name = f"boresight-{hashlib.sha256(data).hexdigest()[:16]}"
        return Bundle(data, name, str(named[0]))

    def unpacked(self) -> Path:
        """The folder with its files on this node; the first task that needs it unpacks it."""
        folder = Path(tempfile.gettempdir()) / f"{self.name}-{os.getuid()}"
        if not os.path.lexists(folder):
            # Whole or not at all: several tasks may come at once.
            fresh = Path(tempfile.mkdtemp(prefix=f"{self.name}-"))
            with tarfile.open(fileobj=io.BytesIO(self.data)) as tar:
                tar.extractall(fresh, filter="data")
            try:
                fresh.rename(folder)
            except OSError:
                shutil.rmtree(fresh)  # Another task was faster.
        # Others may write there too: what is not this user's alone is not started.
        found = os.lstat(folder)
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
            raise SweepError(f"{folder}: is not this user's own: delete it, or set TMPDIR")
        return folder


@ray.remote(num_cpus=1, max_retries=RETRIES)
def make(bundle: Bundle, number: int, of: int, before: bytes) -> bytes:
    """Makes a shard, but for what its journal ``before`` has; the journal."""
    folder = bundle.unpacked()
    with tempfile.TemporaryDirectory() as out:
        path = Path(out) / journal(number, of)
        if before:
            path.write_bytes(before)
        command = [folder / "boresight", "sweep", bundle.experiment, "--out", out]
        command += ["--shard", f"{number}/{of}", "--jobs", "1"]
        done = subprocess.run(command, cwd=folder / "files", capture_output=True, text=True)
        # With 1 it says that runs failed: the journal says which, and why.
        if done.returncode not in (0, 1):
            raise SweepError(f"shard {number}/{of}: {done.stderr.strip()}")
        return path.read_bytes()


def journal(number: int, of: int) -> str:
    """Name of a shard's journal."""
    return f"runs-{number}-of-{of}.jsonl"


def known_shards(out: Path) -> int | None:
    """Of how many shards the journals in ``out`` are; none without journals."""
    counts = {int(path.stem.rsplit("-", 1)[1]) for path in out.glob("runs-*-of-*.jsonl")}
    if len(counts) > 1:
        raise SweepError(f"{out}: has journals of {sorted(counts)} shards: say with --shards which to go on with")
    return counts.pop() if counts else None


def before(path: Path) -> bytes | None:
    """The journal of a shard that is still to be made, empty where there is none; ``None`` where all its runs succeeded."""
    if not path.exists():
        return b""
    data = path.read_bytes()
    failed: dict[int, bool] = {}
    for line in data.splitlines()[1:]:
        try:
            run = json.loads(line)
            # A run that succeeded at last is over.
            failed[run["run"]] = failed.get(run["run"], True) and "Err" in run["result"]
        except (ValueError, KeyError, TypeError):
            return data  # A line that was cut: its run is made again.
    return data if any(failed.values()) else None


def sweep(experiment: Path, out: Path, binary: Path, shards: int, more: list[Path] = ()) -> Swept:
    """Makes all shards of which ``out`` has no journal or failed runs, and the table; what the program says of it.

    Needs a running ``ray``, started with :data:`RUNTIME_ENV`. Raises :class:`SweepError` with the program's own sentence.
    """
    # A name alone would be looked for in the PATH.
    binary = binary.resolve()
    bundle = ray.put(Bundle.of(experiment, binary, list(more)))
    out.mkdir(parents=True, exist_ok=True)
    known = {number: before(out / journal(number, shards)) for number in range(1, shards + 1)}
    waiting = {make.remote(bundle, n, shards, data): n for n, data in known.items() if data is not None}
    while waiting:
        ready, _ = ray.wait(list(waiting))
        for task in ready:
            number = waiting.pop(task)
            try:
                data = ray.get(task)
            except ray.exceptions.RayTaskError as error:
                raise SweepError(str(error.cause)) from error
            except ray.exceptions.RayError as error:
                raise SweepError(f"shard {number}/{shards}: {error}") from error
            # Whole or not at all: a driver that is killed goes on with what is whole.
            part = out / f"{journal(number, shards)}.part"
            part.write_bytes(data)
            part.rename(out / journal(number, shards))
            print(f"{shards - len(waiting)} of {shards} shards", flush=True)
    command = [binary, "sweep", experiment, "--out", out, "--merge"]
    merged = subprocess.run(command, capture_output=True, text=True)
    if merged.returncode not in (0, 1):
        raise SweepError(merged.stderr.strip())
    return Swept(merged.stdout.strip(), merged.returncode)
