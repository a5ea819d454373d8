#!/usr/bin/env python3
"""The paper's figures 7 and 8 of our own networks: how training went, and how far detections miss.

`figures.py learning RUN... --data SET/val`: loss and AP@0.5 of the weights that `train.py --keep-every` left, on
validation pictures (figure 7). `figures.py misses --data SET/val NAME=detections.json...`: distance of the detected
box's middle from the true one, picture by picture, of what `boresight eval detector` wrote (figure 8).
"""

import argparse
import json
from pathlib import Path

import numpy as np
import torch
from torch.utils.data import DataLoader, Subset

import export
import models
from data import Crops, Frames, collate
from plot import lines
from quick_eval import iou, measure
from verdict import UAVS

CROPS, SCORE, OFFSET_PX = 192, 0.1, 8.0


def validation_loss(checkpoint: Path, crops: Crops) -> float:
    """Mean of the total loss over the same crops for all."""
    model, _ = export.load(checkpoint)
    torch.manual_seed(0)
    total = []
    with torch.no_grad():
        for pictures, targets in DataLoader(Subset(crops, range(CROPS)), 16, collate_fn=collate):
            total.append(float(model.loss(pictures.permute(0, 3, 1, 2).float() / 255, targets)["total"]))
    return float(np.mean(total))


def learning(runs: list[Path], data: Path, frames: int, out: Path) -> None:
    crops = Crops(Frames(data), 1, 0.0, size=256)
    losses, precisions = {}, {}
    for run in runs:
        rows = []
        for checkpoint in sorted(run.glob("step-*.pt"), key=lambda p: int(p.stem[5:])):
            recipe = torch.load(checkpoint, map_location="cpu", weights_only=True)["recipe"]
            seen = int(checkpoint.stem[5:]) * recipe["batch"] / 1000
            ap = measure(checkpoint, data, frames, torch.get_num_threads())["iou_0_5"]["ap"]
            rows.append((seen, validation_loss(checkpoint, crops), ap))
            print(f"{checkpoint}: {seen:.1f} thousand crops, loss {rows[-1][1]:.3f}, AP@0.5 {ap:.3f}", flush=True)
        if not rows:
            raise SystemExit(f"{run}: no step-*.pt; train with --keep-every")
        losses[f"{run.name}: loss {rows[-1][1]:.2f}"] = [(x, loss) for x, loss, _ in rows]
        precisions[f"{run.name}: AP@0.5 {rows[-1][2]:.3f}"] = [(x, ap) for x, _, ap in rows]
    top = 1.1 * max(y for points in losses.values() for _, y in points)
    across = "thousand crops"
    lines(losses, out.with_name(out.stem + "_loss.svg"), "Loss on validation pictures", across, top)
    lines(precisions, out.with_name(out.stem + "_ap.svg"), f"AP@0.5 of UAVs on {frames or 'all'} validation pictures", across, 1.0)


def misses(data: Path, models_found: dict[str, Path], out: Path) -> None:
    coco = json.loads((data / "annotations.json").read_text())
    uavs = {c["id"] for c in coco["categories"] if c["name"] in models.CLASSES[:UAVS]}
    truth: dict[int, list] = {}
    for a in coco["annotations"]:
        if a["category_id"] in uavs and a.get("tight") is not False and not a.get("iscrowd") and not a.get("ignore"):
            x, y, w, h = a["bbox"]
            truth.setdefault(a["image_id"], []).append([x, y, x + w, y + h])
    # Pictures without UAVs have no place: a line across them would say something of them.
    places = {image: k for k, image in enumerate(i["id"] for i in coco["images"] if i["id"] in truth)}
    series, total = {}, sum(map(len, truth.values()))
    for shift, (name, path) in enumerate(models_found.items()):
        found: dict[int, list] = {}
        for row in json.loads(path.read_text()):
            if row["category_id"] in uavs and row["score"] >= SCORE:
                x, y, w, h = row["bbox"]
                found.setdefault(row["image_id"], []).append([x, y, x + w, y + h])
        points = []
        for image, boxes in truth.items():
            own = np.array(found.get(image, []), float).reshape(-1, 4)
            for box, overlap in zip(np.array(boxes), iou(own, np.array(boxes)).T if len(own) else []):
                if overlap.max() >= 0.5:
                    best = own[overlap.argmax()]
                    points.append((places[image], float(np.linalg.norm((best[:2] + best[2:] - box[:2] - box[2:]) / 2))))
        points.sort()
        if not points:
            raise SystemExit(f"{path}: hits no UAV of {data}")
        mean = float(np.mean([y for _, y in points]))
        print(f"{name}: {len(points)} of {total} UAVs hit, mean miss {mean:.2f} px")
        series[f"{name}: {mean:.2f} px, {len(points)} of {total}"] = [(x, y + shift * OFFSET_PX) for x, y in points]
    title = f"Miss distance of each picture's UAVs [px], each model {OFFSET_PX:.0f} px higher"
    lines(series, out, title, "pictures with UAVs", OFFSET_PX * (len(series) + 0.5))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("figure", choices=("learning", "misses"))
    parser.add_argument("inputs", nargs="+", help="runs, or NAME=detections.json")
    parser.add_argument("--data", type=Path, required=True, help="validation pictures, a folder with annotations.json")
    parser.add_argument("--frames", type=int, default=300, help="pictures for the AP; 0: all")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True, help="SVG file; learning writes OUT_loss.svg and OUT_ap.svg")
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    if args.figure == "learning":
        learning([Path(run) for run in args.inputs], args.data, args.frames, args.out)
    else:
        pairs = [text.partition("=") for text in args.inputs]
        if not all(path for _, _, path in pairs):
            parser.error("give NAME=detections.json")
        misses(args.data, {name: Path(path) for name, _, path in pairs}, args.out)


if __name__ == "__main__":
    main()
