"""Checks of the training package: `pytest training/test_training.py`, half a minute on two cores."""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # spinning threads starve each other on a busy machine

import torch  # noqa: E402

import augment
import export
import figures
import from_onnx
import graft
import models
import pack
import quick_eval
import table1
import train
from convnets import nwd
from data import Crops, Frames, clip_boxes, collate, false_alarms
from preprocess import native
from verdict import UAVS, any_of, verdict

HERE = Path(__file__).resolve().parent
NETS = ("boresight-p2", "boresight-p2-roi", "yolo-n")


def planted(size: int = 96) -> tuple[torch.Tensor, list[dict]]:
    """Two crops, each with one dark square and one bright bar on grey: images [2,3,H,W] and their targets."""
    images, targets = torch.full((2, 3, size, size), 0.6), []
    for k, (x, y) in enumerate(((30, 22), (60, 57))):
        images[k, :, y : y + 8, x : x + 12] = 0.1
        images[k, :, 80:84, 8:30] = 0.9
        boxes = torch.tensor([[x, y, x + 12, y + 8], [8, 80, 30, 84]], dtype=torch.float32)
        targets.append({"boxes": boxes, "labels": torch.tensor([1, 2])})
    return images, targets


@pytest.fixture(scope="module", params=NETS)
def overfitted(request) -> tuple[torch.nn.Module, list[float]]:
    torch.manual_seed(3)
    torch.set_num_threads(1)
    model = models.build(request.param)
    optimizer = torch.optim.AdamW(model.parameters(), 4e-3)
    images, targets = planted()
    losses = []
    for step in range(90):
        for group in optimizer.param_groups:
            group["lr"] = 4e-3 * min(1, (step + 1) / 10)
        loss = model.loss(images, targets)["total"]
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 10)
        optimizer.step()
        losses.append(float(loss.detach()))
    for module in model.modules():  # 70 steps are few for running means of momentum 0.03
        if isinstance(module, torch.nn.BatchNorm2d):
            module.momentum = 0.5
    with torch.no_grad():
        for _ in range(10):
            model(images)
    return model.eval(), losses


def test_overfits_and_finds_the_planted_targets(overfitted):
    model, losses = overfitted
    assert losses[-1] < 0.3 * losses[0]
    images, targets = planted()
    for k in range(2):
        with torch.no_grad():
            boxes, scores, labels = (x[0] for x in model.decode(images[k : k + 1])[:3])
        assert (scores.diff() <= 0).all() and boxes.shape == (len(scores), 4)
        for box, label in zip(targets[k]["boxes"], targets[k]["labels"]):
            overlap = quick_eval.iou(boxes[:2].numpy(), box[None].numpy())[:, 0]
            assert overlap.max() > 0.6
            assert labels[int(overlap.argmax())] == label
        assert scores[1] > 1.5 * scores[2]  # nothing else comes near


def test_export_agrees_and_carries_the_interface(overfitted):
    model, _ = overfitted
    classes = list(models.CLASSES)
    graph = export.to_onnx(model, classes, 0.4, "test", {"steps": 70})
    session = export.session(graph)
    meta = session.get_modelmeta().custom_metadata_map
    assert meta["boresight.interface"] == "1" and json.loads(meta["classes"]) == classes
    assert meta["preprocess"] == "native" and float(meta["score_threshold"]) == 0.4
    assert [i.name for i in session.get_inputs()] == ["image"] and session.get_inputs()[0].shape[:2] == ["batch", 3]
    outputs = [(o.name, o.type, len(o.shape)) for o in session.get_outputs()]
    assert outputs[:3] == [("boxes", "tensor(float)", 3), ("scores", "tensor(float)", 2), ("labels", "tensor(int64)", 2)]
    assert outputs[3:] == ([("centres", "tensor(float)", 3)] if model.name.startswith("boresight-p2") else [])
    assert export.compare(model, graph, 1) > 0


def test_compare_fails_loudly(overfitted):
    model, _ = overfitted
    graph = export.to_onnx(model, list(models.CLASSES), 0.4, "test", {})
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.mul_(1.02)
    with pytest.raises(RuntimeError, match="differ"):
        export.compare(model, graph, 1)


