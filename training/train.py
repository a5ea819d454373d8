#!/usr/bin/env python3
"""Trains a detector on a data set of `boresight dataset`, on procedural pictures, or on both.

A run is a folder: `last.pt` (resumable), `log.csv`, `curves.svg`, with `--keep-every` `step-N.pt`. Stopped by SIGTERM, SIGINT or `--time-limit` it
saves first; `--resume` then goes on exactly as if it had not been stopped.
"""

import argparse
import csv
import hashlib
import json
import math
import os
import platform
import signal
import time
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # waiting threads leave the cores to the picture worker

import torch  # noqa: E402

import models  # noqa: E402
from data import Crops, Frames, false_alarms, loader  # noqa: E402

try:
    from plot import curves
except ImportError:  # a lent machine that reaches no network may lack matplotlib
    curves = None


LARGEST_CROP = 832  # [px] side that the bank of noise serves


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", nargs="+", default=["none"], help="folders with train/annotations.json, or none: procedural only")
    parser.add_argument("--model", default="boresight-p2", choices=models.NAMES)
    parser.add_argument("--steps", type=int, default=10_000)
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--lr", type=float, default=2e-3)
    parser.add_argument("--decay", type=float, default=1e-4, help="weight decay")
    parser.add_argument("--warm-up", type=int, default=200, help="steps of linear warm-up")
    parser.add_argument("--ema", type=float, default=0.999, help="decay of the averaged weights")
    parser.add_argument("--clip", type=float, default=10.0, help="largest norm of the gradient")
    parser.add_argument("--procedural", type=float, default=0.15, help="share of procedural pictures beside a data set")
    parser.add_argument("--real", type=float, help="share of the crops that are cut from real pictures (default: what the set's recipe says)")
    parser.add_argument("--hard", type=Path, help="false alarms by mine.py, to be cut out more often")
    parser.add_argument("--crop", type=int, default=256, help="side of a training picture, a multiple of 64 [px]")
    parser.add_argument("--bf16", action="store_true", help="multiply in bfloat16: half the time where the CPU or GPU has it in hardware")
    parser.add_argument("--out", type=Path, required=True, help="folder of the run")
    parser.add_argument("--resume", action="store_true", help="go on from OUT/last.pt where there is one")
    parser.add_argument("--init", type=Path, help="checkpoint whose averaged weights to start from")
    parser.add_argument("--threads", type=int, default=max(1, (os.cpu_count() or 2)))
    parser.add_argument("--workers", type=int, default=1, help="processes that make pictures; 0: in the training process")
    parser.add_argument("--time-limit", type=float, default=math.inf, help="save and stop after so many minutes")
    parser.add_argument("--save-every", type=int, default=500)
    parser.add_argument("--keep-every", type=int, default=0, help="also keep the weights of every so many steps, for figures.py; 0: do not")
    parser.add_argument("--log-every", type=int, default=50)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    return parser.parse_args()


def save(path: Path, state: dict) -> None:
    """Writes beside the file, then renames: a kill leaves the old checkpoint whole."""
    part = path.with_suffix(".part")
    with part.open("wb") as file:
        torch.save(state, file)
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


def learning_rate(step: int, args: argparse.Namespace) -> float:
    """Linear warm-up, then a cosine to 1 % of the peak."""
    if step < args.warm_up:
        return args.lr * (step + 1) / args.warm_up
    t = (step - args.warm_up) / max(1, args.steps - args.warm_up)
    return args.lr * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * min(t, 1))))


def load_weights(model: torch.nn.Module, path: Path) -> None:
    """Takes over every tensor whose name and shape fit, and the rows that both have of one with more or fewer classes;
    new classes keep their first weights."""
    given, own = torch.load(path, map_location="cpu", weights_only=True)["ema"], model.state_dict()
    fit = [k for k, v in given.items() if k in own and v.ndim and own[k].ndim == v.ndim and own[k].shape[1:] == v.shape[1:]]
    if not fit:
        raise SystemExit(f"{path}: no tensor fits {model.name}")
    # In which units D-FINE's heads move centres is not seen in their shapes.
    if any(k.endswith(".scale") and k not in given and any(g.startswith(k.removesuffix("scale")) for g in given) for k in own):
        raise SystemExit(f"{path}: its heads move centres in other units than today's; begin at an exported file (from_onnx.py)")
    with torch.no_grad():
        for k in fit:
            # The second look says the middle of the body in its last two rows, after the classes.
            tail = 2 if k.startswith("say.") and len(given[k]) != len(own[k]) else 0
            rows = min(len(given[k]), len(own[k])) - tail
            own[k][:rows] = given[k][:rows]
            own[k][len(own[k]) - tail :] = given[k][len(given[k]) - tail :]
    model.load_state_dict(own)
    print(f"{path}: {len(fit)} of {len(own)} tensors taken over")


