#!/usr/bin/env python3
"""Trains and evaluates every row of the paper's Table 1 on the same number of crops: `table1.md` and `table1.json`.

A row is a model, or a model and the share of its crops that are of real pictures: `boresight-p2-roi@0`, `boresight-p2-roi@1`,
`boresight-p2-roi@0.5` are rendered alone, real alone, and both.
Stopped at any time, the same command goes on: finished rows are kept, a row in the making resumes. Rows are made seed by
seed, so that a table of fewer seeds is whole.
"""

import argparse
import hashlib
import json
import shutil
import statistics
import subprocess
import sys
from pathlib import Path

import torch

import models

HERE = Path(__file__).resolve().parent
# D-FINE diverges at the rate that suits the convolutional rows, and wants smaller batches for the same number of crops.
DFINE = {"batch": 8, "lr": 8e-4, "warm-up": 300}
PLAIN = {"batch": 16, "lr": 2e-3, "warm-up": 200}
COLUMNS = (  # heading, keys in detector.json, digits
    ("mAP@50", ("map50",), 3),
    ("mAP@50–95", ("map50_95",), 3),
    ("recall at 0.1 false alarms", ("recall_at_fppi_0_1",), 3),
    ("miss distance mean [px]", ("miss_distance_px", "mean"), 2),
    ("rms [px]", ("miss_distance_px", "rms"), 2),
    ("class right", ("class_accuracy",), 3),
    ("M parameters", ("params",), 2),
    ("GFLOPs", ("gflops",), 1),
    ("frames/s", ("frames_per_s",), 1),
)
# Of each source, where the evaluated pictures name theirs.
BY_SOURCE = (("mAP@50", "map50"), ("recall at 0.1 false alarms", "recall_at_fppi_0_1"))


def model_and_share(row: str) -> tuple[str, float | None]:
    """Model and share of real crops of a row; the share is the set's own where the row says none."""
    model, at, share = row.partition("@")
    if model not in models.NAMES:
        raise SystemExit(f"--rows {row}: no such model; give {', '.join(models.NAMES)}, perhaps with @ and a share of real crops")
    try:
        share = float(share) if at else None
    except ValueError:
        share = -1.0
    if share is not None and not 0 <= share <= 1:
        raise SystemExit(f"--rows {row}: give a share of real crops from 0 to 1 after the @")
    return model, share


def run(command: list, log: Path) -> None:
    """Runs a command with its output in `log`; a failure shows its end."""
    with log.open("a") as file:
        code = subprocess.run([str(c) for c in command], stdout=file, stderr=subprocess.STDOUT).returncode
    if code:
        raise SystemExit(f"{' '.join(map(str, command))}\nended with {code}; the end of {log}:\n" + "\n".join(log.read_text().splitlines()[-8:]))


def checked(folder: Path, wanted: dict) -> dict:
    """The checkpoint of a run that is finished and was made as wanted."""
    state = torch.load(folder / "last.pt", map_location="cpu", weights_only=True)
    other = [k for k, v in wanted.items() if state["recipe"].get(k) != v]
    if other:
        raise SystemExit(f"{folder}: made with another {', '.join(other)}; give the same, another --out, or remove it")
    if state["step"] != wanted["steps"]:
        raise SystemExit(f"{folder}: stopped at step {state['step']} of {wanted['steps']}; run the same command to go on")
    return state


