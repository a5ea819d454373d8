#!/usr/bin/env python3
"""Writes the small faulty models that the Rust tests load, tests/data/models/*.onnx, and good ones beside them."""

import json
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from recogniser_interface import CHIP, CLASSES, FEATURES, STEPS

FOLDER = Path(__file__).resolve().parent.parent / "tests/data/models"

METADATA = {
    "boresight.interface": "1",
    "classes": json.dumps(["uav"]),
    "preprocess": "native",
    "stride": "1",
    "min_side_px": "64",
    "score_threshold": "0.5",
    "description": "A small model for tests.",
}
IMAGE = [1, 3, "height", "width"]


def model(
    name="image",
    shape=IMAGE,
    element=TensorProto.FLOAT,
    score=0.9,
    label=0,
    boxes=((8, 8, 16, 16),),
    renamed=None,
    label_type=np.int64,
    nan_if_uneven=False,
    opset=17,
    ir_version=8,
    **metadata,
):
    """One box whose score is `score` plus nothing times the image's mean, or its contrast's imaginary root.

    `renamed` maps output names to others; a metadata value of None takes the key away.
    """
    constants = {
        "boxes_value": np.array(boxes, np.float32),
        "score_value": np.array([score], np.float32),
        "labels_value": np.array([label], label_type),
        "zero": np.array(0, np.float32),
        "one": np.array([1], np.int64),
    }
    as_float = [helper.make_node("Cast", [name], ["image_f"], to=TensorProto.FLOAT)]
    if nan_if_uneven:
        number = [
            helper.make_node("ReduceMax", ["image_f"], ["most"], keepdims=0),
            helper.make_node("ReduceMin", ["image_f"], ["least"], keepdims=0),
            helper.make_node("Sub", ["least", "most"], ["not_above_zero"]),
            helper.make_node("Sqrt", ["not_above_zero"], ["number"]),
        ]
    else:
        number = [helper.make_node("ReduceMean", ["image_f"], ["number"], keepdims=0)]
    names = {key: (renamed or {}).get(key, key) for key in ("boxes", "scores", "labels")}
    nodes = [
        *as_float,
        *number,
        helper.make_node("Mul", ["number", "zero"], ["nothing"]),
        helper.make_node("Reshape", ["nothing", "one"], ["nothing_1"]),
        helper.make_node("Add", ["score_value", "nothing_1"], [names["scores"]]),
        helper.make_node("Identity", ["boxes_value"], [names["boxes"]]),
        helper.make_node("Identity", ["labels_value"], [names["labels"]]),
    ]
    label_element = helper.np_dtype_to_tensor_dtype(np.dtype(label_type))
    graph = helper.make_graph(
        nodes,
        "test",
        [helper.make_tensor_value_info(name, element, shape)],
        [
            helper.make_tensor_value_info(names["boxes"], TensorProto.FLOAT, constants["boxes_value"].shape),
            helper.make_tensor_value_info(names["scores"], TensorProto.FLOAT, [1]),
            helper.make_tensor_value_info(names["labels"], label_element, [1]),
        ],
        [numpy_helper.from_array(value, key) for key, value in constants.items()],
    )
    built = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=ir_version, producer_name="boresight")
    metadata = METADATA | {("boresight.interface" if key == "interface" else key): value for key, value in metadata.items()}
    helper.set_model_props(built, {key: value for key, value in metadata.items() if value is not None})
    if opset == 17 and ir_version == 8:
        onnx.checker.check_model(built, full_check=True)
    return built.SerializeToString(deterministic=True)


def batches(answers_one=False):
    """A model of [B,3,H,W]: one box a picture, as high as the batch, whose score is the picture's mean; or, with
    `answers_one`, one that says it takes batches and gives the boxes of one picture."""
    constants = {"corner": np.array([8, 0, 16], np.float32), "kind": np.zeros((1, 1), np.int64)}
    constants |= {"first": np.array([0], np.int64), "one": np.array([1], np.int64)}
    nodes = [
        helper.make_node("ReduceMean", ["image"], ["mean"], axes=[1, 2, 3], keepdims=0),
        helper.make_node("Unsqueeze", ["mean", "one"], ["scores"]),
        helper.make_node("Shape", ["image"], ["sides"]),
        helper.make_node("Identity", ["one"], ["count"]) if answers_one else helper.make_node("Gather", ["sides", "first"], ["count"]),
        helper.make_node("Cast", ["count"], ["height"], to=TensorProto.FLOAT),
        helper.make_node("Concat", ["corner", "height"], ["box"], axis=0),
        helper.make_node("Concat", ["count", "one", "one"], ["each"], axis=0),
        helper.make_node("Expand", ["box", "each"], ["boxes"]),
        helper.make_node("Concat", ["count", "one"], ["each_label"], axis=0),
        helper.make_node("Expand", ["kind", "each_label"], ["labels"]),
    ]
    graph = helper.make_graph(
        nodes,
        "test",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, ["batch", *IMAGE[1:]])],
        [
            helper.make_tensor_value_info("boxes", TensorProto.FLOAT, ["batch", 1, 4]),
            helper.make_tensor_value_info("scores", TensorProto.FLOAT, ["batch", 1]),
            helper.make_tensor_value_info("labels", TensorProto.INT64, ["batch", 1]),
        ],
        [numpy_helper.from_array(value, key) for key, value in constants.items()],
    )
    built = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8, producer_name="boresight")
    helper.set_model_props(built, METADATA)
    onnx.checker.check_model(built, full_check=True)
    return built.SerializeToString(deterministic=True)


