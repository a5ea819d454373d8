#!/usr/bin/env python3
"""A quick look at a detector on a COCO folder while it trains; `boresight eval detector` gives the full figures.

UAVs alone count: boxes of other categories and detections of other classes do not exist. Boxes with `tight: false`,
`ignore` and `iscrowd` are regions to ignore.
"""

import argparse
import json
import time
from pathlib import Path

import cv2
import numpy as np
import torch

import export
import models
from preprocess import native
from verdict import UAVS


def iou(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """IoU [n,m] of boxes x0, y0, x1, y1."""
    side = np.minimum(a[:, None, 2:], b[None, :, 2:]) - np.maximum(a[:, None, :2], b[None, :, :2])
    inner = np.clip(side, 0, None).prod(2)
    return inner / np.maximum((a[:, 2:] - a[:, :2]).prod(1)[:, None] + (b[:, 2:] - b[:, :2]).prod(1)[None] - inner, 1e-9)


def match(boxes: np.ndarray, scores: np.ndarray, truth: np.ndarray, ignore: np.ndarray, centre: bool) -> tuple[list, list]:
    """(score, hit) of the detections that count, best first, and (score, centre error px) of the hits. A hit has IoU
    >= 0.5, or its middle inside the true box (`centre`)."""
    rows, errors, free = [], [], set(range(len(truth)))
    overlaps = iou(boxes, truth)
    middle, target = (boxes[:, :2] + boxes[:, 2:]) / 2, (truth[:, :2] + truth[:, 2:]) / 2
    for k in np.argsort(-scores, kind="stable"):
        inside = ((middle[k] >= truth[:, :2]) & (middle[k] <= truth[:, 2:])).all(1)
        good = [j for j in free if (inside[j] if centre else overlaps[k, j] >= 0.5)]
        if good:
            j = max(good, key=lambda j: overlaps[k, j])
            free.remove(j)
            rows.append((scores[k], True))
            errors.append((scores[k], float(np.linalg.norm(middle[k] - target[j]))))
        elif not ((middle[k] >= ignore[:, :2] - 5) & (middle[k] <= ignore[:, 2:] + 5)).all(1).any():
            rows.append((scores[k], False))
    return rows, errors


def summary(rows: list, errors: list, truths: int, frames: int) -> dict[str, float]:
    """Average precision over 101 recalls, recall at 0.1 false alarms a frame, the threshold there, the score that is as
    likely of a UAV as of anything else, centre error."""
    rows = sorted(rows, key=lambda r: -r[0])
    hit = np.array([r[1] for r in rows], float)
    true, false = np.cumsum(hit), np.cumsum(1 - hit)
    recall, precision = true / max(truths, 1), true / np.maximum(true + false, 1)
    envelope = np.maximum.accumulate(precision[::-1])[::-1] if len(rows) else precision
    at = np.searchsorted(recall, np.linspace(0, 1, 101), side="left")
    ap = float(np.mean([envelope[k] if k < len(envelope) else 0.0 for k in at]))
    last = int((false <= 0.1 * frames).sum()) - 1
    threshold = float(rows[last][0]) if last >= 0 else 1.0
    kept = [e for s, e in errors if s >= threshold]
    # Of so many detections in a row, by score, half are hits.
    row = 200
    shares = np.convolve(hit, np.ones(row) / row, "valid") if len(hit) >= row else np.zeros(0)
    even = np.flatnonzero(shares >= 0.5)
    return {
        "ap": ap,
        "recall_at_fppi_0_1": float(recall[last]) if last >= 0 else 0.0,
        "threshold_there": threshold,
        "even_score": float(rows[even[-1] + row // 2][0]) if len(even) else float("nan"),
        "median_centre_error_px": float(np.median(kept)) if kept else float("nan"),
    }


def measure(path: Path, data: Path, frames: int = 0, threads: int = 1) -> dict:
    """Figures of a .onnx file or a checkpoint on the pictures of a COCO folder, or `frames` of them at even distances."""
    torch.set_num_threads(threads)
    if path.suffix == ".onnx":
        runtime = export.session(path.read_bytes(), threads)
        meta = runtime.get_modelmeta().custom_metadata_map
        stride, least = int(meta["stride"]), int(meta["min_side_px"])
        high, wide = runtime.get_inputs()[0].shape[2:]
        fixed = (high, wide) if isinstance(high, int) and isinstance(wide, int) else None
        bare = isinstance(runtime.get_inputs()[0].shape[0], int)  # it takes one picture: no batch axis in its outputs
        infer = lambda image: [x if bare else x[0] for x in runtime.run(None, {"image": image})]  # noqa: E731
    else:
        model, _ = export.load(path)
        stride, least, fixed = model.stride, model.min_side_px, model.fixed_size
        infer = lambda image: [x[0].numpy() for x in export.Decoder(model)(torch.from_numpy(image))]  # noqa: E731
    coco = json.loads((data / "annotations.json").read_text())
    images = coco["images"]
    if frames and frames < len(images):
        images = [images[k * len(images) // frames] for k in range(frames)]
    truth: dict[int, list] = {i["id"]: [] for i in images}
    ignore: dict[int, list] = {i["id"]: [] for i in images}
    aims: dict[int, list] = {i["id"]: [] for i in images}  # bodies' middles, known of rendered pictures
    others = {c["id"] for c in coco["categories"] if c["name"] in models.CLASSES[UAVS:]}
    for a in coco["annotations"]:
        if a["image_id"] in truth and a["category_id"] not in others:
            x, y, w, h = a["bbox"]
            loose = a.get("tight") is False or a.get("iscrowd") or a.get("ignore")
            (ignore if loose else truth)[a["image_id"]].append([x, y, x + w, y + h])
            if not loose and "aim" in a:
                aims[a["image_id"]].append([x, y, x + w, y + h, *a["aim"]])
    found: dict[bool, tuple[list, list]] = {False: ([], []), True: ([], [])}
    aimed: list[tuple[float, float]] = []  # [px] from a body's middle: the box's middle, the model's `centres`
    spent = 0.0
    for image in images:
        file = data / image["file_name"]
        file = file if file.exists() else data / "images" / image["file_name"]
        picture = cv2.imread(str(file), cv2.IMREAD_COLOR)
        if picture is None:
            raise SystemExit(f"{file}: no picture")
        planes = native(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), stride, least, fixed)
        begin = time.perf_counter()
        with torch.no_grad():
            boxes, scores, labels, *centres = infer(planes)
        spent += time.perf_counter() - begin
        scores = np.where(labels < UAVS, scores, 0)  # they need not fall then
        good = scores > 0.005
        t, g = (np.array(x[image["id"]], float).reshape(-1, 4) for x in (truth, ignore))
        for centre, (rows, errors) in found.items():
            r, e = match(boxes[good], scores[good], t, g, centre)
            rows += r
            errors += e
        for aim in aims[image["id"]] if centres else []:
            hits = (scores > 0.1) & (iou(boxes, np.array([aim[:4]]))[:, 0] >= 0.5)
            if hits.any():
                k = int((hits * scores).argmax())
                guesses = ((boxes[k, :2] + boxes[k, 2:]) / 2, centres[0][k])
                aimed.append(tuple(float(np.linalg.norm(guess - aim[4:])) for guess in guesses))
    truths = sum(len(t) for t in truth.values())
    out = {"frames": len(images), "targets": truths, "ms_a_frame": round(1000 * spent / max(len(images), 1), 1)}
    for centre, name in ((False, "iou_0_5"), (True, "centre_inside")):
        out[name] = {k: round(v, 4) for k, v in summary(*found[centre], truths, len(images)).items()}
    if aimed:
        box, own = (np.array(aimed) ** 2).mean(0) ** 0.5
        out["miss_of_body_middle_rms_px"] = {"box": round(float(box), 3), "centres": round(float(own), 3), "targets": len(aimed)}
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", type=Path, help="a .onnx file, or a checkpoint .pt")
    parser.add_argument("--data", type=Path, required=True, help="folder with annotations.json")
    parser.add_argument("--frames", type=int, default=0, help="so many frames at even distances; 0: all")
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    print(json.dumps(measure(args.model, args.data, args.frames, args.threads), indent=1))


if __name__ == "__main__":
    main()