def make(row: str, seed: int, args: argparse.Namespace) -> dict:
    """Trains, exports and evaluates a row with one seed, as far as it is not done yet."""
    model_name, share = model_and_share(row)
    folder = args.out / f"{row}-{seed}"
    result = folder / "eval" / "detector.json"
    settings = DFINE if row.startswith("d-fine") else PLAIN
    digest = hashlib.sha256((args.data / "train" / "annotations.json").read_bytes()).hexdigest()
    steps = args.crops // settings["batch"]
    wanted = {"model": model_name, "seed": seed, "steps": steps, "crop": args.crop, "bf16": args.bf16, "data": digest}
    wanted |= {k.replace("-", "_"): v for k, v in settings.items()} | ({} if share is None else {"real": share})
    if not result.exists():
        folder.mkdir(parents=True, exist_ok=True)
        options = [f"--{k}={v}" for k, v in settings.items()] + [f"--steps={steps}", f"--keep-every={max(1, steps // 8)}"]  # for figure 7
        options += [f"--crop={args.crop}", f"--seed={seed}", f"--threads={args.threads}", f"--workers={args.workers}"]
        options += ["--bf16"] if args.bf16 else []
        options += [] if share is None else [f"--real={share}"]
        model = folder / "model.onnx"
        run([sys.executable, HERE / "train.py", "--data", args.data, "--model", model_name, "--out", folder, "--resume", *options], folder / "log.txt")
        checked(folder, wanted)
        run([sys.executable, HERE / "export.py", folder / "last.pt", "--out", model], folder / "log.txt")
        evaluate = [args.boresight, "eval", "detector", "--model", model, "--data", args.data / "val", "--threads", args.threads]
        run([*evaluate, "--out", folder / "eval.part"], folder / "log.txt")
        (folder / "eval.part").replace(folder / "eval")
    state = checked(folder, wanted)
    figures = json.loads(result.read_text())
    return {"row": row, "seed": seed, "minutes": state["seconds"] / 60, "machine": state["machine"], "recipe": state["recipe"], "figures": figures}


def value(figures: dict, keys: tuple[str, ...]) -> float | None:
    for key in keys:
        figures = (figures or {}).get(key)
    return figures


def cell(values: list[float | None], digits: int, scale: float = 1.0) -> str:
    """Mean, and the standard deviation where there are several seeds."""
    known = [v * scale for v in values if v is not None]
    if not known:
        return "–"
    mean = f"{statistics.fmean(known):.{digits}f}"
    return mean if len(known) < 2 or max(known) == min(known) else f"{mean} ± {statistics.stdev(known):.{digits}f}"


def table(results: list[dict], args: argparse.Namespace) -> str:
    sources = sorted({source for r in results for source in r["figures"].get("by_source", {})})
    of_sources = [(f"{source}: {name}", ("by_source", source, key), 3) for source in sources for name, key in BY_SOURCE]
    all_columns = (*COLUMNS, *of_sources)
    head = ["row", "seeds", "minutes", *(c[0] for c in all_columns)]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for row in args.rows:
        mine = [r for r in results if r["row"] == row]
        if mine:
            cells = [row, str(len(mine)), cell([r["minutes"] for r in mine], 0)]
            cells += [cell([value(r["figures"], keys) for r in mine], digits, 1e-6 if keys == ("params",) else 1.0) for _, keys, digits in all_columns]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder made by `boresight dataset`")
    parser.add_argument("--out", type=Path, required=True, help="folder of the runs and of the table")
    parser.add_argument("--crops", type=int, default=12_000, help="pictures that each row learns from")
    parser.add_argument("--crop", type=int, default=192, help="their side [px]")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--rows", nargs="+", default=list(models.NAMES), help="models, perhaps with @ and a share of real crops")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--bf16", action="store_true", help="see train.py")
    parser.add_argument("--boresight", default=shutil.which("boresight") or "boresight", help="the program that evaluates")
    args = parser.parse_args()
    for row in args.rows:
        model_and_share(row)
    args.out.mkdir(parents=True, exist_ok=True)
    results = []
    for seed in args.seeds:
        for row in args.rows:
            results.append(make(row, seed, args))
            (args.out / "table1.json").write_text(json.dumps(results, indent=1))
            (args.out / "table1.md").write_text(table(results, args))
            print(f"{row}, seed {seed}: mAP@50 {results[-1]['figures']['map50']:.3f}", flush=True)
    print(table(results, args))


if __name__ == "__main__":
    main()
