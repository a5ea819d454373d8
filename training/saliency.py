#!/usr/bin/env python3
"""Builds assets/models/saliency.onnx: a classical small-target detector, expressed wholly as an ONNX graph.

Nothing is trained. Stage 1 proposes: on a 2x2-average pyramid (1/2, 1/4, 1/8), each sample's multiscale
patch contrast (MPCM: Wei, You and Li, Pattern Recognition 58, 2016) relative to the local deviation of its
surround, and the strongest local maxima of each level. Stage 2 measures: around each proposal a small window
of the next finer level is cut out; the half-contrast connected component of the peak gives the target, a ring
around it the background, contrast-weighted moments the centre, and the contrast profiles the size. The score
falls with the noise and clutter of the surround, so that the windows of a facade score low.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

LEVELS = 3  # pyramid levels that propose: samples of 2, 4 and 8 px
PROPOSALS = (32, 16, 8)  # per level, finest first
DETECTIONS = 32
MIN_SIDE_PX = 64
# Distance of the eight surround samples along the axes and along the diagonals, per level [level samples]: the
# finest level looks closest, for the smallest targets near a roof line.
RINGS = ((2, 2), (3, 2), (3, 2))
SIDE_BOX, SIDE_OFFSET = 5, 5  # the boxes beside a sample whose deviation stands for its surround [level samples]
WINDOW = 22  # side of the measuring window [finer-level samples], even: a proposal covers the middle 2x2
FLOOD_STEPS = 10
NOISE_FLOOR = 2.0 / 255.0  # deviation that is taken as sensor noise whatever the window shows
LEVEL_NOISE_FLOOR = 1.0 / 255.0  # the same of the averaged samples that propose
SNR_HALF = 3.0  # contrast over deviation at which that factor of the score is one half
SIDE_WEIGHTS = (0.0, 1.0, 0.3, 0.0)  # of the four sides' clutter, quietest first
CLUTTER_HALF = 0.16  # clutter over contrast at which that factor of the score is one half
LUMA = (0.299, 0.587, 0.114)  # ITU-R BT.601
SCORE_THRESHOLD = 0.5


class Graph:
    """A thin writer: `g.Op(inputs..., attributes...)` appends a node and returns its output's name."""

    def __init__(self):
        self.nodes, self.constants, self.count = [], {}, 0

    def const(self, value, dtype=np.float32):
        array = np.asarray(value, dtype=dtype)
        key = (array.dtype.str, array.shape, array.tobytes())
        if key not in self.constants:
            self.constants[key] = numpy_helper.from_array(array, f"c{len(self.constants)}")
        return self.constants[key].name

    def ints(self, *values):
        return self.const(values, np.int64)

    def op(self, kind, *inputs, outputs=1, **attributes):
        names = [f"t{self.count + i}" for i in range(outputs)]
        self.count += outputs
        inputs = [x if isinstance(x, str) else self.const(x) for x in inputs]
        self.nodes.append(helper.make_node(kind, inputs, names, **attributes))
        return names[0] if outputs == 1 else names

    def __getattr__(self, kind):
        if not kind[0].isupper():
            raise AttributeError(kind)
        return lambda *inputs, **attributes: self.op(kind, *inputs, **attributes)

    def cast(self, x, to):
        return self.Cast(x, to=to)

    def mask(self, condition):
        return self.cast(condition, TensorProto.FLOAT)

    def dilate(self, x, size=3):
        return self.MaxPool(x, kernel_shape=[size, size], pads=[size // 2] * 4)

    def box(self, x, size):
        """Separable mean filter, each sample over the neighbours that exist."""
        half = size // 2
        x = self.AveragePool(x, kernel_shape=[1, size], pads=[0, half, 0, half], count_include_pad=0)
        return self.AveragePool(x, kernel_shape=[size, 1], pads=[half, 0, half, 0], count_include_pad=0)

    def total(self, x, *axes):
        return self.ReduceSum(x, self.ints(*axes), keepdims=1)


def side(g, x, axis):
    """Height (axis 2) or width (axis 3) of a map, int64 [1]."""
    return g.Gather(g.Shape(x), g.ints(axis), axis=0)


def propose(g, level_map, count, axial, diagonal):
    """Rows and columns int64 [count] of a level's strongest local maxima of normalised patch contrast,
    and the patch contrast at each, float32 [count]."""
    height, width = side(g, level_map, 2), side(g, level_map, 3)
    padded = g.Pad(level_map, g.ints(0, 0, axial, axial, 0, 0, axial, axial), mode="edge")

    def shifted(padded, margin, dy, dx):
        start_y, start_x = g.ints(margin + dy), g.ints(margin + dx)
        starts = g.Concat(start_y, start_x, axis=0)
        ends = g.Concat(g.Add(height, start_y), g.Add(width, start_x), axis=0)
        return g.Slice(padded, starts, ends, g.ints(2, 3))

    pairs = [
        g.Mul(g.Sub(level_map, shifted(padded, axial, dy, dx)), g.Sub(level_map, shifted(padded, axial, -dy, -dx)))
        for dy, dx in ((0, axial), (axial, 0), (diagonal, diagonal), (diagonal, -diagonal))
    ]
    # An edge or a line has one direction without contrast; only a blob keeps the least of the four.
    contrast_sq = g.Relu(g.Min(*pairs))
    # The second quietest of four sides: a roof line spoils one or two of them, a facade all.
    mean = g.box(level_map, SIDE_BOX)
    variance = g.Relu(g.Sub(g.box(g.Mul(level_map, level_map), SIDE_BOX), g.Mul(mean, mean)))
    padded = g.Pad(variance, g.ints(0, 0, SIDE_OFFSET, SIDE_OFFSET, 0, 0, SIDE_OFFSET, SIDE_OFFSET), mode="edge")
    left, right, up, down = (
        shifted(padded, SIDE_OFFSET, dy, dx)
        for dy, dx in ((0, -SIDE_OFFSET), (0, SIDE_OFFSET), (-SIDE_OFFSET, 0), (SIDE_OFFSET, 0))
    )
    variance = g.Min(
        g.Max(g.Min(left, right), g.Min(up, down)),
        g.Max(left, right),
        g.Max(up, down),
    )
    saliency = g.Div(contrast_sq, g.Add(variance, LEVEL_NOISE_FLOOR**2))
    peak = g.mask(g.Equal(saliency, g.dilate(saliency, 5)))
    flat = g.Reshape(g.Mul(saliency, peak), g.ints(-1))
    _, index = g.op("TopK", flat, g.ints(count), axis=0, outputs=2)
    contrast = g.Sqrt(g.Gather(g.Reshape(contrast_sq, g.ints(-1)), index))
    return g.Div(index, width), g.Mod(index, width), contrast


def cut(g, source, rows, columns, first):
    """Windows [count,1,WINDOW,WINDOW] of `source` starting `first` samples from (rows, columns), edges repeated."""
    height, width = side(g, source, 2), side(g, source, 3)
    offsets = np.arange(WINDOW) + first

    def axis_index(start, size, shape):
        index = g.Add(g.Reshape(start, g.ints(-1, 1, 1, 1)), g.const(offsets.reshape(shape), np.int64))
        return g.Min(g.Max(index, g.ints(0)), g.Sub(size, g.ints(1)))

    y, x = axis_index(rows, height, (1, 1, -1, 1)), axis_index(columns, width, (1, 1, 1, -1))
    return g.Gather(g.Reshape(source, g.ints(-1)), g.Add(g.Mul(y, width), x))


def strips():
    """Four strips (left, right, up, down) of the context window beyond the target, each of unit sum [4,1,W,W]."""
    offset = np.abs(np.arange(WINDOW) - WINDOW // 2)
    signed = np.arange(WINDOW) - WINDOW // 2
    far, near = (offset >= 4) & (offset <= 10), offset <= 2
    across = (near[:, None] & far[None, :]).astype(np.float32)
    along = (far[:, None] & near[None, :]).astype(np.float32)
    kernels = [across * (signed < 0), across * (signed > 0), along * (signed < 0)[:, None], along * (signed > 0)[:, None]]
    return np.stack([k / k.sum() for k in kernels])[:, None].astype(np.float32)


def build():
    g = Graph()
    maps = [g.Conv("image", g.const(np.array(LUMA).reshape(1, 3, 1, 1)))]
    for _ in range(LEVELS):
        maps.append(g.AveragePool(maps[-1], kernel_shape=[2, 2], strides=[2, 2]))

    fine, context, contrasts, origins, scales = [], [], [], [], []
    for level, count, ring in zip(range(1, LEVELS + 1), PROPOSALS, RINGS):
        rows, columns, contrast = propose(g, maps[level], count, *ring)
        first = 1 - WINDOW // 2
        fine_rows, fine_columns = g.Mul(rows, g.ints(2)), g.Mul(columns, g.ints(2))
        fine.append(cut(g, maps[level - 1], fine_rows, fine_columns, first))
        context.append(cut(g, maps[level], rows, columns, -WINDOW // 2))
        contrasts.append(contrast)
        # Pixel coordinates of the middle of the window, between its two middle samples.
        centre = g.Concat(g.Unsqueeze(columns, g.ints(1)), g.Unsqueeze(rows, g.ints(1)), axis=1)
        origins.append(g.Mul(g.Add(g.cast(centre, TensorProto.FLOAT), 0.5), float(2**level)))
        scales += [float(2 ** (level - 1))] * count
    x = g.Concat(*fine, axis=0)
    ctx = g.Concat(*context, axis=0)
    origin = g.Concat(*origins, axis=0)
    contrast = g.Reshape(g.Concat(*contrasts, axis=0), g.ints(-1, 1, 1, 1))
    scale = g.const(np.array(scales).reshape(-1, 1))

    # The target: samples beyond half contrast that connect to the peak.
    n, half = WINDOW, WINDOW // 2
    grid = np.arange(n) - (n - 1) / 2
    centre2 = np.zeros((1, 1, n, n), np.float32)
    centre2[..., half - 1 : half + 1, half - 1 : half + 1] = 1
    radius = np.maximum(np.abs(grid)[:, None], np.abs(grid)[None, :])
    frame = ((radius >= 5) & (radius <= 7)).astype(np.float32)[None, None]
    border = (radius > half - 1).astype(np.float32)[None, None]
    around = g.total(g.Mul(x, frame / frame.sum()), 2, 3)
    middle = g.total(g.Mul(x, centre2 / 4), 2, 3)
    sign = g.Sign(g.Sub(middle, around))  # +1 for a bright target, -1 for a dark one
    signed = g.Mul(x, sign)
    top = g.ReduceMax(g.Add(signed, g.const((centre2 - 1) * 10)), axes=[2, 3], keepdims=1)
    above = g.mask(g.Greater(signed, g.Sub(top, g.Mul(contrast, 0.5))))
    component = g.Mul(above, centre2)
    for _ in range(FLOOD_STEPS):
        component = g.Mul(g.dilate(component), above)
    leak = g.ReduceMax(g.Mul(component, border), axes=[2, 3], keepdims=1)

    # The background: a ring two samples wide, one sample clear of the target and of what looks like it (a roof).
    near = g.dilate(component)
    ring = g.Mul(g.Sub(g.dilate(near, 5), near), g.Sub(1.0, above))
    ring_count = g.Max(g.total(ring, 2, 3), g.const([1.0]))
    background = g.Div(g.total(g.Mul(signed, ring), 2, 3), ring_count)
    excess = g.Sub(signed, background)
    ring_variance = g.Div(g.total(g.Mul(g.Mul(excess, excess), ring), 2, 3), ring_count)
    weight = g.Mul(g.Relu(excess), near)
    mass = g.Max(g.total(weight, 2, 3), g.const([1e-6]))
    ramp_x, ramp_y = g.const(grid.reshape(1, 1, 1, -1)), g.const(grid.reshape(1, 1, -1, 1))
    shift = g.Concat(
        *(g.Reshape(g.Div(g.total(g.Mul(weight, ramp), 2, 3), mass), g.ints(-1, 1)) for ramp in (ramp_x, ramp_y)), axis=1
    )
    # Width as the sum of the profile's coverage: exact for a half-covered edge sample.
    amplitude = g.Div(g.total(g.Mul(excess, component), 2, 3), g.Max(g.total(component, 2, 3), g.const([1.0])))
    amplitude = g.Max(amplitude, g.const([1e-6]))
    coverage = g.Clip(g.Div(weight, amplitude), g.const(0.0), g.const(1.0))
    extent = g.Concat(
        *(
            g.Reshape(g.total(g.ReduceMax(coverage, axes=[axis], keepdims=1), 2, 3), g.ints(-1, 1))
            for axis in (2, 3)  # over rows: the profile along x; over columns: along y
        ),
        axis=1,
    )

    centre = g.Add(origin, g.Mul(shift, scale))
    reach = g.Mul(extent, g.const(np.array(scales).reshape(-1, 1) / 2))
    low, high = g.Sub(centre, reach), g.Add(centre, reach)

    # Score: contrast over the ring's deviation, and over what lies further out to the second quietest side.
    snr = g.Div(amplitude, g.Sqrt(g.Add(ring_variance, NOISE_FLOOR**2)))
    deviation = g.Sub(g.Mul(ctx, sign), background)
    sides = g.Conv(g.Mul(deviation, deviation), g.const(strips()))  # [count,4,1,1]
    quietest, _ = g.op("TopK", sides, g.ints(4), axis=1, largest=0, outputs=2)
    clutter = g.total(g.Mul(quietest, g.const(np.reshape(SIDE_WEIGHTS, (1, 4, 1, 1)))), 1)
    clutter = g.Div(clutter, g.Mul(amplitude, amplitude))
    snr_sq = g.Mul(snr, snr)
    score = g.Div(snr_sq, g.Add(snr_sq, SNR_HALF**2))
    score = g.Div(score, g.Add(1.0, g.Mul(clutter, 1 / CLUTTER_HALF**2)))
    score = g.Reshape(g.Mul(score, g.Sub(1.0, leak)), g.ints(-1))

    # Of proposals that share more than half of the smaller box, the best scored stays.
    def pairwise(kind, points):
        return g.op(kind, g.Unsqueeze(points, g.ints(0)), g.Unsqueeze(points, g.ints(1)))

    overlap = g.ReduceProd(g.Relu(g.Sub(pairwise("Min", high), pairwise("Max", low))), axes=[2], keepdims=0)
    area = g.ReduceProd(extent, axes=[1], keepdims=0)
    area = g.Mul(area, g.const(np.array(scales) ** 2))
    same = g.mask(g.Greater(overlap, g.Mul(pairwise("Min", area), 0.5)))
    total = sum(PROPOSALS)
    order = g.Sub(score, g.const(np.arange(total) * 1e-7))  # equal scores: the first stays
    beaten = g.mask(g.Greater(g.Unsqueeze(order, g.ints(0)), g.Unsqueeze(order, g.ints(1))))
    score = g.Mul(score, g.Sub(1.0, g.ReduceMax(g.Mul(same, beaten), axes=[1], keepdims=0)))

    scores, best = g.op("TopK", score, g.ints(DETECTIONS), axis=0, outputs=2)
    boxes = g.Gather(g.Concat(low, high, axis=1), best, axis=0)
    g.nodes.append(helper.make_node("Identity", [scores], ["scores"]))
    g.nodes.append(helper.make_node("Identity", [boxes], ["boxes"]))
    labels = g.const(np.zeros(DETECTIONS), np.int64)
    g.nodes.append(helper.make_node("Identity", [labels], ["labels"]))

    graph = helper.make_graph(
        g.nodes,
        "saliency",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, "height", "width"])],
        [
            helper.make_tensor_value_info("boxes", TensorProto.FLOAT, [DETECTIONS, 4]),
            helper.make_tensor_value_info("scores", TensorProto.FLOAT, [DETECTIONS]),
            helper.make_tensor_value_info("labels", TensorProto.INT64, [DETECTIONS]),
        ],
        list(g.constants.values()),
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8, producer_name="boresight")
    helper.set_model_props(
        model,
        {
            "boresight.interface": "1",
            "classes": json.dumps(["uav"]),
            "preprocess": "native",
            "stride": "1",
            "min_side_px": str(MIN_SIDE_PX),
            "score_threshold": str(SCORE_THRESHOLD),
            "description": "Classical multiscale patch-contrast detector of small UAVs against the sky; not trained.",
        },
    )
    onnx.checker.check_model(model, full_check=True)
    return model


def main():
    default = Path(__file__).resolve().parent.parent / "assets/models/saliency.onnx"
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=default)
    out = parser.parse_args().out
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_bytes(build().SerializeToString(deterministic=True))
    print(f"{out}: {out.stat().st_size} bytes")


if __name__ == "__main__":
    main()
