"""Checks of the D-FINE rows; `pytest -s` prints the parameters and FLOPs."""

import copy
import math
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
import torch
import torch.nn.functional as F
from scipy.optimize import linear_sum_assignment
from torch import Tensor
from torch.utils.flop_counter import FlopCounterMode
from transformers.models.d_fine.modeling_d_fine import (
    distance2bbox,
    multi_scale_deformable_attention_v2,
    weighting_function,
)

import from_onnx
from dfine import DSAM, FIXED_SIZE, NAMES, QUERIES, Canvas, Criterion, DFineDetector, P2P3Fusion, build_dfine
from dfine import configuration, first_of_object, nwd

torch.set_num_threads(1)

# Parameters of the released D-FINE-N and of the P2 + P3 cut [millions]; FLOPs at 640 x 640 of the paper's Table 1 [G].
PUBLISHED = {
    "d-fine": (3.75, 7.0),
    "d-fine-nwd": (3.75, 7.0),
    "d-fine-nwd-p2": (0.64, 9.1),
    "d-fine-nwd-p2-dsam": (0.64, 9.3),
}


def seeded(name: str) -> DFineDetector:
    torch.manual_seed(1)
    return build_dfine(name)


def crops(model: DFineDetector) -> tuple[Tensor, list[dict]]:
    """Two small noisy crops, each with one filled rectangle as its target."""
    side = max(96, model.min_side_px)
    generator = torch.Generator().manual_seed(3)
    images = 0.5 + 0.02 * torch.randn(2, 3, side, side, generator=generator)
    boxes = [[40, 56, 56, 68], [70, 30, 84, 42]]
    for image, (x0, y0, x1, y1) in zip(images, boxes):
        image[:, y0:y1, x0:x1] = 0.1
    return images, [{"boxes": torch.tensor([b]).float(), "labels": torch.tensor([i])} for i, b in enumerate(boxes)]


