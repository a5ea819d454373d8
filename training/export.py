#!/usr/bin/env python3
"""Writes a checkpoint of `train.py` as ONNX of model interface 1, and compares it with PyTorch."""

import argparse
import copy
import io
import json
import os
import warnings
from pathlib import Path

import numpy as np
import onnx
import onnxruntime as ort
import torch

import models
from data import Crops
from preprocess import native

OUTPUTS = ("boxes", "scores", "labels", "centres")  # the last is optional
SHAPES = ((480, 640), (256, 256), (512, 640), (97, 161))  # compared, (height, width)
BOX_PX, SCORE = 0.05, 1e-3  # allowed between PyTorch and ONNX Runtime
# Fainter detections are not compared, but for the best: on plateaus of equal heat (a saturated sky) the last bit decides
# which cell is the peak, and ONNX Runtime rounds otherwise than PyTorch.
FAINT = 0.1


class Decoder(torch.nn.Module):
    """`decode` as `forward`, which is what the exporter traces."""

    def __init__(self, model: torch.nn.Module):
        super().__init__()
        self.model = model

    def forward(self, image: torch.Tensor) -> tuple[torch.Tensor, ...]:
        boxes, scores, labels, *centres = self.model.decode(image)
        return boxes, scores, labels.to(torch.int64), *centres


def load(*paths: Path) -> tuple[torch.nn.Module, dict]:
    """The averaged weights of a checkpoint, of several of one model their mean, ready to infer, and the last checkpoint.

    The mean of runs of which one began where another ended often errs less than either (Wortsman et al., ICML 2022).
    """
    states = [torch.load(path, map_location="cpu", weights_only=True) for path in paths]
    state = states[-1]
    for path, other in zip(paths, states):
        if (other["recipe"]["model"], other["classes"]) != (state["recipe"]["model"], state["classes"]):
            raise SystemExit(f"{path}: another model or other classes than {paths[-1]}; a mean is of one model's runs")
    model = models.build(state["recipe"]["model"], len(state["classes"]))
    try:
        model.load_state_dict({name: mean([other["ema"][name] for other in states]) for name in state["ema"]})
    except RuntimeError as fault:
        raise SystemExit(f"{paths[-1]}: its weights are not those of today's {model.name} ({str(fault).splitlines()[-1].strip()}); train it anew, "
                         "or begin at an exported file (from_onnx.py)") from None  # fmt: skip
    return model.eval(), state


def mean(tensors: list[torch.Tensor]) -> torch.Tensor:
    """Of weights; counters are the last one's."""
    return torch.stack(tensors).mean(0) if tensors[-1].is_floating_point() else tensors[-1]


def to_onnx(
    model: torch.nn.Module, classes: list[str], threshold: float, description: str, training: dict, *, video: float | None = None, neutral: float | None = None
) -> bytes:  # fmt: skip
    """The model as ONNX, opset 17, batch normalisation folded, with the interface's metadata."""
    if hasattr(model, "fold"):
        model = copy.deepcopy(model)
        model.fold()
    height, width = model.fixed_size or (8 * model.stride, 10 * model.stride)
    example = torch.zeros(1, 3, height, width)
    with torch.no_grad():
        shapes = [list(output.shape) for output in model.decode(example)]
    fixed_count = not hasattr(model, "looks")  # as many rows as there are peaks to look at
    dynamic = {"image": {0: "batch"} | ({} if model.fixed_size else {2: "height", 3: "width"})}
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            Decoder(model).eval(), (example,), buffer, opset_version=17, dynamo=False, do_constant_folding=True,
            input_names=["image"], output_names=list(OUTPUTS[: len(shapes)]), dynamic_axes=dynamic,
        )  # fmt: skip
    graph = onnx.load_from_string(buffer.getvalue())
    for node in graph.graph.node:  # where in the source a node came from is nobody's business
        node.doc_string = ""
    del graph.graph.value_info[:]
    for value, shape in zip(graph.graph.output, shapes):
        dims = value.type.tensor_type.shape
        del dims.dim[:]
        for name in ("batch", "detections"):
            dims.dim.add().dim_param = name
        for axis, side in enumerate(shape[1:], 1):
            if axis > 1 or fixed_count:
                (dims.dim[axis] if axis == 1 else dims.dim.add()).dim_value = side
    left = [n.name for n in graph.graph.node if n.op_type == "BatchNormalization"]
    if left and not model.fixed_size:
        raise RuntimeError(f"batch normalisation not folded: {', '.join(left)}")
    graph.ir_version, graph.producer_name, graph.producer_version = 8, "boresight", ""
    onnx.helper.set_model_props(
        graph,
        {
            "boresight.interface": "1",
            "classes": json.dumps(classes),
            "preprocess": "native",
            "stride": str(model.stride),
            "min_side_px": str(model.min_side_px),
            "score_threshold": f"{threshold:g}",
            "description": description,
            "training": json.dumps(training),
        }
        | ({} if video is None else {"score_threshold_video": f"{video:g}"})
        | ({} if neutral is None else {"score_neutral": f"{neutral:g}"}),
    )
    onnx.checker.check_model(graph, full_check=True)
    return graph.SerializeToString(deterministic=True)