def real_share(sets: list[str]) -> float:
    """The share of crops from real pictures that the recipe of the first of these sets that holds clips says; half of them where none does."""
    files = [Path(data) / "dataset.json" for data in sets]
    about = [json.loads(file.read_text()) for file in files if file.is_file()]
    return float(next((one["real_crops"] for one in about if one.get("real_clips") and "real_crops" in one), 0.5))


def groups(model: torch.nn.Module, decay: float) -> list[dict]:
    """Weights with decay; biases and normalisation without."""
    named = [p for p in model.parameters() if p.requires_grad]
    return [
        {"params": [p for p in named if p.ndim > 1], "weight_decay": decay},
        {"params": [p for p in named if p.ndim <= 1], "weight_decay": 0.0},
    ]


def rows_before(path: Path, step: int) -> list[dict]:
    """Rows of an earlier log up to a step."""
    if not path.exists():
        return []
    with path.open() as file:
        return [row for row in csv.DictReader(file) if int(row["step"]) <= step]


def main() -> None:
    args = arguments()
    torch.set_num_threads(args.threads)
    torch.manual_seed(args.seed)
    classes = list(models.CLASSES)
    # Two million numbers a second pass through a 256 x 256 net: channels last halves its time on CPUs.
    model = models.build(args.model, len(classes)).to(args.device, memory_format=torch.channels_last)
    if args.crop % 64 or not model.min_side_px <= args.crop <= LARGEST_CROP:
        raise SystemExit(f"--crop {args.crop}: give a multiple of 64 from {-(-model.min_side_px // 64) * 64} to {LARGEST_CROP}")
    try:
        frames = None if args.data == ["none"] else Frames(*(Path(data) / "train" for data in args.data))
    except (OSError, ValueError) as fault:
        raise SystemExit(str(fault)) from None
    if frames and frames.names != classes:
        raise SystemExit(f"{args.data[0]}: its categories are {', '.join(frames.names)}; expected {', '.join(classes)}, as procedural UAVs have")
    if args.hard and not frames:
        raise SystemExit("--hard: false alarms are of a data set; give --data")
    hard = false_alarms(args.hard, frames) if args.hard else None
    asked = args.real
    args.real = real_share(args.data) if asked is None else asked
    if not 0 <= args.real <= 1:
        raise SystemExit(f"--real {args.real}: give a share from 0 to 1")
    if frames and asked in (0, 1) and not (frames.real == asked).any():
        raise SystemExit(f"--real {args.real:g}: {', '.join(args.data)}: no {'real' if asked else 'rendered'} picture there; give another share, or leave it out")
    crops = Crops(frames, args.seed, args.procedural, size=args.crop, hard=hard, real=args.real)
    args.out.mkdir(parents=True, exist_ok=True)
    if args.init:
        load_weights(model, args.init)
    model.train()
    average = {k: v.detach().clone() for k, v in model.state_dict().items()}
    optimizer = torch.optim.AdamW(groups(model, args.decay), args.lr)
    # What decides the run's numbers; a resumed run must agree in these.
    recipe = {k: getattr(args, k) for k in ("model", "steps", "batch", "seed", "lr", "decay", "warm_up", "ema", "clip", "procedural", "real", "crop", "bf16")}
    recipe["data"] = "none" if frames is None else frames.digest
    recipe["hard"] = "none" if hard is None else hashlib.sha256(hard.tobytes()).hexdigest()
    first, spent_s, last = 0, 0.0, args.out / "last.pt"
    sums: dict[str, float] = {}  # of the losses since the last row of the log
    if args.resume and last.exists():
        state = torch.load(last, map_location="cpu", weights_only=True)
        if state["recipe"] != recipe:
            wrong = [k for k in recipe | state["recipe"] if state["recipe"].get(k) != recipe.get(k)]
            raise SystemExit(f"{last}: made with another {', '.join(wrong)}; give the same or another --out")
        model.load_state_dict(state["model"])
        optimizer.load_state_dict(state["optimizer"])
        average = {k: v.to(args.device) for k, v in state["ema"].items()}
        first, spent_s, sums = state["step"], state["seconds"], state["sums"]
        print(f"{last}: goes on from step {first}")
    elif last.exists():
        raise SystemExit(f"{last} exists: give --resume to go on, or another --out")

    stop = False

    def ask_stop(*_: object) -> None:
        nonlocal stop
        stop = True

    for kind in (signal.SIGTERM, signal.SIGINT):
        signal.signal(kind, ask_stop)
    begin = time.monotonic()
    log_path = args.out / "log.csv"
    log = rows_before(log_path, first)
    waited = 0.0

    def checkpoint(step: int) -> None:
        weights = {
            "ema": average, "step": step, "seconds": spent_s + time.monotonic() - begin, "recipe": recipe, "classes": classes,
            "machine": f"{platform.machine()}, {args.threads} threads, {args.device}",
        }  # fmt: skip
        save(last, weights | {"model": model.state_dict(), "optimizer": optimizer.state_dict(), "sums": sums})
        if args.keep_every and step % args.keep_every == 0:
            save(args.out / f"step-{step}.pt", weights)
        fields = list(dict.fromkeys(k for row in log for k in row))
        with log_path.open("w", newline="") as file:
            writer = csv.DictWriter(file, fields, restval="")
            writer.writeheader()
            writer.writerows(log)
        if log:
            if curves is None:
                print("no curves.svg: Matplotlib is not installed")
            else:
                curves(log, args.out / "curves.svg", f"{args.model}, {step} of {args.steps} steps")

    step, mark = first, time.monotonic()
    for pictures, targets in loader(crops, args.batch, first, args.steps, args.workers):
        waited += time.monotonic() - mark
        images = pictures.to(args.device).permute(0, 3, 1, 2).to(torch.float32).div_(255)  # channels last in memory
        rate = learning_rate(step, args)
        for group in optimizer.param_groups:
            group["lr"] = rate
        torch.manual_seed((args.seed << 32) + step)  # a model that draws (denoising queries) resumes exactly
        with torch.autocast(images.device.type, torch.bfloat16, enabled=args.bf16):
            losses = model.loss(images, targets)
        optimizer.zero_grad(set_to_none=True)
        losses["total"].backward()
        norm = torch.nn.utils.clip_grad_norm_(model.parameters(), args.clip)
        if torch.isfinite(norm):
            optimizer.step()
        step += 1
        with torch.no_grad():
            keep = min(args.ema, step / (step + 10))  # the first weights are not worth averaging
            for k, v in model.state_dict().items():
                average[k].lerp_(v, 1 - keep) if v.is_floating_point() else average[k].copy_(v)
        for k, v in losses.items():
            sums[k] = sums.get(k, 0.0) + float(v.detach())
        stop = stop or time.monotonic() - begin > args.time_limit * 60
        if step % args.log_every == 0:
            seconds = spent_s + time.monotonic() - begin
            row = {"step": step, "lr": f"{rate:.3e}", "seconds": f"{seconds:.1f}", "norm": f"{float(norm):.3f}"}
            row |= {k: f"{v / args.log_every:.5f}" for k, v in sums.items()}
            log.append(row)
            each_ms = 1000 * (time.monotonic() - begin) / (step - first) / args.batch
            share = 100 * waited / (time.monotonic() - begin)
            parts = " ".join(f"{k} {float(row[k]):.3f}" for k in sums)
            print(f"step {step}: {parts}; {each_ms:.1f} ms a crop, {share:.0f} % waiting for pictures", flush=True)
            sums = {}
        keeps = args.keep_every and step % args.keep_every == 0
        if step % args.save_every == 0 or keeps or step == args.steps or stop:
            checkpoint(step)
        if stop:
            print(f"stopped at step {step}; --resume goes on")
            break
        mark = time.monotonic()
    if step == args.steps:
        print(json.dumps({"steps": step, "minutes": round((spent_s + time.monotonic() - begin) / 60, 1), "checkpoint": str(last)}))


if __name__ == "__main__":
    main()
