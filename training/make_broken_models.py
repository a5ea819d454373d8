#!/usr/bin/env python3
"""Writes the small faulty models that the Rust tests load: tests/data/models/{truncated,wrong_inputs,nan}.onnx."""

import json
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

FOLDER = Path(__file__).resolve().parent.parent / "tests/data/models"


def model(input_name, input_shape, score):
    """One box whose score is `score` plus zero times the image's mean."""
    constants = {
        "boxes_value": np.array([[8, 8, 16, 16]], np.float32),
        "score_value": np.array([score], np.float32),
        "labels_value": np.array([0], np.int64),
        "zero": np.array(0, np.float32),
        "one": np.array([1], np.int64),
    }
    nodes = [
        helper.make_node("ReduceMean", [input_name], ["mean"], keepdims=0),
        helper.make_node("Mul", ["mean", "zero"], ["nothing"]),
        helper.make_node("Reshape", ["nothing", "one"], ["nothing_1"]),
        helper.make_node("Add", ["score_value", "nothing_1"], ["scores"]),
        helper.make_node("Identity", ["boxes_value"], ["boxes"]),
        helper.make_node("Identity", ["labels_value"], ["labels"]),
    ]
    graph = helper.make_graph(
        nodes,
        "broken",
        [helper.make_tensor_value_info(input_name, TensorProto.FLOAT, input_shape)],
        [
            helper.make_tensor_value_info("boxes", TensorProto.FLOAT, [1, 4]),
            helper.make_tensor_value_info("scores", TensorProto.FLOAT, [1]),
            helper.make_tensor_value_info("labels", TensorProto.INT64, [1]),
        ],
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    built = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8, producer_name="boresight")
    helper.set_model_props(
        built,
        {
            "boresight.interface": "1",
            "classes": json.dumps(["uav"]),
            "preprocess": "native",
            "stride": "1",
            "min_side_px": "64",
            "score_threshold": "0.5",
            "description": "A faulty model for tests.",
        },
    )
    onnx.checker.check_model(built, full_check=True)
    return built.SerializeToString(deterministic=True)


def main():
    FOLDER.mkdir(parents=True, exist_ok=True)
    nan = model("image", [1, 3, "height", "width"], np.nan)
    files = {
        "nan.onnx": nan,
        "truncated.onnx": nan[: len(nan) // 2],
        "wrong_inputs.onnx": model("pixels", [1, "length"], 0.9),
    }
    for name, content in files.items():
        (FOLDER / name).write_bytes(content)
        print(f"{FOLDER / name}: {len(content)} bytes")


if __name__ == "__main__":
    main()
