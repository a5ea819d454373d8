#!/usr/bin/env python3
"""Trains the recogniser, which says what a track is from its last second, on what `boresight tracks` wrote.

A run is a folder: `recogniser.onnx` (calibrated, interface in README.md), `reliability.svg`, `report.json`, `log.csv`.
"""

import argparse
import copy
import csv
import io
import json
import multiprocessing
import os
import re
import time
import tomllib
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import cv2  # noqa: E402
import numpy as np  # noqa: E402
import onnx  # noqa: E402
import onnxruntime as ort  # noqa: E402
import torch  # noqa: E402
from torch import nn  # noqa: E402
from torch.nn import functional as F  # noqa: E402

import augment as pictures  # noqa: E402
import plot  # noqa: E402
from recogniser_interface import CHIP, CHIP_OVER_BOX, CLASSES, FEATURES, LEAST_CHIP_PX, STEPS  # noqa: E402

AT = {name: k for k, name in enumerate(FEATURES)}
MOTION = slice(AT["sky_known"], AT["position_flutter"] + 1)
NAMED = slice(AT["named_uav"], AT["named_other"] + 1)
BANDS_PX = ((0, 4), (4, 10), (10, 30), (30, 1e9))  # of the newest box
# Rigid classes whose shapes are drawn anew, and how often: the program has few models of each, the world has many.
SHAPES = {"uav": pictures.uav, "aeroplane": pictures.aeroplane, "helicopter": pictures.helicopter}
REDRAWN = 0.4
# How often something is as dark before its background as it was bright, or the reverse: which of them a class shows here is the
# light and the haze of where it flew; in the world it may be either.
RETONED = 0.3
SURE = 0.95  # the laser fires from this one on (`engage.min_uav_probability`)
RENDERED, REAL, REAL_KEPT = 0, 1, 2  # where tracks come from
LIGHTS = ("Day", "LowSun", "Dusk")  # as a scenario's description names it


# --- data ---


