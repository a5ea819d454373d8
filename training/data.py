"""Training samples: random crops of a COCO folder of rendered and real pictures, and procedural pictures.

Sample n depends on (seed, n) and the folder alone, whoever draws it and in which order.
"""

import hashlib
import json
import math
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset, Sampler

import augment
import graft
import models
from verdict import UAVS

CROP = 256  # [px]
KEPT = 0.6  # least part of a box inside the crop for it to count; a lesser rest is neither target nor background
OTHERS = 0.4  # share of the crops about something that are about what is no UAV
GRAFTED = 0.2  # share of the crops of pictures, and of the procedural ones, that get a thing out of a real picture, where there are such
HARD = 0.3  # share of crops about what was taken for a UAV, where that is known
LEAST_PX = 2.5  # resampling shrinks no target below this long side
# Least and greatest resampling, of rendered and of real pictures: what was filmed near must be known from afar, too. A picture
# that does not fill the crop then is resampled by less.
SCALES = ((0.6, 1.6), (0.25, 1.6))


class Frames:
    """The same split of one or more COCO folders: pictures as raw bytes in a file beside each, made at first use.

    Decoding costs more than all augmentation, and 8,000 frames in RAM are 7 GB.
    """

    def __init__(self, *folders: Path):
        self.names: list[str] = []  # of the classes
        self.shapes: list[tuple[int, int, int]] = []  # height, width, 3
        self.pixels: list[tuple[Path, int]] = []  # file and offset of each picture
        self.boxes: list[np.ndarray] = []  # [n,4] px of each picture
        self.labels: list[np.ndarray] = []  # [n]
        self.aims: list[np.ndarray] = []  # [n,2] px, no numbers where nobody knows
        self.ignore: list[np.ndarray] = []  # [n,4] px
        real: list[bool] = []
        digests = []
        for folder in folders:
            source = folder / "annotations.json"
            if not source.is_file():
                raise FileNotFoundError(f"{source}: no such file; `boresight dataset` makes it, or give --data none")
            text = source.read_bytes()
            coco = json.loads(text)
            categories = sorted(coco["categories"], key=lambda c: c["id"])
            names = [c["name"] for c in categories]
            if self.names and names != self.names:
                raise ValueError(f"{source}: its categories are {', '.join(names)}; those of {folders[0]} are {', '.join(self.names)}")
            images = sorted(coco["images"], key=lambda i: i["id"])
            if not images:
                raise ValueError(f"{source}: it lists no pictures")
            self.names = names
            digests.append(hashlib.sha256(text).hexdigest())
            real += [image.get("source") == "real" for image in images]
            self.annotate(images, coco["annotations"], {c["id"]: k for k, c in enumerate(categories)})
            self.decode(folder, images, digests[-1])
        self.real = np.array(real)
        self.digest = digests[0] if len(digests) == 1 else hashlib.sha256(" ".join(digests).encode()).hexdigest()
        self.targets = [(k, j) for k, b in enumerate(self.boxes) for j in range(len(b))]
        self.empty = [k for k, b in enumerate(self.boxes) if not len(b) and not len(self.ignore[k])]

    def annotate(self, images: list[dict], annotations: list[dict], index: dict[int, int]) -> None:
        """Takes in a folder's annotations; `index` says the class of a category."""
        rows = {image["id"]: k for k, image in enumerate(images)}
        boxes: list[list[list[float]]] = [[] for _ in images]
        labels: list[list[int]] = [[] for _ in images]
        ignore: list[list[list[float]]] = [[] for _ in images]
        aims: list[list[list[float]]] = [[] for _ in images]
        for a in annotations:
            x, y, w, h = a["bbox"]
            k = rows[a["image_id"]]
            if a.get("iscrowd") or a.get("ignore") or a.get("tight") is False:
                ignore[k].append([x, y, x + w, y + h])
            else:
                boxes[k].append([x, y, x + w, y + h])
                labels[k].append(index[a["category_id"]])
                aims[k].append(a.get("aim", [math.nan, math.nan]))
        self.boxes += [np.array(b, np.float32).reshape(-1, 4) for b in boxes]
        self.ignore += [np.array(b, np.float32).reshape(-1, 4) for b in ignore]
        self.aims += [np.array(b, np.float32).reshape(-1, 2) for b in aims]
        self.labels += [np.array(b, np.int64) for b in labels]

    def decode(self, folder: Path, images: list[dict], digest: str) -> None:
        """Takes in a folder's file of pixels, decoded anew where it belongs to other annotations."""
        names = [image["file_name"] for image in images]
        files = [folder / "images" / name if (folder / "images" / name).exists() else folder / name for name in names]
        shapes = [(image["height"], image["width"], 3) for image in images]
        *starts, size = np.cumsum([0] + [math.prod(shape) for shape in shapes]).tolist()
        path = folder / "pixels.cache"
        stamp = path.with_suffix(".json")
        whole = path.exists() and path.stat().st_size == size and stamp.exists()
        if not (whole and json.loads(stamp.read_text()).get("annotations") == digest):
            stamp.unlink(missing_ok=True)
            # A file of its own: another process may be decoding, too.
            part = path.with_suffix(f".{os.getpid()}.part")
            with part.open("wb") as out:
                for k, (file, shape) in enumerate(zip(files, shapes)):
                    picture = cv2.imread(str(file), cv2.IMREAD_COLOR)
                    if picture is None or picture.shape != shape:
                        raise ValueError(f"{file}: not a picture of {shape[1]} x {shape[0]}, as annotations.json says")
                    out.write(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB).tobytes())
                    if k % 1000 == 999:
                        print(f"decoded {k + 1} of {len(files)} pictures", flush=True)
            part.replace(path)
            stamp.write_text(json.dumps({"annotations": digest}))
        self.shapes += shapes
        self.pixels += [(path, start) for start in starts]

    def __len__(self) -> int:
        return len(self.shapes)

    def picture(self, k: int) -> np.ndarray:
        """Picture k, uint8 [H,W,3] RGB: read in one piece, as a crop's rows one by one cost a disk far more."""
        path, start = self.pixels[k]
        return np.fromfile(path, np.uint8, math.prod(self.shapes[k]), offset=start).reshape(self.shapes[k])


