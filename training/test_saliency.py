"""Synthetic check of saliency.onnx: UAV silhouettes of 3..40 px before sky, above a skyline of windowed facades.

`pytest test_saliency.py` asserts; `python test_saliency.py` prints the figures that README.md gives.
"""

import numpy as np
import onnxruntime
import pytest

import saliency

NOISE = 2 / 255
SUB = 8  # silhouette samples per pixel along each axis
FRAMES = 60


@pytest.fixture(scope="module")
def detect():
    return make_detect()


def make_detect():
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 2
    session = onnxruntime.InferenceSession(
        saliency.build().SerializeToString(), options, providers=["CPUExecutionProvider"]
    )

    def run(image):
        return session.run(["boxes", "scores", "labels"], {"image": image.transpose(2, 0, 1)[None].astype(np.float32)})

    return run


def scene(rng, height=480, width=640):
    """A hazy sky over a row of facades [H,W,3] and the row of each column's roof [W]."""
    v = np.linspace(0, 1, height)[:, None, None]
    zenith, horizon = rng.uniform(0.45, 0.65), rng.uniform(0.7, 0.9)
    tint = np.array([0.93, 1.0, 1.05])
    image = (zenith + (horizon - zenith) * v) * np.ones((1, width, 1)) * (tint + (1 - tint) * v)
    roof = np.full(width, height)
    x = 0
    while x < width:
        w = int(rng.integers(40, 140))
        top = int(height * rng.uniform(0.55, 0.85))
        stop = min(x + w, width)
        roof[x:stop] = top
        wall = rng.uniform(0.25, 0.75)
        colour = np.clip(wall * rng.uniform(0.85, 1.15, 3), 0, 1)
        image[top:, x:stop] = colour
        pitch_x, pitch_y = rng.integers(8, 22), rng.integers(10, 26)
        window = np.clip(wall + rng.choice([-1, 1]) * rng.uniform(0.08, 0.3), 0.05, 0.95)
        size_x, size_y = int(pitch_x * rng.uniform(0.35, 0.65)), int(pitch_y * rng.uniform(0.35, 0.65))
        for y0 in range(top + 5, height - size_y, pitch_y):
            for x0 in range(x + 4, stop - size_x - 3, pitch_x):
                image[y0 : y0 + size_y, x0 : x0 + size_x] = np.clip(window + rng.normal(0, 0.04), 0, 1) * colour / wall
        x = stop
    return image, roof


def silhouette(rng, size):
    """Coverage [n,n] of a quadrotor seen from the side or below, `size` px wide, and its box and centroid in it."""
    n = int(size) + 8
    fine = (np.arange(n * SUB) + 0.5) / SUB
    centre = n / 2 + rng.uniform(-0.5, 0.5, 2)
    x, y = np.meshgrid(fine - centre[0], fine - centre[1])
    half_w, half_h = size / 2, size / 2 * rng.uniform(0.3, 1.0)
    body = (x / (half_w * 0.55)) ** 2 + (y / half_h) ** 2 < 1
    arms = (np.abs(x) < half_w) & (np.abs(y + half_h * 0.2) < max(half_h * 0.25, 0.5))
    shape = body | arms
    rows, columns = np.where(shape.any(1))[0], np.where(shape.any(0))[0]
    box = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]) / SUB
    centroid = np.array([fine[None].repeat(n * SUB, 0)[shape].mean(), fine[:, None].repeat(n * SUB, 1)[shape].mean()])
    return shape.reshape(n, SUB, n, SUB).mean((1, 3)), box, centroid


def blur(image, sigma=0.6):
    """Lens and pixel aperture beyond the box average."""
    offset = np.arange(-3, 4)
    kernel = np.exp(-(offset**2) / (2 * sigma**2))
    kernel /= kernel.sum()
    for axis in (0, 1):
        image = sum(k * np.roll(image, int(o), axis) for k, o in zip(kernel, offset))
    return image


def frame(rng, where):
    """A noisy frame with one UAV `where` = 'sky' or 'roof' (2..10 px above a roof), its box, centroid and size."""
    image, roof = scene(rng)
    size = float(np.exp(rng.uniform(np.log(3), np.log(40))))
    coverage, box, centroid = silhouette(rng, size)
    n = coverage.shape[0]
    x0 = int(rng.integers(20, 620 - n))
    ridge = int(roof[x0 : x0 + n].min())
    if where == "roof":
        y0 = ridge - int(np.ceil(box[3])) - int(rng.integers(2, 11))
    else:
        y0 = int(rng.integers(15, ridge - n - 25))
    patch = image[y0 : y0 + n, x0 : x0 + n]
    contrast = rng.uniform(30, 110) / 255 * (-1 if rng.random() < 0.8 else 1)
    target = np.clip(patch.mean() + contrast, 0.02, 0.98)
    image[y0 : y0 + n, x0 : x0 + n] += coverage[..., None] * (target - patch)
    image = blur(image) + rng.normal(0, NOISE, image.shape)
    image = np.round(np.clip(image, 0, 1) * 255) / 255
    at = np.array([x0, y0])
    return image, box + np.tile(at, 2), centroid + at, size