@dataclass
class Tracks:
    """Sequences of several runs."""

    chips: np.ndarray  # u8 [M, 24, 24, 3]; the last one is black, for steps that were not seen
    index: np.ndarray  # i64 [N, 16]
    features: np.ndarray  # f32 [N, 16, F]
    labels: np.ndarray  # i64 [N]
    track: np.ndarray  # i64 [N]: sequences of one track (of one run) share a number
    run: np.ndarray  # i64 [N]
    size_px: np.ndarray  # f32 [N]
    light: np.ndarray  # i64 [N]: which of `LIGHTS`; -1 where the scenario does not say
    source: np.ndarray  # i64 [N]: RENDERED, REAL, or REAL_KEPT for clips that the recipe keeps for validation

    def __len__(self) -> int:
        return len(self.labels)

    def only(self, keep: np.ndarray) -> "Tracks":
        return Tracks(self.chips, *(getattr(self, field.name)[keep] for field in fields(self)[1:]))

    def batch(self, rows: np.ndarray) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Chips u8 [B,16,24,24,3], features, mask, labels."""
        index = self.index[rows]
        mask = torch.from_numpy((index >= 0).astype(np.float32))
        return torch.from_numpy(self.chips[index]), torch.from_numpy(self.features[rows]), mask, torch.from_numpy(self.labels[rows])


def load(folders: list[Path], also: Sequence[Path] = (), all_clips: bool = False) -> tuple[Tracks, int]:
    """Every folder below `folders`, then below `also`, that `boresight tracks` finished, and the number of the first
    sequence of `also`. The run is its number in that order; what several detectors made of one clip is one run, since it
    shows the same things. `all_clips`: those that the recipe keeps for validation are like the others."""
    found = [sorted({path.parent for folder in some for path in folder.rglob("sequences.json")}) for some in (folders, also)]
    for some, folders_found in zip((folders, also), found):
        if some and not folders_found:
            raise SystemExit(f"{', '.join(map(str, some))}: no sequences.json below; make some with `boresight tracks`")
    first_also, (found, further) = 0, found
    chips, index, features, labels, track, run, size, light, source = [], [], [], [], [], [], [], [], []
    first = tracks = 0
    runs: dict[object, int] = {}
    for folder in [*found, *further]:
        sheet = json.loads((folder / "sequences.json").read_text())
        number = runs.setdefault(sheet.get("clip", folder), len(runs))
        own = np.load(folder / "chips.npy")
        if tuple(sheet["features"]) != FEATURES or own.shape[1:] != (CHIP, CHIP, 3):
            raise SystemExit(f"{folder}: its features or chips are not those of this version; make it anew")
        rows = sheet["sequences"]
        if not rows:
            continue
        places = np.load(folder / "index.npy").astype(np.int64)
        if places.max(initial=-1) >= len(own) or len(places) != len(rows):
            raise SystemExit(f"{folder}: damaged; delete it and make it anew")
        chips.append(own)
        index.append(np.where(places >= 0, places + first, -1))
        first += len(own)
        features.append(np.load(folder / "features.npy"))
        labels += [CLASSES.index(row["class"]) for row in rows]
        # A track that changes its object, or that was mistaken for another, is several.
        names = {key: tracks + k for k, key in enumerate(dict.fromkeys((row["track"], row["object"]) for row in rows))}
        track += [names[row["track"], row["object"]] for row in rows]
        tracks += len(names)
        run += [number] * len(rows)
        size += [row["size_px"] for row in rows]
        light += [light_of(Path(sheet.get("scenario", "")))] * len(rows)
        source += [RENDERED if "clip" not in sheet else REAL_KEPT if sheet["split"] == "val" and not all_clips else REAL] * len(rows)
        first_also += len(rows) * (folder in found)
    chips.append(np.zeros((1, CHIP, CHIP, 3), np.uint8))
    whole = Tracks(np.concatenate(chips), np.concatenate(index), np.concatenate(features).astype(np.float32),
                   np.array(labels), np.array(track), np.array(run), np.array(size, np.float32), np.array(light), np.array(source))  # fmt: skip
    return whole, first_also


def light_of(scenario: Path) -> int:
    """Which of `LIGHTS` a scenario says that it has."""
    said = tomllib.loads(scenario.read_text()).get("description", "") if scenario.is_file() else ""
    words = set(re.findall(r"\w+", said))
    return next((k for k, name in enumerate(LIGHTS) if name in words), -1)


def track_weights(tracks: Tracks) -> np.ndarray:
    """Every track counts once, whatever its length; the sum is 1."""
    counts = np.bincount(tracks.track)
    weights = 1.0 / counts[tracks.track]
    return weights / weights.sum()


def sampling_weights(tracks: Tracks) -> np.ndarray:
    """Classes alike but for UAVs, which have as much as all others; in a class rendered and real ones alike, and of those
    each track by the root of its length."""
    counts = np.bincount(tracks.track)
    weights = 1.0 / np.sqrt(counts[tracks.track])
    others = len(set(tracks.labels) - {0})
    for k in set(tracks.labels):
        mine = tracks.labels == k
        sources = set(tracks.source[mine])
        for source in sources:
            part = mine & (tracks.source == source)
            weights[part] *= (1.0 if k == 0 else 1.0 / others) / len(sources) / weights[part].sum()
    return weights / weights.sum()


# --- augmentation ---


def augment(chips: np.ndarray, features: torch.Tensor, mask: torch.Tensor, labels: torch.Tensor, rng: np.random.Generator):
    """One batch changed as other shapes, cameras, detectors and gaps would: chips u8 [B,16,24,24,3]."""
    chips, features, mask = chips.copy(), features.clone(), mask.clone()
    for b in range(len(chips)):
        f = features[b]
        seen = mask[b] > 0
        if (shape := SHAPES.get(CLASSES[labels[b]])) and rng.random() < REDRAWN:
            chips[b], log_aspect = redrawn(shape, f[:, AT["log_size_px"]].exp().numpy(), seen.numpy(), rng)
            f[:, AT["log_aspect"]] += log_aspect - f[seen, AT["log_aspect"]].mean()
        elif CLASSES[labels[b]] != "other" and rng.random() < RETONED:
            chips[b] = retoned(chips[b], rng)
        if rng.random() < 0.5:  # mirrored
            chips[b] = chips[b, :, :, ::-1]
            f[:, AT["rate_right"]] *= -1
            f[:, AT["right_sizes"]] *= -1
        keep = torch.ones(STEPS, dtype=torch.bool)
        if rng.random() < 0.4:  # missed in single steps
            keep &= torch.from_numpy(rng.random(STEPS) > rng.uniform(0, 0.6))
        if rng.random() < 0.25:  # unseen for a while
            start = rng.integers(0, STEPS)
            keep[start : start + rng.integers(1, 8)] = False
        if rng.random() < 0.25:  # a young track
            keep[: rng.integers(0, STEPS - 3)] = False
        if int((keep & seen).sum()) >= 3:
            mask[b] *= keep
        if rng.random() < 0.3:  # the camera's motion is not known
            f[:, MOTION] = 0
        if rng.random() < 0.3:  # the detector names nothing but UAVs
            named = f[:, NAMED].sum(1)
            f[:, NAMED] = 0
            f[:, AT["named_uav"]] = named
        f[:, AT["score"]] += rng.normal(0, 0.05)
        f[:, AT["seen_share"]] = f[:, AT["seen_share"]].add(rng.normal(0, 0.05)).clamp(0, 1)
        shift = rng.normal(0, 0.1)
        f[:, [AT["log_size_px"], AT["log_size_mrad"]]] += shift
        f[:, AT["log_aspect"]] += rng.normal(0, 0.05)
        if rng.random() < 0.5:  # another field of view, or one that is not known, as in a clip
            f[:, AT["log_size_mrad"]] += rng.uniform(-2, 2)
        if rng.random() < 0.5:
            stretch(chips[b], f, mask[b], rng.uniform(0.75, 1.3))
        chips[b] = spoilt(chips[b], rng)
    features *= mask[:, :, None]
    return chips, features, mask


def redrawn(shape, size_px: np.ndarray, seen: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """What a rigid thing of another shape of its class would show in place of a track's chips [16,24,24,3]: one drawing, which
    wanders, turns and grows a little over the second, before a background that may pass; its boxes are `size_px` [16] large
    where it was `seen`. Also the logarithm of its width over its height."""
    box_px = float(np.clip(np.median(size_px[seen]), 3, 60)) if seen.any() else 10.0
    side_px = max(CHIP_OVER_BOX * box_px, LEAST_CHIP_PX)
    wide = 2 * round(0.75 * side_px)  # of the camera's pixels, with a margin
    behind = pictures.background(rng, wide)
    drawing, box, _ = shape(rng, box_px, pictures.tone_against(rng, behind, wide / 2, wide / 2, box_px / 2 + 2))
    if box is None:  # all of it is thinner than a pixel
        box = np.array([0, 0, *drawing.shape[1::-1]], np.float32)
    width_px, height_px = (box[2:] - box[:2]).tolist()
    zoom, fit = CHIP / side_px, box_px / max(width_px, height_px)
    off_px = (box[:2] + box[2:] - drawing.shape[1::-1]) / 2
    if zoom < 1:  # so that what is taken from them has no aliases
        behind, drawing = (cv2.GaussianBlur(x, (0, 0), 0.5 / zoom) for x in (behind, drawing))
    turn_deg, growth, unrest_px = rng.normal(0, 4), rng.normal(0, 0.04), abs(rng.normal(0, 0.04)) * box_px
    passing_px = rng.normal(0, 0.3, 2) * side_px * (rng.random() < 0.5)  # in the second
    chips = np.empty((STEPS, CHIP, CHIP, 3), np.float32)
    for k, part in enumerate(np.linspace(-0.5, 0.5, STEPS)):
        shake_px = rng.normal(0, 1, 2) * unrest_px
        chips[k] = seen_by(behind, 0.0, zoom, zoom * (passing_px * part + shake_px), cv2.BORDER_REPLICATE)
        cut = seen_by(drawing, turn_deg * part, zoom * fit * np.exp(growth * part), zoom * (shake_px - fit * off_px), cv2.BORDER_CONSTANT)
        pictures.paste(chips[k], cut, 0, 0)
    return chips.clip(0, 255).astype(np.uint8), float(np.log(width_px / height_px))


def seen_by(picture: np.ndarray, turn_deg: float, zoom: float, shift: np.ndarray, border: int) -> np.ndarray:
    """The middle of a picture as a chip: turned, enlarged, shifted by so many pixels of the chip."""
    middle = (np.array(picture.shape[1::-1]) - 1) / 2  # OpenCV's pixel 0 has its middle at 0
    way = cv2.getRotationMatrix2D(middle.tolist(), turn_deg, zoom)
    way[:, 2] += (CHIP - 1) / 2 - middle + shift
    return cv2.warpAffine(picture, way, (CHIP, CHIP), flags=cv2.INTER_LINEAR, borderMode=border)


def retoned(chips: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """What stands out from its background as more, less or the opposite, of one tone or in its colours."""
    behind = np.median(chips, (1, 2), keepdims=True).astype(np.float32)
    out = chips - behind
    if rng.random() < 0.7:
        out = out.mean(-1, keepdims=True)
    gain = np.exp(rng.normal(0.2, 0.6)) * rng.choice((-1, 1), p=(0.7, 0.3))
    return (behind + gain * out).clip(0, 255).astype(np.uint8)


def stretch(chips: np.ndarray, features: torch.Tensor, mask: torch.Tensor, pace: float) -> None:
    """Time runs faster by `pace`: the newest step stays, older ones are taken from further back."""
    source = np.round(STEPS - 1 - (STEPS - 1 - np.arange(STEPS)) * pace).astype(int)
    there = torch.from_numpy((source >= 0).astype(np.float32))
    source = source.clip(0)
    moved = mask[source] * there
    if int(moved.sum()) < 3:
        return
    chips[:] = chips[source]
    features[:] = features[source]
    mask[:] = moved
    features[:, AT["age_s"]] /= pace
    for name in ("rate_right", "rate_up", "rate_sizes"):
        features[:, AT[name]] = torch.asinh(torch.sinh(features[:, AT[name]]) * pace)


def spoilt(chips: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Gain, offset, colour, blur, noise and JPEG, alike in all steps."""
    x = chips.astype(np.float32)
    if rng.random() < 0.25:
        x[:] = x.mean(-1, keepdims=True)
    else:
        x *= rng.normal(1, 0.05, 3).astype(np.float32)
    middle = x.mean()
    x = (x - middle) * np.exp(rng.normal(0, 0.3)) + middle * np.exp(rng.normal(0, 0.2)) + rng.normal(0, 6)
    if rng.random() < 0.2:
        sigma = float(rng.uniform(0.3, 1.0))
        x = np.stack([cv2.GaussianBlur(step, (0, 0), sigma) for step in x])
    if rng.random() < 0.5:
        x += np.float32(rng.uniform(0.5, 8)) * rng.standard_normal(x.shape, np.float32)
    x = x.clip(0, 255).astype(np.uint8)
    if rng.random() < 0.3:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(30, 90))]
        x = np.stack([cv2.imdecode(cv2.imencode(".jpg", step, quality)[1], cv2.IMREAD_COLOR) for step in x])
    return x