def session(model: bytes, threads: int = 1) -> ort.InferenceSession:
    options = ort.SessionOptions()
    options.intra_op_num_threads = threads
    return ort.InferenceSession(model, options, providers=["CPUExecutionProvider"])


def unmatched(one: list[np.ndarray], other: list[np.ndarray]) -> list[str]:
    """Detections of `one` without a partner in `other`: the same box, score and label, in whatever order."""
    free, missing = list(range(len(other[1]))), []
    for k, (box, score, label, *centre) in enumerate(zip(*one)):
        if score < FAINT and k > 0:
            continue
        near = [
            j for j in free
            if abs(other[1][j] - score) < SCORE and other[2][j] == label and np.abs(other[0][j] - box).max() < BOX_PX
            and all(np.abs(other[3][j] - xy).max() < BOX_PX for xy in centre)
        ]  # fmt: skip
        if near:
            free.remove(near[0])
        else:
            missing.append(f"box {np.round(box, 2).tolist()}, score {score:.4f}, label {label}")
    return missing


def compare(model: torch.nn.Module, graph: bytes, pictures: int = 3) -> int:
    """Runs both on procedural pictures of several sizes; how many detections agreed, `RuntimeError` if one did not."""
    runtime, agreed = session(graph), 0
    shapes = [s for s in SHAPES if not model.fixed_size or (s[0] <= model.fixed_size[0] and s[1] <= model.fixed_size[1])]
    for k in range(pictures):
        crops = Crops(None, 1234 + k, negatives=0.0)
        for high, wide in shapes:
            tiles = [crops[n][0].numpy() for n in range(6)]
            rgb = np.concatenate([np.concatenate(tiles[:3], 1), np.concatenate(tiles[3:], 1)])[:high, :wide]
            # Two pictures at once here, and one by one there: a batch must not change what is seen in its pictures.
            pair = [native(x, model.stride, model.min_side_px, model.fixed_size) for x in (rgb, np.ascontiguousarray(rgb[::-1]))]
            batch = runtime.run(None, {"image": np.concatenate(pair)})
            for image, *theirs in zip(pair, *batch):
                with torch.no_grad():
                    ours = [x[0].numpy() for x in Decoder(model)(torch.from_numpy(image))]
                if not all(np.isfinite(x).all() for x in theirs) or (np.diff(theirs[1]) > 0).any():
                    raise RuntimeError(f"{wide} x {high}: an output is not finite or the scores do not fall")
                wrong = unmatched(ours, theirs) + unmatched(theirs, ours)
                if wrong:
                    raise RuntimeError(f"{wide} x {high}: PyTorch and ONNX Runtime differ: " + "; ".join(wrong[:3]))
                agreed += max(1, int((ours[1] >= FAINT).sum()))
    return agreed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkpoints", type=Path, nargs="+", help="a run's last.pt; of several of one model, the mean of their weights")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--threshold", type=float, default=0.5, help="recommended score threshold")
    parser.add_argument("--threshold-video", type=float, help="the same for video of real cameras")
    parser.add_argument("--neutral", type=float, help="score that speaks neither for a UAV nor against it, by the station's tracker")
    parser.add_argument("--description", default="")
    args = parser.parse_args()
    model, state = load(*args.checkpoints)
    recipe = state["recipe"]
    training = {k: recipe[k] for k in ("model", "steps", "batch", "crop", "bf16", "seed", "lr", "procedural", "data") if k in recipe}
    training |= {"step": state["step"], "hours": round(state["seconds"] / 3600, 2), "machine": state["machine"]}
    training |= {"mean_of": len(args.checkpoints)} if len(args.checkpoints) > 1 else {}
    parameters = sum(p.numel() for p in model.parameters())
    description = args.description or f"{model.name}: detector of small UAVs, {parameters / 1e6:.2f} M parameters."
    graph = to_onnx(model, state["classes"], args.threshold, description, training, video=args.threshold_video, neutral=args.neutral)
    agreed = compare(model, graph)
    args.out.parent.mkdir(parents=True, exist_ok=True)
    part = args.out.with_suffix(".part")
    part.write_bytes(graph)
    os.replace(part, args.out)
    print(f"{args.out}: {len(graph)} bytes, {parameters} parameters; {agreed} detections agree with PyTorch")


if __name__ == "__main__":
    main()
