#!/usr/bin/env python3
"""Makes tests/data/detections.json: random boxes and detections with what pycocotools says of them.

    python -m venv venv && venv/bin/pip install -r tests/requirements-coco.txt
    venv/bin/python tests/score_coco.py > tests/data/detections.json
"""

import contextlib
import io
import json
import sys

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
    """AP of every band by pycocotools, -1 without boxes."""
    gt = COCO()
    gt.dataset = {
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
    gt.createIndex()
    dt = gt.loadRes(
        [
            {"image_id": image, "category_id": 1, "bbox": box, "score": s}
            for image, box, s in found
        ]
    )
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


def main():
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
