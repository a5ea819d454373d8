#!/usr/bin/env python3
"""Finds what a detector takes for UAVs in its own training pictures: FOLDER/hard.json, which `train.py --hard` cuts
crops about (bootstrapping: Sung and Poggio 1998).

What is like a UAV fills a thousandth of the pictures; crops at random hardly ever show it. Birds and the like that are taken
for UAVs count, too.
"""

import argparse
import json
from pathlib import Path

import numpy as np

import augment
import export
from data import Frames
from preprocess import native
from verdict import UAVS

MOST = 8  # false alarms of one picture


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("--data", type=Path, nargs="+", required=True, help="folders with train/annotations.json, as train.py gets them")
    parser.add_argument("--out", type=Path, required=True, help="file to write")
    parser.add_argument("--score", type=float, default=0.25, help="least score of a false alarm that counts")
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    try:
        frames = Frames(*(data / "train" for data in args.data))
    except (OSError, ValueError) as fault:
        raise SystemExit(str(fault)) from None
    model, state = export.load(args.checkpoint)
    runtime = export.session(export.to_onnx(model, state["classes"], 0.5, "", {}), args.threads)
    rows = []
    for k in range(len(frames)):
        image = native(frames.picture(k), model.stride, model.min_side_px, model.fixed_size)
        boxes, scores, labels, *_ = (x[0] for x in runtime.run(None, {"image": image}))
        uavs = frames.boxes[k][frames.labels[k] < UAVS]
        taken = np.concatenate([uavs, frames.ignore[k]]) + np.array([-3, -3, 3, 3], np.float32)
        alarms = np.flatnonzero((scores >= args.score) & (labels < UAVS))
        free = [j for j in alarms if augment.overlap(boxes[j], taken) == 0]
        rows += [[k, *(round(float(v), 1) for v in boxes[j]), round(float(scores[j]), 3)] for j in free[:MOST]]
        if k % 1000 == 999:
            print(f"{k + 1} of {len(frames)} pictures: {len(rows)} false alarms", flush=True)
    args.out.write_text(json.dumps({"data": frames.digest, "checkpoint": str(args.checkpoint), "step": state["step"], "boxes": rows}))


if __name__ == "__main__":
    main()