def clip_boxes(boxes: np.ndarray, labels: np.ndarray, ignore: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Boxes clipped to a crop; those with less than `KEPT` inside, or under 2 px, become regions to ignore."""
    if not len(boxes):
        return boxes, labels, ignore
    seen = np.clip(boxes, 0, size)
    side = seen[:, 2:] - seen[:, :2]
    area = side.prod(1)
    good = (area >= KEPT * (boxes[:, 2:] - boxes[:, :2]).prod(1)) & (side.max(1) >= 2) & (side.min(1) >= 1)
    rest = seen[~good & (area > 0)]
    return seen[good], labels[good], np.concatenate([ignore, rest]).astype(np.float32)


def false_alarms(path: Path, frames: Frames) -> np.ndarray:
    """The rows of a file by `mine.py` that belongs to these frames."""
    found = json.loads(path.read_text())
    if found["data"] != frames.digest:
        raise ValueError(f"{path}: made from another data set; run mine.py again")
    return np.array(found["boxes"], np.float32).reshape(-1, 6)


class Pool:
    """The pictures of one source, rendered or real: where its UAVs are, what is none by class, where nothing is."""

    def __init__(self, frames: Frames, rows: np.ndarray, hard: np.ndarray | None):
        """`rows` [n]: its pictures; `hard` [n,5+]: frame and box of what was taken for a UAV in any picture."""
        mine = np.zeros(len(frames), bool)
        mine[rows] = True
        self.rows = rows
        self.uavs: list[tuple[int, int]] = []
        self.others: list[list[tuple[int, int]]] = [[] for _ in models.CLASSES[UAVS:]]
        for k, j in frames.targets:
            if mine[k]:
                label = int(frames.labels[k][j])
                (self.uavs if label < UAVS else self.others[label - UAVS]).append((k, j))
        # Rare classes about as often as common ones.
        weights = np.sqrt([len(one) for one in self.others])
        self.shares = weights / weights.sum() if weights.sum() > 0 else None
        self.empty = [k for k in frames.empty if mine[k]]
        self.hard = None if hard is None else hard[mine[hard[:, 0].astype(int)]]

    def target(self, rng: np.random.Generator) -> tuple[int, int]:
        """Picture and number of a UAV, or, `OTHERS` of the time, of what is none."""
        if self.shares is not None and (rng.random() < OTHERS or not self.uavs):
            one = self.others[rng.choice(len(self.others), p=self.shares)]
            return one[rng.integers(len(one))]
        return self.uavs[rng.integers(len(self.uavs))]


class Crops(Dataset):
    """Samples by number, without end."""

    def __init__(
        self, frames: Frames | None, seed: int, procedural: float = 0.15, negatives: float = 0.27, size: int = CROP,
        hard: np.ndarray | None = None, real: float = 0.5,
    ):  # fmt: skip
        """`hard` [n,5+]: frame and box of what was taken for a UAV. Crops about such (`HARD` of all) then take the places
        of some about targets and of three quarters of those away from all. `real`: share of the crops of pictures that
        are cut from real ones; a set of one source is cut from that alone."""
        self.frames, self.seed, self.negatives, self.size = frames, seed, negatives, size
        hard = hard if hard is not None and len(hard) else None
        found = []  # pool and share of rendered and of real pictures, where they hold something
        for wanted, share in ((False, 1 - real), (True, real)):
            rows = np.flatnonzero(frames.real == wanted) if frames is not None else []
            pool = Pool(frames, rows, hard) if len(rows) else None
            if pool and (pool.uavs or pool.shares is not None):
                found.append((pool, share))
        if len(found) == 1:
            found = [(found[0][0], 1.0)]
        self.pools = [pool for pool, share in found if share > 0]
        self.shares = np.array([share for _, share in found if share > 0])
        self.procedural = procedural if self.pools else 1.0
        # Rendered alone means that no real pixel comes in.
        donors = graft.Donors(frames) if frames is not None and real > 0 else None
        self.donors = donors if donors and donors.labels else None

    def __getitem__(self, n: int) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        rng = np.random.default_rng([self.seed, n])
        as_rendered = False
        if rng.random() < self.procedural:
            picture, boxes, labels, ignore = self.invent(rng)
            aims = np.zeros((0, 2), np.float32)
        else:
            picture, boxes, labels, ignore, aims = self.cut(rng)
            as_rendered = rng.random() < 0.2  # the simulator's own pictures must stay familiar too
        # Procedural UAVs come after the rendered ones; nobody says where to aim at them.
        aims = np.concatenate([aims, np.full((len(boxes) - len(aims), 2), np.nan, np.float32)])
        if as_rendered:
            picture = np.clip(picture + 0.5, 0, 255).astype(np.uint8)
        else:
            augment.add_clutter(rng, picture, np.concatenate([boxes, ignore]))
            picture = augment.lens(rng, augment.exposure(rng, picture))
            picture = augment.camera(rng, picture)
        if rng.random() < 0.5:
            picture, boxes, ignore = np.ascontiguousarray(picture[:, ::-1]), augment.mirror(boxes, self.size), augment.mirror(ignore, self.size)
            aims = aims * (-1, 1) + (self.size, 0)
        return torch.from_numpy(picture), {
            "boxes": torch.from_numpy(boxes.astype(np.float32)),
            "labels": torch.from_numpy(labels.astype(np.int64)),
            "ignore": torch.from_numpy(ignore.astype(np.float32)),
            "aims": torch.from_numpy(aims.astype(np.float32)),
        }

    def invent(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A procedural picture with UAVs, birds and aircraft, or with none."""
        picture = augment.background(rng, self.size)
        count = 0 if rng.random() < self.negatives else int(rng.choice([1, 2, 3], p=[0.7, 0.2, 0.1]))
        boxes, labels = augment.add_uavs(rng, picture, count, np.zeros((0, 4), np.float32), np.zeros(0, np.int64))
        if rng.random() < (0.4 if count else 0.6):
            boxes, labels = augment.add_flyers(rng, picture, boxes, labels)
        if self.donors and rng.random() < GRAFTED:
            boxes, labels = self.graft(rng, picture, boxes, labels)
        return picture, boxes, labels, np.zeros((0, 4), np.float32)

    def graft(self, rng: np.random.Generator, picture: np.ndarray, boxes: np.ndarray, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Composes a thing out of a real picture clear of the given boxes; boxes [n,4] and labels [n] of all."""
        size = augment.target_size(rng)
        return augment.add(rng, picture, self.donors.maker, size, tuple(rng.uniform(0, self.size, 2)), boxes, labels)

    def cut(self, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
        """A crop of a picture, resampled: about a target or a false alarm, or away from all.

        Picture, boxes, labels, regions to ignore, and the aim points of the annotated ones, which come first.
        """
        frames = self.frames
        pool = self.pools[rng.choice(len(self.pools), p=self.shares)]
        can_be_hard = pool.hard is not None and len(pool.hard) > 0
        about_hard = can_be_hard and rng.random() < HARD
        negative = not about_hard and rng.random() < (self.negatives / 4 if can_be_hard else self.negatives)
        k, j = pool.target(rng)
        about = frames.boxes[k][j]
        if negative and rng.random() < 0.5:
            rows = pool.empty or pool.rows
            k = int(rows[rng.integers(len(rows))])
        if about_hard:
            row = pool.hard[rng.integers(len(pool.hard))]
            k, about = int(row[0]), row[1:5]
        h, w, _ = frames.shapes[k]
        boxes, labels, ignore = frames.boxes[k], frames.labels[k], frames.ignore[k]
        least, most = SCALES[int(frames.real[k])]
        scale = float(np.exp(rng.uniform(*np.log((max(least, self.size / min(h, w)), most)))))
        if not negative:
            scale = max(scale, min(1.0, LEAST_PX / float((about[2:] - about[:2]).max())))
        side = min(round(self.size / scale), h, w)
        source = frames.picture(k)
        if negative:
            # Six windows: one without a target; half of the time the busiest such, as clutter teaches more than sky.
            hard, best = rng.random() < 0.5, (False, 0.0, 0, 0)
            for _ in range(6):
                x, y = int(rng.integers(0, w - side + 1)), int(rng.integers(0, h - side + 1))
                clear = augment.overlap(np.array([x, y, x + side, y + side], float), boxes) == 0
                view = source[y : y + side : 4, x : x + side : 4, 1].astype(np.float32)
                busy = float(np.abs(np.diff(view, axis=0)).mean() + np.abs(np.diff(view, axis=1)).mean()) if hard else 0.0
                best = max(best, (clear, busy, x, y))
                if clear and not hard:
                    break
            _, _, x, y = best
        else:
            cx, cy = (about[:2] + about[2:]) / 2
            x = int(np.clip(cx - rng.uniform(0.03, 0.97) * side, 0, w - side))
            y = int(np.clip(cy - rng.uniform(0.03, 0.97) * side, 0, h - side))
        picture = source[y : y + side, x : x + side]
        if side != self.size:
            method = cv2.INTER_AREA if side > self.size else [cv2.INTER_LINEAR, cv2.INTER_CUBIC][rng.integers(2)]
            picture = cv2.resize(picture, (self.size, self.size), interpolation=method)
        factor = self.size / side
        move = lambda b: (b - np.array([x, y, x, y], np.float32)) * factor  # noqa: E731
        ignore = np.clip(move(ignore), 0, self.size)
        ignore = ignore[(ignore[:, 2:] > ignore[:, :2]).all(1)]
        boxes, kept, ignore = clip_boxes(move(boxes), np.arange(len(boxes)), ignore, self.size)
        labels, aims = labels[kept], (frames.aims[k][kept] - (x, y)) * factor
        picture = picture.astype(np.float32)
        extra = rng.random()  # a procedural UAV, or birds and aircraft, or something real, before this background
        if extra < 0.3 or (self.donors and extra < 0.3 + GRAFTED):
            if extra < 0.15:
                adder = lambda *known: augment.add_uavs(rng, picture, 1, *known)  # noqa: E731
            elif extra < 0.3:
                adder = lambda *known: augment.add_flyers(rng, picture, *known)  # noqa: E731
            else:
                adder = lambda *known: self.graft(rng, picture, *known)  # noqa: E731
            boxes, labels = adder(np.concatenate([boxes, ignore]), np.concatenate([labels, np.full(len(ignore), -1)]))
            boxes, labels = boxes[labels >= 0], labels[labels >= 0]
        return picture, boxes, labels, ignore, aims


class Run(Sampler[int]):
    """Sample numbers first..last of a training run, so that a resumed run goes on where it stopped."""

    def __init__(self, first: int, last: int):
        self.first, self.last = first, last

    def __iter__(self) -> Iterator[int]:
        return iter(range(self.first, self.last))

    def __len__(self) -> int:
        return self.last - self.first


def collate(samples: list[tuple[torch.Tensor, dict]]) -> tuple[torch.Tensor, list[dict]]:
    """Pictures uint8 [B,H,W,3] and their targets."""
    return torch.stack([s[0] for s in samples]), [s[1] for s in samples]


def worker_init(_: int) -> None:
    # Signals to the group (Ctrl-C, `timeout`) are for the training process, which saves first; it ends its workers.
    os.setpgrp()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    torch.set_num_threads(1)


def loader(crops: Crops, batch: int, first_step: int, last_step: int, workers: int) -> DataLoader:
    """Batches of steps first..last."""
    return DataLoader(
        crops, batch, sampler=Run(first_step * batch, last_step * batch), num_workers=workers, collate_fn=collate,
        worker_init_fn=worker_init, prefetch_factor=4 if workers else None,
    )  # fmt: skip
