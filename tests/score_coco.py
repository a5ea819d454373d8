#!/usr/bin/env python3
"""Makes tests/data/detections.json: random boxes and detections with what pycocotools says of them.

    python -m venv venv && venv/bin/pip install -r tests/requirements-coco.txt
    venv/bin/python tests/score_coco.py > tests/data/detections.json
"""

import contextlib
import io
import json
import sys
from pathlib import Path

import numpy as np
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

IMAGES = 50
SIZE = (640, 480)  # [px]
BANDS = {
    "all": (0, 1e10),
    "lt8": (0, 8**2),
    "8to16": (8**2, 16**2),
    "16to32": (16**2, 32**2),
    "ge32": (32**2, 1e10),
}  # [px²]


def rounded(box):
    return [round(float(x), 2) for x in box]


def generate(rng):
    """Boxes of 3 to 60 px, a tenth of them ignored, and detections that err like a detector's."""
    truth, found = [], []
    for image in range(1, IMAGES + 1):
        for _ in range(rng.integers(0, 5)):
            ignored = rng.random() < 0.15
            side = np.exp(rng.uniform(np.log(3), np.log(60))) * (2.5 if ignored else 1)
            w, h = side * rng.uniform(0.8, 1.25), side * rng.uniform(0.6, 1.0)
            x, y = rng.uniform(0, SIZE[0] - w), rng.uniform(0, SIZE[1] - h)
            truth.append((image, rounded([x, y, w, h]), ignored))
            # None, one or two detections of a box; several smaller ones in an ignored region.
            for _ in range(rng.integers(0, 4) if ignored else rng.choice([0, 1, 1, 1, 1, 2])):
                if ignored and rng.random() < 0.7:
                    s = side * rng.uniform(0.15, 0.5)
                    box = [x + rng.uniform(-0.1, 0.9) * w, y + rng.uniform(-0.1, 0.9) * h, s, s]
                else:
                    e = rng.normal(0, 0.06, 4)
                    box = [x + e[0] * w, y + e[1] * h, w * np.exp(2 * e[2]), h * np.exp(2 * e[3])]
                found.append((image, rounded(box), rng.beta(5, 2)))
        for _ in range(rng.poisson(1.5)):
            s = np.exp(rng.uniform(np.log(3), np.log(60)))
            found.append(
                (image, rounded([rng.uniform(0, 600), rng.uniform(0, 440), s, s]), rng.beta(2, 4))
            )
    # More than 100 in one image, to have the limit count; scores of two digits, to have ties.
    for _ in range(130):
        found.append(
            (7, rounded([rng.uniform(0, 600), rng.uniform(0, 440), 9, 9]), rng.uniform(0.2, 0.7))
        )
    return truth, [(image, box, round(float(score), 2)) for image, box, score in found]


def score(truth, found):
    """Scores of the random set."""
    dataset = {
        "images": [{"id": i + 1, "width": SIZE[0], "height": SIZE[1]} for i in range(IMAGES)],
        "categories": [{"id": 1, "name": "uav"}],
        "annotations": [
            {
                "id": i + 1,
                "image_id": image,
                "category_id": 1,
                "bbox": box,
                "area": box[2] * box[3],
                "iscrowd": int(ignored),
            }
            for i, (image, box, ignored) in enumerate(truth)
        ],
    }
    return evaluate(
        dataset,
        [
            {"image_id": image, "category_id": 1, "bbox": box, "score": s}
            for image, box, s in found
        ],
    )


def evaluate(dataset, found):
    """AP of every band by pycocotools, -1 without boxes."""
    gt = COCO()
    gt.dataset = dataset
    gt.createIndex()
    dt = gt.loadRes(found)
    run = COCOeval(gt, dt, "bbox")
    run.params.areaRng = [list(band) for band in BANDS.values()]
    run.params.areaRngLbl = list(BANDS)
    run.evaluate()
    run.accumulate()
    precision = run.eval["precision"]  # [IoU, recall, class, band, limit]
    recall = run.eval["recall"]  # [IoU, class, band, limit]

    def mean(values):
        return float(values.mean()) if (values > -1).all() else -1.0

    return {
        name: {
            "ap50": mean(precision[0, :, 0, i, 2]),
            "ap50_95": mean(precision[:, :, 0, i, 2]),
            "ar50_95": mean(recall[:, 0, i, 2]),
        }
        for i, name in enumerate(BANDS)
    } | {"precision50": [round(float(p), 9) for p in precision[0, :, 0, 0, 2]]}


def compare(out):
    """Prints AP of an evaluation and of pycocotools, and whether they agree to 1e-3."""
    ours = json.loads((out / "detector.json").read_text())
    dataset = json.loads(Path(ours["data"]).read_text())
    ids = {c["id"] for c in dataset["categories"] if c["name"] in ours["categories"]}
    boxes = [a for a in dataset["annotations"] if a["category_id"] in ids]
    for i, box in enumerate(boxes):
        ignored = box.get("iscrowd") or box.get("ignore") or not box.get("tight", True)
        area = box.get("area", box["bbox"][2] * box["bbox"][3])
        box.update(id=i + 1, category_id=min(ids), iscrowd=int(bool(ignored)), area=area)
    dataset["annotations"] = boxes
    with contextlib.redirect_stdout(io.StringIO()):
        theirs = evaluate(dataset, json.loads((out / "detections.json").read_text()))
    pairs = [("all", {"ap50": ours["map50"], "ap50_95": ours["map50_95"]})]
    pairs += zip(list(BANDS)[1:], ours["ap_by_size"].values())
    worst = 0.0
    for name, band in pairs:
        for key in ("ap50", "ap50_95"):
            value = -1.0 if band[key] is None else band[key]
            worst = max(worst, abs(value - theirs[name][key]))
            print(f"{name:8} {key:8} {value:9.6f} {theirs[name][key]:9.6f}")
    sys.exit(f"differ by {worst:.2g}" if worst > 1e-3 else 0)


def main():
    if len(sys.argv) > 1:
        compare(Path(sys.argv[1]))
    truth, found = generate(np.random.default_rng(20240611))
    with contextlib.redirect_stdout(io.StringIO()):
        scored = score(truth, found)
    json.dump(
        {"images": IMAGES, "boxes": truth, "detections": found, "pycocotools": scored},
        sys.stdout,
        separators=(",", ":"),
    )
    print()


if __name__ == "__main__":
    main()