def planes(chips) -> torch.Tensor:
    """u8 [B,16,24,24,3] to f32 [B,16,3,24,24], 0 to 1."""
    return torch.as_tensor(np.ascontiguousarray(chips)).permute(0, 1, 4, 2, 3).float() / 255


# --- network ---


class Recogniser(nn.Module):
    """A small picture network a step, its answer beside the step's features, two convolutions over time, and means and
    maxima over the steps that were seen."""

    def __init__(self, width: int = 48):
        super().__init__()
        self.register_buffer("mean", torch.zeros(len(FEATURES)))
        self.register_buffer("scale", torch.ones(len(FEATURES)))
        self.picture = nn.Sequential(
            nn.Conv2d(3, 8, 3, 2, 1), nn.ReLU(), nn.Conv2d(8, 20, 3, 2, 1), nn.ReLU(),
            nn.Conv2d(20, 32, 3, 2, 1), nn.ReLU(), nn.Flatten(), nn.Linear(32 * 9, 32),
        )  # fmt: skip
        self.step = nn.Linear(32 + 2 + len(FEATURES), width)
        self.time = nn.ModuleList(nn.Conv1d(width + 1, width, 3, padding=1) for _ in range(2))
        self.head = nn.Sequential(nn.Linear(2 * width, 48), nn.ReLU(), nn.Dropout(0.2), nn.Linear(48, len(CLASSES)))

    def learn_scale(self, features: np.ndarray, seen: np.ndarray) -> None:
        rows = features[seen]
        self.mean.copy_(torch.from_numpy(rows.mean(0)))
        self.scale.copy_(torch.from_numpy(rows.std(0).clip(0.05)))
        # Flags and shares stay what they are.
        for name in ("sky_known", *FEATURES[NAMED]):
            self.mean[AT[name]], self.scale[AT[name]] = 0, 1

    def forward(self, chips: torch.Tensor, features: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        batch = chips.shape[0]
        x = chips.reshape(-1, 3, CHIP, CHIP)
        light = x.mean((1, 2, 3), keepdim=True)
        contrast = ((x - light) ** 2).mean((1, 2, 3), keepdim=True).add(1e-6).sqrt()
        shown = self.picture((x - light) / (contrast + 0.03))
        tone = torch.cat([light.flatten(1), contrast.flatten(1).add(0.01).log()], 1)
        # Without the sky's directions the motion is no zero but unknown: the flag tells.
        known = (features - self.mean) / self.scale
        steps = torch.cat([torch.cat([shown, tone], 1).reshape(-1, STEPS, 34), known], 2)
        seen = mask.unsqueeze(1)
        y = F.relu(self.step(steps)).transpose(1, 2) * seen
        for layer in self.time:
            y = y + F.relu(layer(torch.cat([y, seen.expand(-1, 1, -1)], 1))) * seen
        mean = y.sum(2) / seen.sum(2).clamp(min=1)
        most = (y + (seen - 1) * 1e4).amax(2).clamp(min=0)
        return self.head(torch.cat([mean, most], 1))


class Ensemble(nn.Module):
    """The mean of what several models say, as logits: models that learned from other beginnings err apart."""

    def __init__(self, members: list[nn.Module]):
        super().__init__()
        self.members = nn.ModuleList(members)

    def forward(self, chips: torch.Tensor, features: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        return torch.stack([member(chips, features, mask) for member in self.members]).mean(0)


def of_file(graph: onnx.ModelProto) -> list[Recogniser]:
    """The models whose mean a file answers with, as `to_onnx` wrote it: what the export has transposed is put back."""
    found = {t.name: onnx.numpy_helper.to_array(t) for t in graph.graph.initializer}
    steps = [node.input[1] for node in graph.graph.node if node.op_type == "MatMul"]
    members = []
    for k, step in enumerate(steps):
        own = lambda name: found.get(f"model.members.{k}.{name}", found.get(f"model.members.0.{name}"))
        model = Recogniser()
        state = {name: found[step].T if name == "step.weight" else own(name) for name in model.state_dict()}
        model.load_state_dict({name: torch.from_numpy(np.array(value)) for name, value in state.items()})
        members.append(model)
    return members


class Calibrated(nn.Module):
    """Probabilities: the softmax of the logits over a temperature."""

    def __init__(self, model: nn.Module, temperature: float):
        super().__init__()
        self.model, self.temperature = model, temperature

    def forward(self, chips: torch.Tensor, features: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        return torch.softmax(self.model(chips, features, mask) / self.temperature, 1)


# --- measures ---


def logits_of(model: nn.Module, tracks: Tracks) -> torch.Tensor:
    model.eval()
    out = []
    with torch.no_grad():
        for start in range(0, len(tracks), 256):
            chips, features, mask, _ = tracks.batch(np.arange(start, min(start + 256, len(tracks))))
            out.append(model(planes(chips), features, mask))
    return torch.cat(out) if out else torch.zeros(0, len(CLASSES))


def temperature_of(logits: torch.Tensor, labels: np.ndarray, weights: np.ndarray) -> float:
    """The temperature of least weighted cross-entropy, by search over 0.3 to 10."""
    target, w = torch.from_numpy(labels), torch.from_numpy(weights).float()
    loss = lambda t: float((F.cross_entropy(logits / t, target, reduction="none") * w).sum())
    return float(min(np.geomspace(0.3, 10, 200), key=loss))


def reliability(p: np.ndarray, truth: np.ndarray, weights: np.ndarray, bins: int = 10) -> list[dict]:
    """Mean probability and share of truths in bins of equal width, and the weight of each."""
    rows = []
    for k in range(bins):
        inside = (p >= k / bins) & ((p < (k + 1) / bins) | (k == bins - 1))
        weight = float(weights[inside].sum())
        if weight > 0:
            share = lambda x: float((x[inside] * weights[inside]).sum() / weight)
            rows.append({"p": share(p), "share": share(truth.astype(float)), "weight": weight, "sequences": int(inside.sum())})
    return rows


def measures(p: np.ndarray, tracks: Tracks) -> dict:
    """Figures of probabilities [N, 6]; every track counts once."""
    w = track_weights(tracks)
    labels = tracks.labels
    onehot = np.eye(len(CLASSES))[labels]
    uav = labels == 0
    rows = reliability(p[:, 0], uav, w)
    confusion = {name: {} for name in CLASSES}
    for i, name in enumerate(CLASSES):
        mine = labels == i
        for j, other in enumerate(CLASSES):
            if mine.any():
                confusion[name][other] = round(float(w[mine & (p.argmax(1) == j)].sum() / w[mine].sum()), 4)
    mean = lambda x, keep: float((x[keep] * w[keep]).sum() / w[keep].sum()) if keep.any() else None
    part = lambda inside: {
        "sequences": int(inside.sum()), "uavs": len(set(tracks.track[inside & uav].tolist())),
        "others": len(set(tracks.track[inside & ~uav].tolist())), "brier_uav": mean((p[:, 0] - uav) ** 2, inside),
        "uav_recall": mean(p[:, 0] >= 0.5, inside & uav), "false_uav": mean(p[:, 0] >= 0.5, inside & ~uav),
        "surely_uav": mean(p[:, 0] >= SURE, inside & uav), "surely_false": mean(p[:, 0] >= SURE, inside & ~uav),
    }  # fmt: skip
    bands = [{"from_px": low, "to_px": None if high > 1e8 else high} | part((tracks.size_px >= low) & (tracks.size_px < high))
             for low, high in BANDS_PX]  # fmt: skip
    sources = {"rendered": part(tracks.source == RENDERED), "real": part(tracks.source == REAL), "real, kept": part(tracks.source == REAL_KEPT)}
    lights = {name: part(tracks.light == k) for k, name in enumerate(LIGHTS) if (tracks.light == k).any()}
    return {
        "sequences": len(tracks), "tracks": len(set(tracks.track.tolist())), "runs": len(set(tracks.run.tolist())),
        "tracks_by_class": {n: len(set(tracks.track[labels == i].tolist())) for i, n in enumerate(CLASSES)},
        "brier": float((((p - onehot) ** 2).sum(1) * w).sum()), "brier_uav": float(((p[:, 0] - uav) ** 2 * w).sum()),
        "brier_uav_of_the_share": float(((mean(uav, np.ones_like(uav)) - uav) ** 2 * w).sum()),
        "calibration_error_uav": sum(r["weight"] * abs(r["p"] - r["share"]) for r in rows),
        "accuracy": float(((p.argmax(1) == labels) * w).sum()),
        "uav_recall": mean(p[:, 0] >= 0.5, uav),
        "false_uav": {n: mean(p[:, 0] >= 0.5, labels == i) for i, n in enumerate(CLASSES) if i},
        "confusion": confusion, "by_size": bands, "by_light": lights,
        "by_source": {name: row for name, row in sources.items() if row["sequences"]}, "reliability_uav": rows,
    }  # fmt: skip


# --- export ---


def to_onnx(model: nn.Module, temperature: float, training: dict) -> bytes:
    """The calibrated model as ONNX, opset 17, with the interface's metadata."""
    whole = Calibrated(model, temperature).eval()
    example = (torch.zeros(2, STEPS, 3, CHIP, CHIP), torch.zeros(2, STEPS, len(FEATURES)), torch.ones(2, STEPS))
    names = ["chips", "features", "mask"]
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            whole, example, buffer, opset_version=17, dynamo=False, do_constant_folding=True, input_names=names,
            output_names=["probabilities"], dynamic_axes={n: {0: "batch"} for n in (*names, "probabilities")},
        )  # fmt: skip
    graph = onnx.load_from_string(buffer.getvalue())
    for node in graph.graph.node:
        node.doc_string = ""
    dims = graph.graph.output[0].type.tensor_type.shape
    del dims.dim[:]
    dims.dim.add().dim_param = "batch"
    dims.dim.add().dim_value = len(CLASSES)
    graph.ir_version, graph.producer_name, graph.producer_version = 8, "boresight", ""
    onnx.helper.set_model_props(graph, {
        "boresight.recogniser": "1", "classes": json.dumps(CLASSES), "features": json.dumps(FEATURES),
        "temperature": f"{temperature:.4g}", "training": json.dumps(training),
        "description": "What a track is, from its last second.",
    })  # fmt: skip
    onnx.checker.check_model(graph, full_check=True)
    return graph.SerializeToString(deterministic=True)


def session(graph: bytes) -> ort.InferenceSession:
    options = ort.SessionOptions()
    options.intra_op_num_threads = 1
    return ort.InferenceSession(graph, options, providers=["CPUExecutionProvider"])


def compare(model: nn.Module, temperature: float, graph: bytes, tracks: Tracks) -> float:
    """Largest difference of probabilities between PyTorch and ONNX Runtime; `RuntimeError` above 1e-4."""
    rows = np.linspace(0, len(tracks) - 1, min(64, len(tracks))).astype(int)
    chips, features, mask, _ = tracks.batch(rows)
    chips = planes(chips)
    with torch.no_grad():
        ours = Calibrated(model, temperature).eval()(chips, features, mask).numpy()
    theirs = session(graph).run(None, {"chips": chips.numpy(), "features": features.numpy(), "mask": mask.numpy()})[0]
    worst = float(np.abs(ours - theirs).max())
    if worst > 1e-4:
        raise RuntimeError(f"PyTorch and ONNX Runtime differ by {worst}")
    return worst


def answers(graph: bytes, tracks: Tracks) -> np.ndarray:
    """Probabilities [N, 6] by a file."""
    runtime, found = session(graph), []
    for start in range(0, len(tracks), 64):
        chips, features, mask, _ = tracks.batch(np.arange(start, min(start + 64, len(tracks))))
        inputs = {"chips": planes(chips).numpy(), "features": features.numpy(), "mask": mask.numpy()}
        found.append(runtime.run(None, inputs)[0])
    return np.concatenate(found)


def milliseconds(graph: bytes, tracks: int = 8, runs: int = 50) -> float:
    """Median processor time of a question about some tracks on one thread."""
    runtime = session(graph)
    rng = np.random.default_rng(1)
    inputs = {
        "chips": rng.random((tracks, STEPS, 3, CHIP, CHIP), np.float32), "mask": np.ones((tracks, STEPS), np.float32),
        "features": rng.random((tracks, STEPS, len(FEATURES)), np.float32),
    }  # fmt: skip
    times = []
    for _ in range(runs):
        start = time.process_time()
        runtime.run(None, inputs)
        times.append(time.process_time() - start)
    return 1e3 * float(np.median(times))


# --- training ---


def split(tracks: Tracks, first_also: int, held_out: float, seed: int) -> tuple[Tracks, Tracks, Tracks]:
    """Training, calibration and test, by whole runs; the clips that the recipe keeps are all test. Sequences from `first_also`
    on are for training alone, and left out where they are of a run of the others or of a clip that is kept."""
    also = np.arange(len(tracks)) >= first_also
    kept = np.unique(tracks.run[tracks.source == REAL_KEPT])
    runs = np.setdiff1d(np.unique(tracks.run[~also]), kept)
    np.random.default_rng(seed).shuffle(runs)
    count = max(1, round(held_out * len(runs)))
    test, calibration = np.concatenate([runs[:count], kept]), runs[count : 2 * count]
    inside = lambda some: np.isin(tracks.run, some)
    learn = ~inside(np.concatenate([test, calibration]))
    return tracks.only(learn), tracks.only(inside(calibration) & ~also), tracks.only(inside(test) & ~also)


def train(tracks: Tracks, steps: int, batch: int, lr: float, seed: int, start: Recogniser | None, log: list[dict]) -> Recogniser:
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    model = copy.deepcopy(start) if start else Recogniser()
    if not start:
        model.learn_scale(tracks.features, tracks.index >= 0)
    average = copy.deepcopy(model)
    optimiser = torch.optim.AdamW(model.parameters(), lr=lr, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, lr, total_steps=steps, pct_start=0.1)
    weights, mean = sampling_weights(tracks), None
    started = time.monotonic()
    for step in range(1, steps + 1):
        rows = rng.choice(len(tracks), batch, p=weights)
        chips, features, mask, labels = tracks.batch(rows)
        chips, features, mask = augment(chips.numpy(), features, mask, labels, rng)
        model.train()
        loss = F.cross_entropy(model(planes(chips), features, mask), labels, label_smoothing=0.02)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(model.parameters(), 5.0)
        optimiser.step()
        schedule.step()
        # The mean over the last steps, of which there are few at first.
        share = max(0.002, 1.0 / (1 + 0.1 * step))
        with torch.no_grad():
            for mean_of, own in zip(average.parameters(), model.parameters()):
                mean_of.lerp_(own, share)
        mean = loss.item() if mean is None else 0.98 * mean + 0.02 * loss.item()
        if step % 100 == 0 or step == steps:
            log.append({"seed": seed, "step": step, "loss": round(mean, 4), "seconds": round(time.monotonic() - started, 1)})
            print(f"seed {seed}, step {step}: loss {mean:.3f}, {log[-1]['seconds']} s", flush=True)
    return average.eval()


def member(work: tuple[Tracks, int, int, float, int, Recogniser | None]) -> tuple[Recogniser, list[dict]]:
    """One model of an ensemble, trained on one thread."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    log: list[dict] = []
    return train(*work, log), log


def blended(model: Recogniser, start: Recogniser, keep: float) -> Recogniser:
    """A model between the one it began as, of which it keeps a share, and what it became (Wortsman et al., Robust fine-tuning of zero-shot
    models, CVPR 2022): new tracks teach it, and what they lack is not forgotten."""
    both = copy.deepcopy(model)
    with torch.no_grad():
        for own, first in zip(both.parameters(), start.parameters()):
            own.lerp_(first, keep)
    return both


def ensemble(
    tracks: Tracks, seeds: range, steps: int, batch: int, lr: float, processes: int, start: list[Recogniser] | None = None
) -> tuple[Ensemble, list[dict]]:
    """A model for each seed, several at once, and their logs; each begins as one of `start`, if given."""
    works = [(tracks, steps, batch, lr, seed, start[k % len(start)] if start else None) for k, seed in enumerate(seeds)]
    with multiprocessing.get_context("fork").Pool(min(processes, len(works))) as pool:
        found = pool.map(member, works, chunksize=1)
    return Ensemble([model for model, _ in found]).eval(), [row for _, log in found for row in log]


def keeping(learned: Ensemble, start: list[Recogniser] | None, shares: list[float], calibrate: Tracks) -> tuple[Ensemble, float, dict[float, float]]:
    """Of the ensembles that keep such shares of what they began as, the one that errs least in saying UAV or not on the runs that set
    the temperature (Brier score, rendered and real runs alike); its temperature; and the scores of all shares."""
    weights, found = track_weights(calibrate), {}
    for share in shares:
        begun = [start[k % len(start)] for k in range(len(learned.members))] if start else []
        model = Ensemble([blended(own, first, share) for own, first in zip(learned.members, begun)]).eval() if start else learned
        logits = logits_of(model, calibrate)
        temperature = temperature_of(logits, calibrate.labels, weights)
        of_sources = measures(torch.softmax(logits / temperature, 1).numpy(), calibrate)["by_source"].values()
        found[share] = float(np.mean([part["brier_uav"] for part in of_sources])), model, temperature
    best = min(found, key=lambda share: found[share][0])
    return *found[best][1:], {share: score for share, (score, *_) in found.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, action="append", required=True, help="folder of `boresight tracks`; may be repeated")
    parser.add_argument("--also", type=Path, action="append", default=[],
                        help="the same, to learn from alone: what --init has learned from measures nothing")  # fmt: skip
    parser.add_argument("--out", type=Path, required=True, help="folder of the run")
    parser.add_argument("--steps", type=int, default=6000)
    parser.add_argument("--batch", type=int, default=64)
    parser.add_argument("--lr", type=float, default=3e-3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--held-out", type=float, default=0.15, help="share of the runs for calibration, and as many for the test")
    parser.add_argument("--members", type=int, default=4, help="models whose mean it is")
    parser.add_argument("--processes", type=int, default=max(1, os.cpu_count() or 1), help="models trained at once")
    parser.add_argument("--init", type=Path, help="a recogniser.onnx from whose weights the models begin")
    parser.add_argument("--keep", type=float, nargs="+", default=[0.0], help="share of those weights in the models at the end, 0 to 1; of several the best")
    parser.add_argument("--all-clips", action="store_true",
                        help="learn from the clips that the recipe keeps for validation, too: for the file to be shipped, after the same without it was measured on them")  # fmt: skip
    parser.add_argument("--beside", type=Path, help="a recogniser.onnx that is measured on the same sequences")
    args = parser.parse_args()
    if not all(0 <= share <= 1 for share in args.keep) or (any(args.keep) and not args.init):
        raise SystemExit(f"--keep {' '.join(f'{share:g}' for share in args.keep)}: give shares from 0 to 1, and --init with the file that they are of")
    learn, calibrate, test = split(*load(args.data, args.also, args.all_clips), args.held_out, args.seed)
    for name, part in (("training", learn), ("calibration", calibrate), ("test", test)):
        by_class = {n: len(set(part.track[part.labels == i].tolist())) for i, n in enumerate(CLASSES)}
        print(f"{name}: {len(set(part.run.tolist()))} runs, {len(part)} sequences; tracks {by_class}")
    args.out.mkdir(parents=True, exist_ok=True)
    start = of_file(onnx.load(args.init)) if args.init else None
    learned, log = ensemble(learn, range(args.seed, args.seed + args.members), args.steps, args.batch, args.lr, args.processes, start)
    model, temperature, scores = keeping(learned, start, args.keep, calibrate)
    recipe = {"steps": args.steps, "batch": args.batch, "lr": args.lr, "seed": args.seed, "members": args.members, "keep": min(scores, key=scores.get), "runs": len(set(learn.run.tolist())),
              "sequences": len(learn)}  # fmt: skip
    graph = to_onnx(model, temperature, recipe)
    worst = compare(model, temperature, graph, test)
    p = torch.softmax(logits_of(model, test) / temperature, 1).numpy()
    report = {
        "parameters": sum(x.numel() for x in model.parameters()), "temperature": temperature,
        "ms_8_tracks_one_thread": round(milliseconds(graph), 2), "training": recipe, "brier_uav_by_share_kept": scores, "test": measures(p, test),
    }  # fmt: skip
    if args.beside:
        report["beside"] = measures(answers(args.beside.read_bytes(), test), test)
    (args.out / "recogniser.onnx").write_bytes(graph)
    (args.out / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    with (args.out / "log.csv").open("w") as file:
        writer = csv.DictWriter(file, log[0].keys())
        writer.writeheader()
        writer.writerows(log)
    plot.reliability(report["test"]["reliability_uav"], args.out / "reliability.svg", f"{len(test)} sequences of runs held out")
    shown = {name: {k: v for k, v in report[name].items() if k != "reliability_uav"} for name in ("test", "beside") if name in report}
    print(json.dumps(report | shown, indent=1))
    print(f"{args.out / 'recogniser.onnx'}: {len(graph)} bytes, differs from PyTorch by {worst:.1e}")


if __name__ == "__main__":
    main()