def iou(a, b):
    low, high = np.maximum(a[:2], b[:2]), np.minimum(a[2:], b[2:])
    inter = np.prod(np.clip(high - low, 0, None))
    return inter / (np.prod(a[2:] - a[:2]) + np.prod(b[2:] - b[:2]) - inter)


def measure(detect, where, seed=7, frames=FRAMES, threshold=saliency.SCORE_THRESHOLD):
    rng = np.random.default_rng(seed)
    rows, false_alarms = [], 0
    for _ in range(frames):
        image, box, centroid, size = frame(rng, where)
        boxes, scores, _ = detect(image)
        boxes = boxes[scores >= threshold]
        scores = scores[scores >= threshold]
        inside = np.all((boxes[:, :2] + boxes[:, 2:]) / 2 >= box[:2] - 1, 1) & np.all(
            (boxes[:, :2] + boxes[:, 2:]) / 2 <= box[2:] + 1, 1
        )
        false_alarms += int((~inside).sum())
        if inside.any():
            hit = boxes[inside][0]
            middle = (hit[:2] + hit[2:]) / 2
            error = np.linalg.norm(middle - centroid)
            box_error = np.linalg.norm(middle - (box[:2] + box[2:]) / 2)
            rows.append((size, 1, error, box_error, iou(hit, box)))
        else:
            rows.append((size, 0, np.nan, np.nan, np.nan))
    return np.array(rows), false_alarms / frames


@pytest.mark.parametrize(("where", "recall"), [("sky", 0.95), ("roof", 0.7)])
def test_finds_and_measures(detect, where, recall):
    rows, false_alarms = measure(detect, where)
    assert rows[:, 1].mean() >= recall
    assert false_alarms <= 1.5
    middle = rows[(rows[:, 0] >= 5) & (rows[:, 0] <= 15)]
    assert np.nanmedian(middle[:, 2]) <= 0.15  # px
    assert np.nanpercentile(middle[:, 2], 90) <= 0.3  # px
    assert np.nanmedian(rows[:, 4]) >= 0.75


def test_no_target_no_detection(detect):
    rng = np.random.default_rng(3)
    sky = np.linspace(0.5, 0.8, 480)[:, None, None] * np.ones((1, 640, 3))
    _, scores, _ = detect(sky + rng.normal(0, NOISE, sky.shape))
    assert scores.max() < saliency.SCORE_THRESHOLD


@pytest.mark.parametrize("shape", [(64, 64), (333, 517), (256, 256), (1080, 1920)])
def test_any_size_and_flat_image(detect, shape):
    for value in (0.0, 0.5, 1.0):
        boxes, scores, labels = detect(np.full((*shape, 3), value))
        assert boxes.shape == (saliency.DETECTIONS, 4) and boxes.dtype == np.float32
        assert scores.shape == labels.shape == (saliency.DETECTIONS,)
        assert np.isfinite(boxes).all() and scores.max() < 1e-6
        assert labels.dtype == np.int64 and (labels == 0).all()


def test_outputs_shift_with_the_image(detect):
    rng = np.random.default_rng(5)
    image, box, centroid, _ = frame(rng, "sky")
    boxes, scores, _ = detect(image)
    moved, moved_scores, _ = detect(np.roll(image, (8, 16), (0, 1)))  # whole samples of every level
    best = np.argmin(np.linalg.norm((boxes[:, :2] + boxes[:, 2:]) / 2 - centroid, axis=1))
    twin = np.argmin(np.abs(moved - boxes[best] - [16, 8, 16, 8]).max(1))
    assert np.abs(moved[twin] - boxes[best] - [16, 8, 16, 8]).max() < 1e-3
    assert abs(moved_scores[twin] - scores[best]) < 1e-4


def test_shipped_model_is_this_build():
    shipped = saliency.Path(saliency.__file__).parent.parent / "assets/models/saliency.onnx"
    assert shipped.read_bytes() == saliency.build().SerializeToString(deterministic=True)


if __name__ == "__main__":
    run = make_detect()
    for where in ("sky", "roof"):
        rows, false_alarms = measure(run, where, seed=2026, frames=300)
        print(f"{where}: recall {rows[:, 1].mean():.3f}, {false_alarms:.2f} false alarms a frame")
        for low, high in ((3, 5), (5, 8), (8, 15), (15, 25), (25, 40)):
            part = rows[(rows[:, 0] >= low) & (rows[:, 0] < high)]
            print(
                f"  {low:2d}-{high:2d} px (n={len(part)}): recall {part[:, 1].mean():.3f}, centroid error median"
                f" {np.nanmedian(part[:, 2]):.2f} p90 {np.nanpercentile(part[:, 2], 90):.2f} px, box-centre error median"
                f" {np.nanmedian(part[:, 3]):.2f}, IoU median {np.nanmedian(part[:, 4]):.2f}"
            )