def test_sizes_of_the_nets():
    count = {n: sum(p.numel() for p in models.build(n).parameters()) / 1e6 for n in NETS}
    assert 0.3 < count["boresight-p2"] < 0.6 and 2.6 < count["yolo-n"] < 2.9
    with pytest.raises(ValueError, match="no model 'x'"):
        models.build("x")


@pytest.mark.parametrize("name", NETS)
def test_pictures_without_targets_teach(name):
    torch.manual_seed(1)
    model = models.build(name)
    nothing = {"boxes": torch.zeros(0, 4), "labels": torch.zeros(0, dtype=torch.int64)}
    loss = model.loss(torch.rand(2, 3, 64, 64), [nothing, nothing])["total"]
    loss.backward()
    assert torch.isfinite(loss) and all(p.grad is not None for p in model.parameters())


def test_ignored_regions_do_not_teach():
    torch.manual_seed(1)
    model = models.build("boresight-p2")
    with torch.no_grad():
        model.out.bias[0] = 2.0  # sure of a target everywhere
    nothing = {"boxes": torch.zeros(0, 4), "labels": torch.zeros(0, dtype=torch.int64)}
    all_of_it = nothing | {"ignore": torch.tensor([[0.0, 0.0, 64.0, 64.0]])}
    image = torch.rand(1, 3, 64, 64)
    assert model.loss(image, [nothing])["heat"] > 1
    assert model.loss(image, [all_of_it])["heat"] == 0


def test_nwd_of_worked_boxes():
    a = torch.tensor([[10.0, 10.0, 20.0, 16.0]])
    assert nwd(a, a, 10.0).item() == pytest.approx(1, abs=1e-3)
    # Centre 3 right and 4 down, 4 px wider: sqrt(9 + 16 + 4) = 5.385.
    b = torch.tensor([[11.0, 14.0, 25.0, 20.0]])
    assert nwd(a, b, 10.0).item() == pytest.approx(np.exp(-0.5385), abs=1e-4)


