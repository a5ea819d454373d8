#!/usr/bin/env python3
"""Packs the training windows of a set into files that a lent machine can be given: PART-k.zip, each at most
--part-mib large, COCO folders of WebP windows about what is annotated. `unpack` makes one folder of them again, which
`train.py --data` takes.
"""

import argparse
import io
import json
import zipfile
from pathlib import Path

import cv2
import numpy as np

from data import KEPT, Frames

EMPTY = 0.15  # windows without anything over those with something


def windows(frames: Frames, k: int, side: int, rng: np.random.Generator) -> list[tuple[int, int, int, int]]:
    """Windows x, y, width, height of frame k: one about each box that no earlier window holds, or, in a share of the
    frames, one anywhere."""
    h, w, _ = frames.shapes[k]
    wide, high = min(side, w), min(side, h)
    taken: list[tuple[int, int, int, int]] = []
    for x0, y0, x1, y1 in frames.boxes[k]:
        if any(x <= x0 and y <= y0 and x1 <= x + a and y1 <= y + b for x, y, a, b in taken):
            continue
        cx, cy = (x0 + x1) / 2 - wide * rng.uniform(0.25, 0.75), (y0 + y1) / 2 - high * rng.uniform(0.25, 0.75)
        taken.append((int(np.clip(cx, 0, w - wide)), int(np.clip(cy, 0, h - high)), wide, high))
    if not taken or rng.random() < EMPTY:
        taken.append((int(rng.integers(0, w - wide + 1)), int(rng.integers(0, h - high + 1)), wide, high))
    return taken


def annotations(frames: Frames, k: int, window: tuple[int, int, int, int]) -> list[dict]:
    """What of frame k lies in a window; parts below `KEPT` are to be ignored."""
    x, y, wide, high = window
    found = []
    kinds = [*zip(frames.boxes[k], frames.labels[k], frames.aims[k], [0] * len(frames.boxes[k]))]
    kinds += [(box, 0, (np.nan, np.nan), 1) for box in frames.ignore[k]]
    for box, label, aim, ignore in kinds:
        low, high_ = np.maximum(box[:2], (x, y)), np.minimum(box[2:], (x + wide, y + high))
        size = high_ - low
        if (size <= 0).any():
            continue
        part = size.prod() / (box[2:] - box[:2]).prod()
        entry = {"category_id": int(label) + 1, "bbox": [round(float(v), 3) for v in (*(low - (x, y)), *size)]}
        entry["ignore"] = int(ignore or part < KEPT)
        if np.isfinite(aim).all():
            entry["aim"] = [round(float(aim[0] - x), 3), round(float(aim[1] - y), 3)]
        found.append(entry)
    return found


def pack(data: Path, out: Path, side: int, quality: int, part_mib: float, parts: int, seed: int) -> None:
    frames, rng = Frames(data / "train"), np.random.default_rng(seed)
    categories = [{"id": k + 1, "name": name} for k, name in enumerate(frames.names)]
    out.mkdir(parents=True, exist_ok=True)
    order, at = rng.permutation(len(frames)), 0
    for part in range(parts):
        images, boxes, size = [], [], 0
        with zipfile.ZipFile(out / f"part-{part}.zip", "w", zipfile.ZIP_STORED) as archive:
            while at < len(order) and size < (part_mib - 1) * 2**20:
                k = int(order[at])
                at += 1
                for number, window in enumerate(windows(frames, k, side, rng)):
                    x, y, wide, high = window
                    view = cv2.cvtColor(np.ascontiguousarray(frames.picture(k)[y : y + high, x : x + wide]), cv2.COLOR_RGB2BGR)
                    _, text = cv2.imencode(".webp", view, [cv2.IMWRITE_WEBP_QUALITY, quality])
                    name = f"images/{k:06d}_{number}.webp"
                    archive.writestr(name, text.tobytes())
                    source = "real" if frames.real[k] else "rendered"
                    images.append({"id": len(images) + 1, "file_name": name, "width": wide, "height": high, "source": source})
                    boxes += [{"id": len(boxes) + i + 1, "image_id": len(images)} | a for i, a in enumerate(annotations(frames, k, window))]
                    size += len(text) + 400  # its entries in the archive's lists
            archive.writestr("annotations.json", json.dumps({"categories": categories, "images": images, "annotations": boxes}))
            if (data / "dataset.json").is_file():  # which holds the share of real crops
                archive.write(data / "dataset.json", "dataset.json")
        print(f"part {part}: {len(images)} windows, {len(boxes)} boxes, {(out / f'part-{part}.zip').stat().st_size / 2**20:.1f} MiB", flush=True)
        if at >= len(order):
            break
    print(f"{at} of {len(order)} pictures packed")


def unpack(parts: list[Path], out: Path) -> None:
    """One COCO folder OUT/train of all parts."""
    folder = out / "train"
    (folder / "images").mkdir(parents=True, exist_ok=True)
    images, boxes, categories = [], [], []
    for number, part in enumerate(sorted(parts)):
        with zipfile.ZipFile(part) as archive:
            coco = json.load(io.TextIOWrapper(archive.open("annotations.json")))
            first = len(images)
            categories = coco["categories"]
            for image in coco["images"]:
                name = f"images/{number}-{Path(image['file_name']).name}"
                (folder / name).write_bytes(archive.read(image["file_name"]))
                images.append(image | {"id": first + image["id"], "file_name": name})
            boxes += [a | {"id": len(boxes) + i + 1, "image_id": first + a["image_id"]} for i, a in enumerate(coco["annotations"])]
            if "dataset.json" in archive.namelist():
                (out / "dataset.json").write_bytes(archive.read("dataset.json"))
    (folder / "annotations.json").write_text(json.dumps({"categories": categories, "images": images, "annotations": boxes}))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder made by `boresight dataset`")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--side", type=int, default=320, help="of a window [px]")
    parser.add_argument("--quality", type=int, default=92, help="of WebP")
    parser.add_argument("--part-mib", type=float, default=40)
    parser.add_argument("--parts", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    pack(args.data, args.out, args.side, args.quality, args.part_mib, args.parts, args.seed)


if __name__ == "__main__":
    main()
