"""The driver: ships program and files once a node, makes shards, gathers their journals, merges them.

A shard's task returns its journal. Ray runs the task again elsewhere when its node is lost. Which node made a shard, and when,
leaves no trace: the table is that of one machine, bit for bit.
"""

from __future__ import annotations

import hashlib
import io
import os
import subprocess
import tarfile
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

import ray

#: How often a shard is made again when its node is lost.
RETRIES = 20


class SweepError(Exception):
    """What keeps a sweep from its table, in a line."""


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
        buffer = io.BytesIO()
        with tarfile.open(fileobj=buffer, mode="w") as tar:
            for path in [experiment, scenario, *more]:
                inside = Path(os.path.relpath(path.resolve(), root))
                if inside.parts[:1] == ("..",):
                    raise SweepError(f"{path}: lies outside {root}; start in a folder above all files")
                if not path.exists():
                    raise SweepError(f"{path}: is not there")
                tar.add(path, arcname=str(Path("files") / inside))
            tar.add(binary, arcname="boresight")
        data = buffer.getvalue()
        name = f"boresight-{hashlib.sha256(data).hexdigest()[:16]}"
        return Bundle(data, name, os.path.relpath(experiment.resolve(), root))

    def unpacked(self) -> Path:
        """The folder with its files on this node; the first task that needs it unpacks it."""
        folder = Path(tempfile.gettempdir()) / self.name
        if not folder.exists():
            # Whole or not at all: several tasks may come at once.
            fresh = Path(tempfile.mkdtemp(prefix=f"{self.name}-"))
            with tarfile.open(fileobj=io.BytesIO(self.data)) as tar:
                tar.extractall(fresh, filter="data")
            try:
                fresh.rename(folder)
            except OSError:
                pass  # Another task was faster.
        return folder


@ray.remote(num_cpus=1, max_retries=RETRIES)
def make(bundle: Bundle, number: int, of: int) -> bytes:
    """Makes a shard; its journal."""
    folder = bundle.unpacked()
    with tempfile.TemporaryDirectory() as out:
        command = [folder / "boresight", "sweep", bundle.experiment, "--out", out]
        command += ["--shard", f"{number}/{of}", "--jobs", "1"]
        done = subprocess.run(command, cwd=folder / "files", capture_output=True, text=True)
        if done.returncode != 0:
            raise SweepError(f"shard {number}/{of}: {done.stderr.strip()}")
        return (Path(out) / journal(number, of)).read_bytes()


def journal(number: int, of: int) -> str:
    """Name of a shard's journal."""
    return f"runs-{number}-of-{of}.jsonl"


def sweep(experiment: Path, out: Path, binary: Path, shards: int, more: list[Path] = ()) -> str:
    """Makes all shards that ``out`` has no journal of, and the table; what the program says of it.

    Needs a running ``ray``. Raises :class:`SweepError` with the program's own sentence.
    """
    bundle = ray.put(Bundle.of(experiment, binary, list(more)))
    out.mkdir(parents=True, exist_ok=True)
    left = [n for n in range(1, shards + 1) if not (out / journal(n, shards)).exists()]
    waiting = {make.remote(bundle, number, shards): number for number in left}
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
    if merged.returncode != 0:
        raise SweepError(merged.stderr.strip())
    return merged.stdout.strip()
