#!/usr/bin/env python3
"""Trains many rows at once on a machine that is lent for minutes: unpacks the parts of `pack.py`, measures how fast each
row learns beside the others, gives each as many steps as the time allows, trains, and exports.

Called again with the same --work it goes on where it was stopped; more --parts may join before the first call trains.
Exported models and logs go to --out.
"""

import argparse
import csv
import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import models
import pack

HERE = Path(__file__).resolve().parent
DFINE = {"batch": 64, "lr": 1.2e-3, "warm-up": 300}
PLAIN = {"batch": 64, "lr": 4e-3, "warm-up": 200}


def command(row: str, folder: Path, steps: int, args: argparse.Namespace) -> list[str]:
    settings = DFINE if row.startswith("d-fine") else PLAIN
    options = [f"--{k}={v if args.batch is None or k != 'batch' else args.batch}" for k, v in settings.items()]
    start = args.init / f"{row}.pt" if args.init else None
    options += [f"--init={start}"] if start and start.exists() else []
    options += [f"--steps={steps}", f"--crop={args.crop}", f"--workers={args.workers}", "--threads=1", "--log-every=20", "--save-every=200"]
    options += ["--bf16"] if args.bf16 else []
    return [sys.executable, str(HERE / "train.py"), "--data", str(args.work / "set"), "--model", row, "--out", str(folder), "--resume", *options]


def together(commands: dict[str, list[str]], seconds: float, logs: Path) -> dict[str, int]:
    """Runs all commands at once; after `seconds` they are asked to save and stop. Their exit codes."""
    logs.mkdir(parents=True, exist_ok=True)
    files = {row: (logs / f"{row}.txt").open("a") for row in commands}
    runs = {row: subprocess.Popen(c, stdout=files[row], stderr=subprocess.STDOUT) for row, c in commands.items()}
    end = time.monotonic() + seconds
    while time.monotonic() < end and any(run.poll() is None for run in runs.values()):
        time.sleep(0.5)
    for run in runs.values():
        if run.poll() is None:
            run.send_signal(signal.SIGTERM)
    codes = {row: run.wait() for row, run in runs.items()}
    for file in files.values():
        file.close()
    return codes


def rate(folder: Path) -> float:
    """Steps a second between the first and the last row of a log; the first steps compile and warm up."""
    with (folder / "log.csv").open() as file:
        rows = [(int(r["step"]), float(r["seconds"])) for r in csv.DictReader(file)]
    (first, begin), (last, end) = rows[0], rows[-1]
    return (last - first) / (end - begin) if last > first else last / max(end, 1e-9)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", type=Path, nargs="+", required=True, help="files by pack.py")
    parser.add_argument("--work", type=Path, required=True, help="folder of set and runs, kept between calls")
    parser.add_argument("--out", type=Path, required=True, help="folder for exported models and logs")
    parser.add_argument("--minutes", type=float, default=9.0, help="of this call")
    parser.add_argument("--total-minutes", type=float, default=26.0, help="of training in all calls together")
    parser.add_argument("--measure-s", type=float, default=45.0, help="time for measuring the rows' speed, in the first call")
    parser.add_argument("--rows", nargs="+", default=list(models.NAMES), choices=models.NAMES)
    parser.add_argument("--init", type=Path, help="folder of ROW.pt to start from, such as from_onnx.py makes")
    parser.add_argument("--crop", type=int, default=256)
    parser.add_argument("--batch", type=int, help="instead of the rows' own")
    parser.add_argument("--workers", type=int, default=2, help="processes a row that make pictures")
    parser.add_argument("--bf16", action="store_true", help="see train.py")
    args = parser.parse_args()
    begin = time.monotonic()
    left = lambda: begin + 60 * args.minutes - time.monotonic()  # noqa: E731
    args.work.mkdir(parents=True, exist_ok=True)
    args.out.mkdir(parents=True, exist_ok=True)
    if not (args.work / "set" / "train" / "annotations.json").exists():
        pack.unpack(args.parts, args.work / "set")
        from data import Frames

        frames = Frames(args.work / "set" / "train")  # decodes once for all rows
        print(f"{len(frames)} windows unpacked after {time.monotonic() - begin:.0f} s", flush=True)
    plan = args.work / "plan.json"
    if not plan.exists():
        trial = args.work / "trial"
        shutil.rmtree(trial, ignore_errors=True)
        codes = together({row: command(row, trial / row, 10**6, args) for row in args.rows}, args.measure_s, args.out / "logs-trial")
        steps = {}
        for row in args.rows:
            if not (trial / row / "log.csv").exists():
                print(f"{row}: ended with {codes[row]} before its first row of the log; see {args.out / 'logs-trial'}", flush=True)
                continue
            steps[row] = max(20, int(0.92 * rate(trial / row) * 60 * args.total_minutes))
        plan.write_text(json.dumps(steps))
        print(f"steps: {steps}", flush=True)
    steps = json.loads(plan.read_text())
    runs = args.work / "runs"
    codes = together({row: command(row, runs / row, n, args) for row, n in steps.items()}, max(5.0, left() - 40), args.out / "logs")
    for row in steps:
        if not (runs / row / "last.pt").exists():
            print(f"{row}: ended with {codes[row]}, no checkpoint", flush=True)
            continue
        shutil.copy(runs / row / "log.csv", args.out / "logs" / f"{row}.csv")
        model = args.out / f"{row}.onnx"
        done = subprocess.run([sys.executable, str(HERE / "export.py"), str(runs / row / "last.pt"), "--out", str(model)], capture_output=True, text=True)
        print(row, (done.stdout or done.stderr).strip().splitlines()[-1:], flush=True)


if __name__ == "__main__":
    main()
