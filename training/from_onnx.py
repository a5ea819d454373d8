#!/usr/bin/env python3
"""Turns a model that `export.py` wrote back into a checkpoint, for `train.py --init` and `export.py`.

Where each weight lies in the graph is found by writing the same network once more, with weights that are all known. The
export folds batch normalisation into the convolutions: it is put back with the statistics of procedural pictures, so that
the network gives the same answers and learns on from there.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import numpy_helper

import export
import models
from data import Crops


def weights(graph: onnx.ModelProto) -> list[np.ndarray]:
    """The float tensors of a graph, in its order."""
    found = [numpy_helper.to_array(t) for t in graph.graph.initializer]
    return [a for a in found if a.dtype == np.float32 and a.size > 1]


def fingerprint(array: np.ndarray) -> bytes:
    return np.ascontiguousarray(array, np.float32).tobytes()


def mark(model: torch.nn.Module) -> None:
    """Gives every weight numbers that no other has; batch normalisation only adds."""
    torch.manual_seed(1)
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.normal_(0, 0.05)
        for module in model.modules():
            if isinstance(module, torch.nn.BatchNorm2d):
                module.weight.fill_(1)
                module.running_mean.zero_()
                module.running_var.fill_(1 - module.eps)


def put_back(model: torch.nn.Module, pictures: torch.Tensor) -> None:
    """Lets each batch normalisation normalise what it sees in `pictures` and undo that by its scale and shift."""

    def adopt(norm: torch.nn.BatchNorm2d, inputs: tuple[torch.Tensor, ...]) -> None:
        variance, mean = torch.var_mean(inputs[0], (0, 2, 3))
        norm.running_mean.copy_(mean)
        norm.running_var.copy_(variance)
        norm.weight.copy_((variance + norm.eps).sqrt())
        norm.bias.add_(mean)

    hooks = [m.register_forward_pre_hook(adopt) for m in model.modules() if isinstance(m, torch.nn.BatchNorm2d)]
    with torch.no_grad():
        model.decode(pictures)
    for hook in hooks:
        hook.remove()


def read(path: Path) -> tuple[torch.nn.Module, dict[str, str]]:
    """The network of an ONNX file with its weights, and the file's metadata."""
    graph = onnx.load(path)
    meta = {p.key: p.value for p in graph.metadata_props}
    name = json.loads(meta["training"])["model"]
    model = models.build(name, len(json.loads(meta["classes"]))).eval()
    foldable = hasattr(model, "fold")
    if foldable:
        model.fold()
    mark(model)
    copy = onnx.load_from_string(export.to_onnx(model, json.loads(meta["classes"]), 0.5, "", {}))
    shipped, ours = weights(graph), weights(copy)
    if [a.shape for a in shipped] != [a.shape for a in ours]:
        raise SystemExit(f"{path}: its weights are not laid out as those that this program writes")
    state = model.state_dict()
    places: dict[bytes, tuple[str, bool]] = {}
    for key, value in state.items():
        if value.is_floating_point() and value.numel() > 1:
            places[fingerprint(value.numpy())] = (key, False)
            if value.ndim == 2:
                places[fingerprint(value.numpy().T)] = (key, True)
    taken: set[str] = set()
    with torch.no_grad():
        for theirs, known in zip(shipped, ours):
            key, turned = places.get(fingerprint(known), ("", False))
            if key:
                given = (theirs.T if turned else theirs).reshape(state[key].shape)
                state[key].copy_(torch.from_numpy(np.array(given)))
                taken.add(key)
    whole = {k for k, p in model.named_parameters() if p.numel() > 1}
    plain = {f"{n}.weight" for n, m in model.named_modules() if isinstance(m, torch.nn.BatchNorm2d)}
    missing = sorted(whole - plain - taken)
    print(f"{path}: {len(taken)} tensors read, {len(missing)} not in the graph{': ' if missing else ''}{', '.join(missing[:4])}")
    crops = Crops(None, 5, size=256)
    count = 8 if model.fixed_size else 32  # the larger canvas costs more
    pictures = torch.stack([crops[n][0] for n in range(count)]).permute(0, 3, 1, 2).float() / 255
    put_back(model, pictures)
    if foldable:
        model.fold(False)
    return model, meta


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", type=Path, help="a .onnx file by export.py")
    parser.add_argument("--out", type=Path, required=True, help="checkpoint to write (.pt)")
    args = parser.parse_args()
    model, meta = read(args.model)
    name, classes = json.loads(meta["training"])["model"], json.loads(meta["classes"])
    state = {"ema": model.state_dict(), "recipe": {"model": name}, "classes": classes, "step": 0, "seconds": 0.0, "machine": ""}
    # The same answers as the file's own, or nothing.
    crops = Crops(None, 9, size=256)
    high, wide = model.fixed_size or (256, 256)
    worst = 0.0
    for n in range(4):
        image = np.zeros((1, 3, high, wide), np.float32)
        image[0, :, :256, :256] = crops[n][0].permute(2, 0, 1).numpy() / 255
        theirs = export.session(args.model.read_bytes()).run(["scores"], {"image": image})[0]
        with torch.no_grad():
            ours = model.decode(torch.from_numpy(image))[1].numpy()
        worst = max(worst, float(np.abs(theirs[:, :5] - ours[:, :5]).max()))
    if worst > 0.02:
        raise SystemExit(f"{args.model}: the checkpoint's scores differ by up to {worst:.3f}")
    args.out.parent.mkdir(parents=True, exist_ok=True)
    torch.save(state, args.out)
    print(f"{args.out}: {name}, {', '.join(classes)}; scores agree within {worst:.1e}")


if __name__ == "__main__":
    main()
