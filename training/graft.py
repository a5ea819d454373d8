"""What flies in real pictures, cut out before the sky and put before another background: what a thing is must not be told by
where it was filmed (D. Dwibedi et al., Cut, Paste and Learn, ICCV 2017)."""

import cv2
import numpy as np

from augment import Rng

# Judged by eye, on what was cut out of training clips and put before other backgrounds; no figure was tuned by them.
MARGIN = 0.3, 4.0  # of what is cut about a box: a share of its longer side, and the least of it [px]
RING = 2  # rows and columns at the edge of the cut that show the sky alone [px]
MOST_UNREST = 4.0  # of the sky about a plane, standard deviation [grey levels of 255]
LONGEST_PX = 110.0  # larger things leave no room in a crop
SOLID = 70  # percentile of what stands out that hides the background wholly; the rest, edges and rotors, in proportion
SCALES = 0.4, 1.3  # least and greatest resampling
TONED = 0.5  # how often a thing takes the tone that suits its new background
TRIES = 6  # things that are looked at until one stands before clear sky


def cut(picture: np.ndarray, box: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """A thing as a premultiplied sprite [h,w,4] with its box in it, from a picture uint8 [H,W,3] and its box; None where what is
    about it is no clear sky.

    The sky behind it is a plane through the ring about it; what differs is the thing, the more opaque the more it does.
    """
    margin = max(MARGIN[0] * float((box[2:] - box[:2]).max()), MARGIN[1])
    x0, y0 = np.floor(box[:2] - margin).astype(int)
    x1, y1 = np.ceil(box[2:] + margin).astype(int)
    if x0 < 0 or y0 < 0 or x1 > picture.shape[1] or y1 > picture.shape[0]:
        return None
    patch = picture[y0:y1, x0:x1].astype(np.float32)
    rows, columns = np.mgrid[0 : y1 - y0, 0 : x1 - x0].astype(np.float32)
    terms = np.stack([np.ones_like(rows), rows, columns], -1)
    ring = np.ones(rows.shape, bool)
    ring[RING:-RING, RING:-RING] = False
    plane, *_ = np.linalg.lstsq(terms[ring], patch[ring], rcond=None)
    sky = terms @ plane
    unrest = float((patch - sky)[ring].std(0).max())
    if unrest > MOST_UNREST:
        return None
    differs = np.abs(patch - sky).max(-1)
    floor = 2.5 * unrest + 3.0
    near = (rows + y0 >= box[1] - 2) & (rows + y0 <= box[3] + 1) & (columns + x0 >= box[0] - 2) & (columns + x0 <= box[2] + 1)
    own = near & (differs > floor)
    if own.sum() < 4:
        return None
    opaque = np.clip(differs / np.percentile(differs[own], SOLID), 0, 1) * np.clip((differs - 0.5 * floor) / floor, 0, 1) * near
    colours = np.clip(sky * opaque[..., None] + (patch - sky) * (opaque > 0)[..., None], 0, 255 * opaque[..., None])
    return np.concatenate([colours, opaque[..., None]], -1).astype(np.float32), (box - (x0, y0, x0, y0)).astype(np.float32)


class Donors:
    """The things of a set's real pictures, by class."""

    def __init__(self, frames):
        """`frames`: a `data.Frames`."""
        self.frames = frames
        self.of: dict[int, list[tuple[int, int]]] = {}
        for k, j in frames.targets:
            box = frames.boxes[k][j]
            alone = len(frames.boxes[k]) + len(frames.ignore[k]) == 1
            if frames.real[k] and alone and (box[2:] - box[:2]).max() <= LONGEST_PX:
                self.of.setdefault(int(frames.labels[k][j]), []).append((k, j))
        self.labels = sorted(self.of)

    def maker(self, rng: Rng, _: float, tone: np.ndarray) -> tuple[np.ndarray, np.ndarray | None, int]:
        """A thing of any class for `augment.add`: sprite, its box or None, class. Its size is its own, resampled."""
        nothing = np.zeros((1, 1, 4), np.float32), None, -1
        for _ in range(TRIES):
            label = self.labels[rng.integers(len(self.labels))]
            k, j = self.of[label][rng.integers(len(self.of[label]))]
            found = cut(self.frames.picture(k), self.frames.boxes[k][j])
            if found is None:
                continue
            sprite, box = found
            if rng.random() < TONED:
                opaque = sprite[..., 3:]
                sprite[..., :3] += opaque * (tone - sprite[..., :3].sum((0, 1)) / opaque.sum())
                sprite[..., :3] = np.clip(sprite[..., :3], 0, 255 * opaque)
            factor = float(np.exp(rng.uniform(*np.log(SCALES))))
            h, w = sprite.shape[:2]
            size = max(round(w * factor), 2), max(round(h * factor), 2)
            sprite = cv2.resize(sprite, size, interpolation=cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR)
            box = box * (size[0] / w, size[1] / h, size[0] / w, size[1] / h)
            if rng.random() < 0.5:
                sprite, box = sprite[:, ::-1], np.array([size[0] - box[2], box[1], size[0] - box[0], box[3]])
            return sprite, box.astype(np.float32), label
        return nothing