def test_samples_depend_on_their_number_alone():
    one, two = Crops(None, 5), Crops(None, 5)
    straight = [one[n] for n in (0, 1, 2)]
    for n in (2, 0, 1):
        picture, target = two[n]
        assert torch.equal(picture, straight[n][0]) and torch.equal(target["boxes"], straight[n][1]["boxes"])
    assert not torch.equal(Crops(None, 6)[0][0], straight[0][0])
    images, targets = collate(straight)
    assert images.shape == (3, 256, 256, 3) and images.dtype == torch.uint8 and len(targets) == 3


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A COCO folder of six 640 x 480 frames: a coloured rectangle of 9 x 5 px each but in the last."""
    root = tmp_path_factory.mktemp("set") / "train"
    (root / "images").mkdir(parents=True)
    rng = np.random.default_rng(2)
    images, annotations = [], []
    for k in range(6):
        picture = rng.integers(100, 120, (480, 640, 3), dtype=np.uint8)
        if k < 5:
            x, y = int(rng.integers(20, 600)), int(rng.integers(20, 440))
            picture[y : y + 5, x : x + 9] = (0, 0, 255)
            annotations.append({"id": k + 1, "image_id": k + 1, "category_id": 2, "bbox": [x, y, 9, 5], "aim": [x + 4.5, y + 2.5]})
        cv2.imwrite(str(root / "images" / f"{k}.png"), picture[..., ::-1])
        images.append({"id": k + 1, "file_name": f"images/{k}.png", "width": 640, "height": 480})
    categories = [{"id": i + 1, "name": n} for i, n in enumerate(models.CLASSES)]
    (root / "annotations.json").write_text(json.dumps({"images": images, "annotations": annotations, "categories": categories}))
    return root.parent


def test_crops_keep_the_box_on_its_target(folder, monkeypatch):
    frames = Frames(folder / "train")
    crops = Crops(frames, 3, procedural=0.0, negatives=0.0)
    seen = 0
    for n in range(12):
        rng = np.random.default_rng([3, n])
        rng.random()  # the draw between rendered and procedural
        picture, boxes, labels, ignore, aims = crops.cut(rng)
        blue = (picture[..., 2] - picture[..., 0]) > 128
        if labels.tolist() == [1]:  # not where a second, procedural UAV was put in
            seen += 1
            ys, xs = np.nonzero(blue)
            drawn = np.array([xs.min(), ys.min(), xs.max() + 1, ys.max() + 1])
            assert np.abs(boxes[0] - drawn).max() < 1.0
            whole = np.ptp(boxes[0, [0, 2]]) > 1.5 * np.ptp(boxes[0, [1, 3]])  # not cut off by the crop
            assert not whole or np.abs(aims[0] - (boxes[0, :2] + boxes[0, 2:]) / 2).max() < 0.5
    assert seen >= 6
    again = Frames(folder / "train")  # from the cache
    assert all(np.array_equal(again.picture(k), frames.picture(k)) for k in range(6)) and frames.empty == [5]
    monkeypatch.setattr(augment, "add_uavs", lambda rng, picture, count, boxes, labels: (boxes, labels))
    monkeypatch.setattr(augment, "add_flyers", lambda rng, picture, boxes, labels: (boxes, labels))
    empty = Crops(frames, 3, procedural=0.0, negatives=1.0)
    assert sum(len(empty[n][1]["boxes"]) for n in range(5)) == 0


def test_crops_come_from_each_source_by_its_share(folder, tmp_path):
    for part in ("rendered", "both"):
        (tmp_path / part).mkdir()
        coco = json.loads((folder / "train" / "annotations.json").read_text())
        for image in coco["images"]:
            image["file_name"] = str(folder / "train" / image["file_name"])
            image["source"] = "real" if part == "both" and image["id"] <= 2 else "rendered"
        (tmp_path / part / "annotations.json").write_text(json.dumps(coco))
    both = Frames(tmp_path / "both")
    assert both.real.tolist() == [True, True, False, False, False, False]
    used: list[int] = []
    whole = both.picture
    both.picture = lambda k: used.append(k) or whole(k)
    for real, low, high in ((0.0, 0, 0), (0.25, 15, 45), (1.0, 120, 120)):
        crops = Crops(both, 3, procedural=0.0, real=real)
        assert (crops.donors is None) == (real == 0)  # rendered alone: no real pixel at all
        crops.donors = None
        used.clear()
        for n in range(120):
            crops.cut(np.random.default_rng(n))
        assert low <= sum(k < 2 for k in used) <= high
    for real in (0.0, 0.5, 1.0):  # a set of one source is cut from that alone
        rendered = Crops(Frames(tmp_path / "rendered"), 3, real=real)
        assert len(rendered.pools) == 1 and rendered.procedural < 1 and rendered.donors is None


def filmed(tmp_path: Path) -> Frames:
    """Four real frames: a dark bar of 14 x 6 px with a half-dark row below it before a slope of sky, alone; before noise; at the
    edge; beside another."""
    (tmp_path / "images").mkdir()
    rng, images, annotations = np.random.default_rng(4), [], []
    for k, places in enumerate(([(100, 60)], [(100, 60)], [(1, 60)], [(100, 60), (180, 60)])):
        sky = 150 + 0.2 * np.arange(240)[:, None, None] + np.zeros((240, 320, 3)) + rng.normal(0, 12 if k == 1 else 0.5, (240, 320, 3))
        for x, y in places:
            sky[y : y + 6, x : x + 14] = (30, 40, 50)
            sky[y + 6, x : x + 14] = sky[y + 6, x : x + 14] / 2 + 20
            annotations.append({"id": len(annotations), "image_id": k, "category_id": 5, "bbox": [x, y, 14, 7]})
        cv2.imwrite(str(tmp_path / f"images/{k}.png"), sky.clip(0, 255).astype(np.uint8)[..., ::-1])
        images.append({"id": k, "file_name": f"images/{k}.png", "width": 320, "height": 240, "source": "real"})
    categories = [{"id": i + 1, "name": n} for i, n in enumerate(models.CLASSES)]
    (tmp_path / "annotations.json").write_text(json.dumps({"images": images, "annotations": annotations, "categories": categories}))
    return Frames(tmp_path)


def test_a_real_thing_is_cut_out_before_clear_sky_and_put_before_another(tmp_path):
    frames = filmed(tmp_path)
    sprite, box = graft.cut(frames.picture(0), frames.boxes[0][0])
    x0, y0, x1, y1 = box.astype(int)
    assert (x1 - x0, y1 - y0) == (14, 7)
    opaque = sprite[..., 3]
    assert opaque[y0 : y0 + 6, x0:x1].min() > 0.95 and np.abs(opaque[y0 + 6, x0:x1] - 0.5).max() < 0.15
    around = np.ones(opaque.shape, bool)
    around[y0:y1, x0:x1] = False
    assert opaque[around].max() < 0.01  # neither sky nor its noise goes along
    green = np.full((*opaque.shape, 3), (0, 200, 0), np.float32)
    augment.paste(green, sprite, 0, 0)
    assert np.abs(green[y0 : y0 + 6, x0:x1] - (30, 40, 50)).max() < 8
    assert graft.cut(frames.picture(1), frames.boxes[1][0]) is None  # before noise
    assert graft.cut(frames.picture(2), frames.boxes[2][0]) is None  # no sky on one side
    donors = graft.Donors(frames)
    assert donors.of == {4: [(0, 0), (1, 0), (2, 0)]}  # what has company is not taken
    found = 0
    for n in range(20):
        made, box, label = donors.maker(np.random.default_rng(n), 9.0, np.array([90.0, 90.0, 90.0]))
        if box is None:
            continue
        found += 1
        assert label == 4 and made.shape[2] == 4 and np.ptp(box[[0, 2]]) == pytest.approx(2 * np.ptp(box[[1, 3]]), rel=0.25)
        ys, xs = np.nonzero(made[..., 3] > 0.3)
        assert np.abs(np.array([xs.min(), ys.min(), xs.max() + 1, ys.max() + 1]) - box).max() < 1.6
    assert found >= 15


def test_nothing_to_cut_out_is_no_fault(tmp_path):
    filmed(tmp_path)
    coco = json.loads((tmp_path / "annotations.json").read_text())
    coco["images"] = coco["images"][3:]  # two things in one frame
    coco["annotations"] = [a for a in coco["annotations"] if a["image_id"] == 3]
    (tmp_path / "annotations.json").write_text(json.dumps(coco))
    crops = Crops(Frames(tmp_path), 3, procedural=0.0)
    assert crops.donors is None and len(crops[1][1]["boxes"]) >= 0


def test_crops_get_real_things(tmp_path):
    crops = Crops(filmed(tmp_path), 3, procedural=1.0, negatives=1.0, real=0.5)
    labels = [label for n in range(60) for label in crops[n][1]["labels"].tolist()]
    crops.donors = None
    without = [label for n in range(60) for label in crops[n][1]["labels"].tolist()]
    assert labels.count(4) >= without.count(4) + 5


def test_crops_about_false_alarms(folder, tmp_path):
    frames = Frames(folder / "train")
    file = tmp_path / "hard.json"
    file.write_text(json.dumps({"data": frames.digest, "boxes": [[5, 300, 200, 308, 206, 0.5]]}))
    hard = false_alarms(file, frames)
    marked = frames.picture(5).copy()
    marked[200:206, 300:308] = (255, 0, 0)
    crops = Crops(frames, 3, procedural=0.0, hard=hard)
    whole = frames.picture
    frames.picture = lambda k: marked if k == 5 else whole(k)
    shown = 0
    for n in range(60):
        picture, boxes, *_ = crops.cut(np.random.default_rng(n))
        shown += bool(((picture[..., 0] - picture[..., 2]) > 128).any())
    assert 10 <= shown <= 30  # 30 % of 60, give or take
    file.write_text(json.dumps({"data": "another", "boxes": []}))
    with pytest.raises(ValueError, match="another data set"):
        false_alarms(file, frames)


def test_cut_off_boxes_become_regions_to_ignore():
    boxes = np.array([[10, 10, 20, 20], [-6, 30, 4, 36], [252, 40, 262, 50], [300, 0, 310, 9]], np.float32)
    kept, labels, ignore = clip_boxes(boxes, np.arange(4), np.zeros((0, 4), np.float32), 256)
    assert kept.tolist() == [[10, 10, 20, 20]] and labels.tolist() == [0]
    assert ignore.tolist() == [[0, 30, 4, 36], [252, 40, 256, 50]]


def test_sprite_box_is_tight():
    rng = np.random.default_rng(4)
    for size in (6, 14, 40):
        for _ in range(10):
            sprite, box, label = augment.uav(rng, size, np.array([10, 10, 10], np.float32))
            alpha = sprite[..., 3]
            x0, y0, x1, y1 = box
            cols, rows = np.nonzero(alpha.sum(0) >= augment.COVERED)[0], np.nonzero(alpha.sum(1) >= augment.COVERED)[0]
            assert cols[0] <= x0 < cols[0] + 1 and cols[-1] < x1 <= cols[-1] + 1
            assert rows[0] <= y0 < rows[0] + 1 and rows[-1] < y1 <= rows[-1] + 1
            assert label in (0, 1, 2) and alpha.max() <= 1 + 1e-5 and (sprite[..., :3] <= 255 * alpha[..., None] + 1e-2).all()


@pytest.mark.parametrize("maker, label", [(augment.bird, "bird"), (augment.aeroplane, "aeroplane"), (augment.helicopter, "helicopter")])
def test_what_is_no_uav_is_named(maker, label):
    rng = np.random.default_rng(5)
    for size in (8, 30):
        for _ in range(10):
            sprite, box, kind = maker(rng, size, np.array([90, 80, 70], np.float32))
            assert models.CLASSES[kind] == label and kind >= UAVS
            assert (sprite[..., :3] <= 255 * sprite[..., 3:] + 1e-2).all()
            assert box is not None and 0.1 * size < (box[2:] - box[:2]).max() < 1.7 * size


def test_a_bird_does_not_raise_a_uavs_score():
    shares = torch.tensor([[0.3, 0.25, 0.05, 0.4, 0, 0, 0, 0], [0.1, 0.05, 0.1, 0.35, 0.4, 0, 0, 0], [0.1, 0.25, 0, 0.65, 0, 0, 0, 0]])
    labels, share = verdict(shares)
    assert labels.tolist() == [0, 4, 1] and share.tolist() == pytest.approx([0.6, 0.75, 0.35])
    labels, score = any_of(torch.tensor([[0.5, 0.5, 0.0, 0.7, 0, 0, 0, 0], [0.1, 0, 0, 0.2, 0.2, 0, 0, 0]]))
    assert labels.tolist() == [0, 3] and score.tolist() == pytest.approx([0.75, 0.36])
    assert verdict(torch.tensor([[0.2, 0.5, 0.3]]))[1].tolist() == [1.0]  # nothing but UAVs


def test_weights_come_back_from_onnx(overfitted, tmp_path):
    model, _ = overfitted
    path = tmp_path / "model.onnx"
    path.write_bytes(export.to_onnx(model, list(models.CLASSES), 0.4, "test", {"model": model.name}))
    again, _ = from_onnx.read(path)
    images, _ = planted()
    with torch.no_grad():
        for ours, theirs in zip(model.decode(images)[:2], again.decode(images)[:2]):
            assert (ours[:, :2] - theirs[:, :2]).abs().max() < 1e-2
    torch.save({"ema": again.state_dict()}, tmp_path / "start.pt")
    fewer = models.build(model.name, 3)
    train.load_weights(fewer, tmp_path / "start.pt")
    if model.name == "boresight-p2-roi":  # the rows after the classes are the last two of either
        assert torch.equal(fewer.say.weight[-2:], again.say.weight[-2:]) and torch.equal(fewer.say.weight[:8], again.say.weight[:8])


def test_a_packed_set_holds_the_windows(folder, tmp_path):
    pack.pack(folder, tmp_path / "parts", 320, 90, 40, 1, 1)
    pack.unpack([tmp_path / "parts/part-0.zip"], tmp_path / "set")
    frames = Frames(tmp_path / "set" / "train")
    assert frames.names == list(models.CLASSES) and len(frames.targets) >= 5
    for k, j in frames.targets:
        x0, y0, x1, y1 = np.round(frames.boxes[k][j]).astype(int)
        inside = frames.picture(k)[y0:y1, x0:x1].astype(float).mean((0, 1))
        assert inside[2] - inside[0] > 100  # the blue target lies where its box does
    (tmp_path / "both/train").mkdir(parents=True)
    filmed(tmp_path / "both/train")
    (tmp_path / "both/dataset.json").write_text(json.dumps({"real_clips": 4, "real_crops": 0.25}))
    pack.pack(tmp_path / "both", tmp_path / "more", 160, 90, 40, 1, 1)
    pack.unpack([tmp_path / "more/part-0.zip"], tmp_path / "again")
    assert Frames(tmp_path / "again/train").real.all() and train.real_share([tmp_path, tmp_path / "again"]) == 0.25


def test_sets_come_together(folder, tmp_path):
    (tmp_path / "train").mkdir()
    alone = filmed(tmp_path / "train")
    rendered = Frames(folder / "train")
    both = Frames(folder / "train", tmp_path / "train")
    assert both.real.tolist() == [False] * 6 + [True] * len(alone) and both.digest not in (alone.digest, rendered.digest)
    assert both.targets[len(rendered.targets) :] == [(6 + k, j) for k, j in alone.targets] and len(both.ignore) == len(both) == 6 + len(alone)
    for k in range(len(alone)):
        assert np.array_equal(both.picture(6 + k), alone.picture(k)) and np.array_equal(both.boxes[6 + k], alone.boxes[k])
    (folder / "dataset.json").write_text(json.dumps({"real_clips": 0, "real_crops": 0.5}))
    (tmp_path / "dataset.json").write_text(json.dumps({"real_clips": 4, "real_crops": 0.25}))
    assert train.real_share([str(folder), str(tmp_path)]) == 0.25 and train.real_share([str(folder)]) == 0.5
    (folder / "dataset.json").unlink()
    other = json.loads((tmp_path / "train/annotations.json").read_text())
    other["categories"][0]["name"] = "kite"
    (tmp_path / "train/annotations.json").write_text(json.dumps(other))
    with pytest.raises(ValueError, match="its categories are kite"):
        Frames(folder / "train", tmp_path / "train")


def test_preprocess_keeps_the_golden_file():
    golden = json.loads((HERE.parent / "tests/data/preprocess.json").read_text())
    rgb = np.array(golden["rgb"], np.uint8).reshape(golden["height"], golden["width"], 3)
    planes = native(rgb, golden["stride"], golden["min_side_px"])
    assert planes.shape == (1, 3, golden["padded_height"], golden["padded_width"])
    np.testing.assert_allclose(planes.ravel(), golden["planes"], atol=1e-6)
    assert native(rgb, 8, 12, (24, 40)).shape == (1, 3, 24, 40)
    with pytest.raises(ValueError, match="does not fit"):
        native(rgb, 8, 12, (4, 40))


def test_quick_eval_counts():
    truth, nothing = np.array([[10.0, 10, 20, 20]]), np.zeros((0, 4))
    boxes = np.array([[11.0, 10, 21, 20], [50, 50, 60, 60], [80, 80, 90, 90]])
    rows, errors = quick_eval.match(boxes, np.array([0.9, 0.8, 0.7]), truth, np.array([[79.0, 79, 91, 91]]), False)
    assert [hit for _, hit in rows] == [True, False] and errors == [(0.9, 1.0)]
    assert quick_eval.summary(rows, errors, 1, 10)["ap"] == pytest.approx(1)
    rows, _ = quick_eval.match(boxes[1:], np.array([0.8, 0.7]), truth, nothing, False)
    assert quick_eval.summary(rows, [], 1, 10)["ap"] == 0


def run(out: Path, *more: str) -> subprocess.CompletedProcess:
    common = "--model boresight-p2 --steps 6 --batch 2 --threads 1 --workers 0 --save-every 3 --log-every 2 --device cpu"
    command = [sys.executable, str(HERE / "train.py"), "--out", str(out), *common.split(), *more]
    return subprocess.run(command, capture_output=True, text=True)


def test_resumed_equals_uninterrupted(tmp_path):
    whole = run(tmp_path / "whole")
    assert whole.returncode == 0, whole.stderr
    halted = run(tmp_path / "parts", "--time-limit", "0")
    assert halted.returncode == 0 and "stopped at step 1" in halted.stdout, halted.stdout + halted.stderr
    assert run(tmp_path / "parts", "--resume").returncode == 0
    a, b = (torch.load(tmp_path / n / "last.pt", weights_only=True) for n in ("whole", "parts"))
    assert a["step"] == b["step"] == 6
    for key in ("model", "ema"):
        assert all(torch.equal(v, b[key][k]) for k, v in a[key].items())
    logs = [[r.split(",")[0:2] + r.split(",")[3:] for r in (tmp_path / n / "log.csv").read_text().splitlines()] for n in ("whole", "parts")]
    assert logs[0] == logs[1]  # but for the seconds
    assert "<svg" in (tmp_path / "whole/curves.svg").read_text()
    refused = run(tmp_path / "whole")
    assert refused.returncode != 0 and "--resume" in refused.stderr
    other = run(tmp_path / "whole", "--resume", "--lr", "1")
    assert other.returncode != 0 and "another lr" in other.stderr


def test_figures_of_a_run_and_of_misses(tmp_path, folder):
    done = run(tmp_path / "kept", "--keep-every", "3")
    assert done.returncode == 0, done.stderr
    assert {p.name for p in (tmp_path / "kept").glob("step-*.pt")} == {"step-3.pt", "step-6.pt"}
    figures.learning([tmp_path / "kept"], folder / "train", 2, tmp_path / "figure.svg")
    for kind, series in (("loss", "kept: loss"), ("ap", "kept: AP@0.5")):
        assert series in (tmp_path / f"figure_{kind}.svg").read_text()
    coco = json.loads((folder / "train/annotations.json").read_text())
    truth = next(a for a in coco["annotations"] if a["category_id"] <= 3)
    x, y, w, h = truth["bbox"]
    found = [{"image_id": truth["image_id"], "category_id": truth["category_id"], "bbox": [x + 1, y, w, h], "score": 0.9}]
    (tmp_path / "found.json").write_text(json.dumps(found))
    figures.misses(folder / "train", {"shifted": tmp_path / "found.json"}, tmp_path / "misses.svg")
    assert "shifted: 1.00 px, 1 of" in (tmp_path / "misses.svg").read_text()
    with pytest.raises(SystemExit, match="--keep-every"):
        figures.learning([folder], folder / "train", 2, tmp_path / "figure.svg")


def test_trains_in_bfloat16_on_small_crops(tmp_path):
    done = run(tmp_path / "half", "--bf16", "--crop", "128")
    assert done.returncode == 0, done.stderr
    state = torch.load(tmp_path / "half/last.pt", weights_only=True)
    assert state["step"] == 6 and state["recipe"]["bf16"] and state["recipe"]["crop"] == 128
    for v in state["ema"].values():  # weights stay in 32 bits
        assert v.dtype in (torch.float32, torch.int64) and v.isfinite().all()


def test_settings_that_cannot_be_are_told(folder, tmp_path):
    for options, said in (
        (("--crop", "200"), "multiple of 64"), (("--crop", "896"), "832"), (("--hard", "x.json"), "--data"), (("--real", "1.5"), "from 0 to 1"),
        (("--real", "nan"), "from 0 to 1"), (("--real", "1", "--data", str(folder)), "no real picture"),
        (("--data", str(folder), str(tmp_path)), "no such file"),
    ):  # fmt: skip
        done = run(tmp_path / "run", *options)
        assert done.returncode != 0 and said in done.stderr and "Traceback" not in done.stderr, done.stderr
    assert not (tmp_path / "run").exists()


def test_a_swarm_gets_more_looks_and_no_other_picture_does():
    model = models.build("boresight-p2-roi", len(models.CLASSES)).eval()
    heat = torch.stack([torch.linspace(0.9, 0.3, 24), torch.linspace(0.24, 0.1, 24)])
    corner = 40.0 * torch.stack([torch.arange(24) % 6, torch.arange(24) // 6], -1).expand(2, -1, -1)
    boxes = torch.cat([corner, corner + 10], -1)
    for rows in ([0, 1], [0], [1]):
        model.peaks = lambda raw, count: (boxes[rows], heat[rows], heat[rows].logit()[..., None])
        with torch.no_grad():
            _, scores, *_ = model.decode(torch.rand(len(rows), 3, 512, 512))
        assert (scores > 0).sum(1).tolist() == [(24, model.always)[row] for row in rows]


def test_a_row_counts_only_when_it_is_what_was_asked_for(tmp_path):
    wanted = {"model": "yolo-n", "steps": 6, "seed": 1}
    torch.save({"step": 3, "recipe": wanted}, tmp_path / "last.pt")
    with pytest.raises(SystemExit, match="stopped at step 3 of 6"):
        table1.checked(tmp_path, wanted)
    torch.save({"step": 6, "recipe": wanted}, tmp_path / "last.pt")
    assert table1.checked(tmp_path, wanted)["step"] == 6
    with pytest.raises(SystemExit, match="another seed"):
        table1.checked(tmp_path, wanted | {"seed": 2})


def test_table_gives_mean_and_spread(tmp_path):
    def result(row: str, seed: int, map50: float) -> dict:
        return {"row": row, "seed": seed, "minutes": 2.0, "figures": {"map50": map50, "params": 350_000, "miss_distance_px": {"mean": None}}}

    args = argparse.Namespace(rows=["yolo-n", "boresight-p2", "d-fine"])
    text = table1.table([result("boresight-p2", 1, 0.5), result("yolo-n", 1, 0.25), result("boresight-p2", 2, 0.7)], args)
    rows = [[c.strip() for c in line.strip("|").split("|")] for line in text.splitlines()]
    assert [r[0] for r in rows] == ["row", "---", "yolo-n", "boresight-p2"]  # in the order asked for; none without results
    column = {name: k for k, name in enumerate(rows[0])}
    assert rows[3][column["mAP@50"]] == "0.600 ± 0.141"  # sample standard deviation of 0.5 and 0.7: 0.1414
    assert rows[2][column["mAP@50"]] == "0.250" and rows[3][column["seeds"]] == "2"
    assert not any("rendered" in name for name in column)  # no sources named, none shown
    assert rows[3][column["M parameters"]] == "0.35" and rows[3][column["miss distance mean [px]"]] == "–"


def test_rows_may_differ_in_their_share_of_real_crops():
    assert table1.model_and_share("yolo-n") == ("yolo-n", None) and table1.model_and_share("d-fine-nwd@0.5") == ("d-fine-nwd", 0.5)
    for row in ("yolo", "yolo-n@", "yolo-n@1.5", "yolo-n@x", "@1"):
        with pytest.raises(SystemExit, match=f"--rows {row}"):
            table1.model_and_share(row)
    figures = {"map50": 0.5, "by_source": {"real": {"map50": 0.75, "recall_at_fppi_0_1": None}, "rendered": {"map50": 0.25}}}
    args = argparse.Namespace(rows=["yolo-n@0", "yolo-n@1"])
    text = table1.table([{"row": "yolo-n@1", "seed": 1, "minutes": 1.0, "figures": figures}], args)
    head, _, row = ([c.strip() for c in line.strip("|").split("|")] for line in text.splitlines())
    found = dict(zip(head, row))
    assert found["row"] == "yolo-n@1" and found["real: mAP@50"] == "0.750" and found["rendered: mAP@50"] == "0.250"
    assert found["real: recall at 0.1 false alarms"] == "–"


def test_weights_of_several_runs_are_exported_as_their_mean(tmp_path):
    """Weights are averaged, counters are the last run's, and runs of other models are refused."""
    classes, paths = list(models.CLASSES), [tmp_path / "a.pt", tmp_path / "b.pt", tmp_path / "c.pt"]
    for seed, (path, name) in enumerate(zip(paths, ("boresight-p2", "boresight-p2", "boresight-p2-roi"))):
        torch.manual_seed(seed)
        weights = models.build(name, len(classes)).state_dict()
        weights = {k: v if v.is_floating_point() else v + 10 * seed for k, v in weights.items()}
        torch.save({"recipe": {"model": name}, "classes": classes, "ema": weights}, path)
    a, b, mean = (export.load(*some)[0].state_dict() for some in (paths[:1], paths[1:2], paths[:2]))
    assert any(k.endswith("num_batches_tracked") for k in mean)
    for name, value in mean.items():
        torch.testing.assert_close(value, (a[name] + b[name]) / 2 if value.is_floating_point() else b[name])
    with pytest.raises(SystemExit, match="another model"):
        export.load(*paths)