def recogniser(chips=(STEPS, 3, CHIP, CHIP), total=1.0, features=FEATURES):
    """A recogniser that gives every class the same share of `total`, whatever it is shown."""
    values = (("chips", chips), ("features", (STEPS, len(FEATURES))), ("mask", (STEPS,)))
    constants = {"share": np.full((1, len(CLASSES)), total / len(CLASSES), np.float32), "zero": np.array(0, np.float32)}
    used = [helper.make_node("ReduceMax", [name], [f"{name}_most"], axes=list(range(1, len(s) + 1)), keepdims=0) for name, s in values]
    nodes = [
        *used,
        helper.make_node("Sum", [f"{name}_most" for name, _ in values], ["sum"]),
        helper.make_node("Mul", ["sum", "zero"], ["nothing"]),
        helper.make_node("Unsqueeze", ["nothing", "one"], ["nothing_1"]),
        helper.make_node("Add", ["share", "nothing_1"], ["probabilities"]),
    ]
    constants["one"] = np.array([1], np.int64)
    graph = helper.make_graph(
        nodes,
        "test",
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", *sides]) for name, sides in values],
        [helper.make_tensor_value_info("probabilities", TensorProto.FLOAT, ["batch", len(CLASSES)])],
        [numpy_helper.from_array(value, key) for key, value in constants.items()],
    )
    built = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8, producer_name="boresight")
    names = {"classes": json.dumps(CLASSES), "features": json.dumps(features)}
    helper.set_model_props(built, {"boresight.recogniser": "1"} | names)
    onnx.checker.check_model(built, full_check=True)
    return built.SerializeToString(deterministic=True)


def main():
    FOLDER.mkdir(parents=True, exist_ok=True)
    nan = model(score=np.nan)
    files = {
        "good": model(classes=json.dumps(["fpv", "quadcopter"]), label=1),
        "fixed_size": model(shape=[1, 3, 100, 200], stride="1"),
        "truncated": nan[: len(nan) // 2],
        "wrong_inputs": model(name="pixels", shape=[1, "length"]),
        "input_rank": model(shape=[3, "height", "width"]),
        "input_type": model(element=TensorProto.UINT8),
        "input_channels": model(shape=[1, 1, "height", "width"]),
        "output_name": model(renamed={"boxes": "bboxes"}),
        "output_type": model(label_type=np.int32),
        "output_batch": model(shape=["batch", *IMAGE[1:]]),
        "batches": batches(),
        "batch_of_one": batches(answers_one=True),
        "output_shape": model(boxes=((8, 8, 16, 16, 1),)),
        "interface_missing": model(interface=None),
        "interface_other": model(interface="2"),
        "preprocess": model(preprocess="letterbox"),
        "classes_missing": model(classes=None),
        "classes_empty": model(classes="[]"),
        "classes_twice": model(classes=json.dumps(["uav", "uav"])),
        "side": model(shape=[1, 3, 100_000, 100_000]),
        "stride": model(stride="0"),
        "min_side": model(min_side_px="wide"),
        "threshold": model(score_threshold="1.5"),
        "neutral": model(score_neutral="1"),
        "label": model(label=1),
        "score": model(score=1.5),
        "opset": model(opset=99),
        "ir_version": model(ir_version=99),
        "nan": nan,
        "nan_later": model(nan_if_uneven=True),
        "recogniser": recogniser(),
        "recogniser_features": recogniser(features=FEATURES[:1]),
        "recogniser_inputs": recogniser(chips=(STEPS, 1, CHIP, CHIP)),
        "recogniser_sum": recogniser(total=1.2),
    }
    for name, content in files.items():
        path = FOLDER / f"{name}.onnx"
        path.write_bytes(content)
        print(f"{path}: {len(content)} bytes")


if __name__ == "__main__":
    main()