def picture(height: int, width: int) -> Tensor:
    """A smooth random picture with fine noise [1,3,H,W]."""
    generator = torch.Generator().manual_seed(5)
    coarse = torch.rand(1, 3, height // 32, width // 32, generator=generator)
    fine = torch.randn(1, 3, height, width, generator=generator)
    return (F.interpolate(coarse, (height, width), mode="bicubic") + 0.03 * fine).clamp(0, 1)


def matched_sets(a: tuple, b: tuple) -> tuple[np.ndarray, np.ndarray, int]:
    """Two detectors' outputs paired by box and score: box differences [px], score differences, wrong labels."""
    (boxes_a, scores_a, labels_a), (boxes_b, scores_b, labels_b) = ([np.asarray(x) for x in out] for out in (a, b))
    boxes = np.abs(boxes_a[:, None] - boxes_b[None]).max(-1)
    scores = np.abs(scores_a[:, None] - scores_b[None])
    rows, columns = linear_sum_assignment(np.minimum(boxes, 1e3) + 1e3 * scores)
    return boxes[rows, columns], scores[rows, columns], int((labels_a[rows] != labels_b[columns]).sum())


@pytest.mark.parametrize("name", NAMES)
def test_size_and_flops_are_the_published_ones(name):
    model = seeded(name).eval()
    millions = sum(p.numel() for p in model.model.parameters()) / 1e6
    giga = {}
    for size in ((640, 640), FIXED_SIZE, (256, 256)):
        with torch.no_grad(), FlopCounterMode(display=False) as counter:
            model(torch.zeros(1, 3, *size))
        giga[size] = counter.get_total_flops() / 1e9
    print(f"\n{name}: {millions:.3f} M parameters, GFLOP " + ", ".join(f"{s}: {g:.2f}" for s, g in giga.items()))
    expected_millions, expected_giga = PUBLISHED[name]
    assert millions == pytest.approx(expected_millions, rel=0.05)
    # 100 queries here, 300 there: -0.4 G; the P2 rows' block widths are not published.
    assert giga[640, 640] == pytest.approx(expected_giga, rel=0.1)


def test_nwd_by_hand():
    box = torch.tensor([50.0, 40.0, 12.0, 8.0])
    for other, distance_px in (
        ([50.0, 40.0, 12.0, 8.0], 0.0),
        ([53.0, 44.0, 12.0, 8.0], 5.0),  # 3, 4 px aside
        ([50.0, 40.0, 18.0, 16.0], 5.0),  # 6 wider, 8 higher: half of each counts
        ([52.0, 40.0, 16.0, 10.0], 3.0),  # 2 aside, half sizes differ by 2 and 1
    ):
        assert nwd(box, torch.tensor(other), 14.0).item() == pytest.approx(math.exp(-distance_px / 14.0), abs=1e-4)
    same = box.clone().requires_grad_()
    nwd(same, box, 14.0).backward()
    assert same.grad.isfinite().all()


def test_nwd_loss_is_in_pixels():
    canvas = Canvas(14.0)
    criterion = Criterion(configuration(True, 3), canvas, 14.0)
    target = canvas.normalise(torch.tensor([[100.0, 60.0, 114.0, 70.0]]))
    guess = canvas.normalise(torch.tensor([[103.0, 64.0, 117.0, 74.0]]))
    indices = [(torch.tensor([0]), torch.tensor([0]))]
    terms = criterion.loss_boxes({"pred_boxes": guess[None]}, [{"boxes": target}], indices, 1.0)
    assert terms["loss_nwd"].item() == pytest.approx(1 - math.exp(-5.0 / 14.0), abs=1e-5)
    assert [criterion.weight_dict[k] for k in ("loss_vfl", "loss_nwd", "loss_ddf")] == [1.0, 5.0, 1.5]


def test_dsam_follows_its_equations():
    torch.manual_seed(2)
    channels, height, width, kernel = 8, 5, 6, 7
    block = DSAM(channels, kernel)
    x = torch.randn(2, channels, height, width)
    image, p = x.numpy().astype(float), {k: v.detach().numpy().astype(float) for k, v in block.state_dict().items()}
    sigmoid = lambda v: 1 / (1 + np.exp(-v))  # noqa: E731
    expected = np.empty_like(image)
    for b in range(2):
        rows = image[b].sum(2) / width  # Xh [C,H]
        columns = image[b].sum(1) / height  # Xw [C,W]
        z = image[b].sum((1, 2)) / (height * width)
        hidden = np.maximum(p["squeeze.weight"][:, :, 0, 0] @ z + p["squeeze.bias"], 0)
        a_c = sigmoid(p["excite.weight"][:, :, 0, 0] @ hidden + p["excite.bias"])
        for c in range(channels):
            k_h, k_w = p["along_h.weight"][c, 0, :, 0], p["along_w.weight"][c, 0, 0]
            for i in range(height):
                near = [k_h[k] * rows[c, i + k - 3] for k in range(kernel) if 0 <= i + k - 3 < height]
                a_h = sigmoid(sum(near) + p["along_h.bias"][c])
                for j in range(width):
                    near = [k_w[k] * columns[c, j + k - 3] for k in range(kernel) if 0 <= j + k - 3 < width]
                    a_w = sigmoid(sum(near) + p["along_w.bias"][c])
                    expected[b, c, i, j] = image[b, c, i, j] * a_h * a_w * a_c[c]
    np.testing.assert_allclose(block(x).detach().numpy(), expected, atol=1e-6)


def test_fusion_adds_the_upsampled_p3():
    torch.manual_seed(2)
    fusion = P2P3Fusion(configuration(True, 3), dsam=True).eval()
    seen = {}
    fusion.fuse.register_forward_pre_hook(lambda _, inputs: seen.update(fused=inputs[0]))
    fusion.attention.register_forward_pre_hook(lambda _, inputs: seen.update(attended=inputs[0]))
    fusion.lateral = torch.nn.Identity()
    p2, p3 = torch.zeros(1, 64, 8, 8), torch.zeros(1, 64, 4, 4)
    p2[0, 0, 2, 3], p3[0, 0, 1, 1] = 5.0, 16.0
    fusion([p2, p3])
    # Bilinear weights 1/4, 3/4 along each axis around the P3 cell, which covers P2 cells 2 and 3.
    profile = torch.tensor([0, 0.25, 0.75, 0.75, 0.25, 0, 0, 0])
    expected = 16 * profile[:, None] * profile[None]
    expected[2, 3] += 5
    torch.testing.assert_close(seen["fused"][0, 0], expected)
    assert seen["attended"].shape == (1, 64, 8, 8)


def test_boxes_and_anchors_mean_the_same_pixels_in_crops_and_frames():
    canvas = Canvas(14.0)
    box = torch.tensor([[10.0, 20.0, 24.0, 30.0]])
    for offset, frame in (((0, 0), FIXED_SIZE), ((100, 333), (256, 256))):
        canvas.place(offset, frame, FIXED_SIZE)
        torch.testing.assert_close(canvas.pixels(canvas.normalise(box)), box, atol=1e-3, rtol=0)
        shapes = [(frame[0] // s, frame[1] // s) for s in (4, 8)]
        logits, valid = canvas.anchors(shapes)
        cells = [rows * columns for rows, columns in shapes]
        assert logits.shape[1] == sum(cells) and valid.all()
        anchors = canvas.normalise(box.new_tensor([[0, 0, 0, 0]])), logits.sigmoid()
        size_px = anchors[1][0, :, 2:] * torch.tensor([640.0, 512.0])
        torch.testing.assert_close(size_px[: cells[0]], torch.full((cells[0], 2), 14.0), atol=1e-2, rtol=0)
        torch.testing.assert_close(size_px[cells[0] :], torch.full((cells[1], 2), 28.0), atol=1e-2, rtol=0)
        centre_px = (anchors[1][0, :, :2] - anchors[0][0, :2]) * torch.tensor([640.0, 512.0])
        columns = shapes[0][1]
        torch.testing.assert_close(centre_px[columns + 2], torch.tensor([10.0, 6.0]), atol=1e-2, rtol=0)
        torch.testing.assert_close(centre_px[cells[0] + 1], torch.tensor([12.0, 4.0]), atol=1e-2, rtol=0)


def test_positions_stay_whole_in_bfloat16():
    # bfloat16 would round positions of 256 px and more to 2 or 4 px.
    model = seeded("d-fine-nwd-p2")
    seen = {}

    def generate(*args, **options):
        seen["anchors"], valid = anchors(*args, **options)
        return seen["anchors"], valid

    anchors, model.model.generate_anchors = model.model.generate_anchors, generate
    images, targets = crops(model)
    with torch.autocast("cpu", torch.bfloat16):
        losses = model.train().loss(images, targets)
    assert seen["anchors"].dtype == torch.float32
    assert all(loss.dtype == torch.float32 and loss.isfinite() for loss in losses.values())
    assert losses["ddf"] >= -1e-6  # a divergence


def test_deformable_sampling_reads_the_same_features_in_a_crop():
    torch.manual_seed(4)
    canvas, stride = Canvas(14.0), 8
    features = torch.randn(1, 64, 80, 2, 4)  # [B,H,W,heads,channels]
    locations = 0.45 + 0.1 * torch.rand(1, 5, 2, 6, 2)
    weights = torch.rand(1, 5, 2, 6)

    def sample(values):
        rows, columns = values.shape[1:3]
        return canvas.sample(values.flatten(1, 2), [(rows, columns)], locations, weights, [6])

    canvas.whole(FIXED_SIZE)
    whole = sample(features)
    plain = multi_scale_deformable_attention_v2(features.flatten(1, 2), [(64, 80)], locations, weights, [6])
    torch.testing.assert_close(whole, plain)
    canvas.place((16 * stride, 24 * stride), (256, 256), FIXED_SIZE)
    torch.testing.assert_close(sample(features[:, 16:48, 24:56]), whole, atol=1e-5, rtol=1e-5)


def test_a_step_moves_centres_no_further_than_edges():
    model = seeded("d-fine-nwd")
    middle = torch.tensor([0.5, 0.5, 14.0 / 640, 14.0 / 512])
    for head in (model.model.enc_bbox_head, model.model.decoder.pre_bbox_head):
        torch.nn.init.zeros_(head.layers[-1].weight)
        torch.nn.init.constant_(head.layers[-1].bias, 0.1)
        moved = (torch.logit(middle) + head(torch.zeros(128))).sigmoid() - middle
        pixels = moved * torch.tensor([640.0, 512.0, 640.0, 512.0])
        torch.testing.assert_close(pixels, torch.full((4,), 1.4), rtol=0.06, atol=0)


def test_the_shipped_file_is_read_back_and_folding_changes_nothing():
    model, meta = from_onnx.read(Path(__file__).resolve().parent.parent / "assets/models/d-fine-nwd-p2-dsam.onnx")
    for head in (model.model.enc_bbox_head, model.model.decoder.pre_bbox_head):
        x = torch.randn(1, 5, head.layers[0].in_features)
        learning = head(x)
        head.fold(True)
        torch.testing.assert_close(head(x), learning)
        head.fold(False)
        torch.testing.assert_close(head(x), learning)


def test_a_copy_has_its_own_canvas():
    model = seeded("d-fine")
    ema = copy.deepcopy(model)
    ema.canvas.place((7, 9), (64, 64), FIXED_SIZE)
    hooks = [layer.encoder_attn.ms_deformable_attn_core for layer in ema.model.decoder.layers]
    hooks.append(ema.model.generate_anchors)
    owners = [hook.__self__ for hook in hooks] + [ema.criterion.canvas]
    owners.append(ema.model.encoder.aifi[0].position_embedding.canvas)
    assert all(owner is ema.canvas for owner in owners) and model.canvas.offset == (0, 0)


def test_union_of_matches_prefers_the_frequent_target():
    pairs = lambda *p: [tuple(torch.tensor(side) for side in zip(*p))]  # noqa: E731
    layers = [pairs((3, 0), (5, 1)), pairs((3, 1), (6, 0)), pairs((3, 1), (5, 0))]
    ((queries, targets),) = Criterion.union([*layers, pairs((5, 1), (7, 0))])
    assert dict(zip(queries.tolist(), targets.tolist())) == {3: 1, 5: 1, 6: 0, 7: 0}


def test_each_layer_is_trained_on_its_own_boxes():
    model = seeded("d-fine-nwd-p2").train()
    images, targets = crops(model)
    seen = {}
    criterion = model.criterion

    def spy(heads, denoising, meta, labels):
        seen.update(heads=heads, denoising=denoising, meta=meta)
        return Criterion.forward(criterion, heads, denoising, meta, labels)

    criterion.forward = spy
    torch.nn.init.normal_(model.model.decoder.bbox_embed[1].layers[-1].weight, std=0.1)
    model.loss(images, targets)
    layers = [[h for h in heads if "pred_corners" in h] for heads in (seen["heads"], seen["denoising"])]
    assert [len(group) for group in layers] == [3, 3] and len(seen["heads"]) == 5
    assert seen["meta"]["dn_num_split"] == [20, QUERIES]  # 10 positives and 10 negatives
    decoder = model.model.decoder
    project = weighting_function(decoder.max_num_bins, decoder.up, decoder.reg_scale)
    for head in (*layers[0], *layers[1]):
        distances = decoder.integral(head["pred_corners"], project)
        boxes = distance2bbox(head["ref_points"], distances, decoder.reg_scale)
        torch.testing.assert_close(head["pred_boxes"], boxes.clamp(0, 1))


@pytest.mark.parametrize("name", NAMES)
def test_images_without_targets(name):
    model = seeded(name).train()
    images, targets = crops(model)
    empty = {"boxes": torch.zeros(0, 4), "labels": torch.zeros(0, dtype=torch.int64)}
    for batch in ([empty, empty], [targets[0], empty]):
        losses = model.loss(images, batch)
        assert all(v.ndim == 0 and v.isfinite() for v in losses.values())
        assert losses["total"].item() == pytest.approx(sum(v.item() for k, v in losses.items() if k != "total"), 1e-5)
    losses["total"].backward()
    missing = [n for n, p in model.named_parameters() if p.requires_grad and p.grad is None]
    assert missing == [] and all(p.grad.isfinite().all() for p in model.parameters() if p.grad is not None)


def test_loss_refuses_evaluation_mode():
    model = seeded("d-fine-nwd-p2").eval()
    with pytest.raises(RuntimeError, match="train"):
        model.loss(*crops(model))


def overfit(model: DFineDetector, steps: int, lr: float) -> list[dict[str, float]]:
    """Trains on the two crops; the losses of each step."""
    images, targets = crops(model)
    optimizer = torch.optim.AdamW(model.train().parameters(), lr=lr)
    history = []
    for _ in range(steps):
        losses = model.loss(images, targets)
        optimizer.zero_grad()
        losses["total"].backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        history.append({k: v.item() for k, v in losses.items()})
    return history


@pytest.mark.parametrize("name", NAMES)
def test_loss_falls_on_two_crops(name):
    history = overfit(seeded(name), steps=24, lr=1e-3)
    term = "nwd" if "-nwd" in name else "giou"
    # Varifocal and FGL losses carry the IoU as their weight, so that they rise at first, when boxes begin to fit.
    for key, share in ((term, 0.85), ("total", 0.95)):
        first, last = (np.mean([h[key] for h in part]) for part in (history[:4], history[-8:]))
        print(f"\n{name}: {key} {first:.1f} -> {last:.1f}")
        assert last < share * first


def test_finds_what_it_was_trained_on_also_elsewhere_in_a_full_frame():
    # Not with DSAM: its means over rows, columns and the image change with the frame, and two crops teach it nothing.
    model = seeded("d-fine-nwd-p2")
    overfit(model, steps=120, lr=1e-3)
    images, targets = crops(model)
    side, (height, width) = images.shape[-1], FIXED_SIZE
    frame = 0.5 + 0.02 * torch.randn(1, 3, height, width, generator=torch.Generator().manual_seed(4))
    frame[0, :, 300 : 300 + side, 400 : 400 + side] = images[1]
    model.eval()
    for image, target, shift in (
        (images[:1], targets[0], torch.zeros(4)),
        (images[1:], targets[1], torch.zeros(4)),
        (frame, targets[1], torch.tensor([400.0, 300, 400, 300])),
    ):
        with torch.no_grad():
            boxes, scores, labels = (x[0] for x in model.decode(image))
        print(f"\nbox {(boxes[0] - shift).tolist()} score {scores[0]:.2f} of {target['boxes'].tolist()}")
        assert (boxes[0] - shift - target["boxes"][0]).abs().max() < 4.0  # [px]


def test_a_second_box_of_an_object_is_told_from_a_neighbour():
    boxes = [[0, 0, 8, 8], [20, 0, 28, 8], [1, 0, 9, 8], [4, 0, 12, 8], [20, 1, 28, 8]]  # the third repeats the first, the last the second
    assert first_of_object(torch.tensor([boxes]).float()).tolist() == [[1, 1, 0, 1, 0]]
    assert first_of_object(torch.tensor([boxes[:2] + boxes[3:4]]).float()).tolist() == [[1, 1, 1]]


@pytest.mark.parametrize("name", ["d-fine", "d-fine-nwd-p2-dsam"])
def test_onnx_gives_the_same_detections(name, tmp_path):
    model = seeded(name).eval()
    with torch.no_grad():
        for head in model.model.decoder.bbox_embed:  # so that the layers' boxes differ
            torch.nn.init.normal_(head.layers[-1].weight, std=0.05)
    path, image = tmp_path / "model.onnx", picture(*FIXED_SIZE)
    names = ["boxes", "scores", "labels"]
    torch.onnx.export(
        model, (image,), path, opset_version=17, dynamo=False, input_names=["image"], output_names=names
    )
    with torch.no_grad():
        reference = [x[0] for x in model.decode(image)]
    boxes, scores, labels = reference
    assert boxes.shape == (QUERIES, 4) and labels.dtype == torch.int64 and (scores.diff() <= 0).all()
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    other = [x[0] for x in session.run(names, {"image": image.numpy()})]
    box_px, score, wrong = matched_sets(reference, other)
    # Without training the proposals' scores nearly tie, and rounding brings in a few others of them.
    agree = (box_px < 0.01) & (score < 1e-4)
    print(f"\n{name}: {agree.sum()} of {QUERIES} agree, to {box_px[agree].max():.1e} px")
    assert agree.sum() >= 0.95 * QUERIES and wrong <= (~agree).sum()
    assert (np.diff(other[1]) <= 0).all()
