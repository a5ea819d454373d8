"""The detectors by name, and the protocol they share.

A model is an `nn.Module` with
- `loss(images [B,3,H,W] 0..1, targets)`: dict of scalar losses, sum under "total"; a target is a dict of `boxes`
  [n,4] x0, y0, x1, y1 px, `labels` int64 [n] and, where a net can use it, `ignore` [k,4];
- `decode(images [B,3,H,W])`: boxes [B,N,4] px, scores [B,N] falling, labels int64 [B,N], traceable; the score is that of being a UAV where the label is a UAV's, and of being none of them where it is not (`verdict.py`);
  for nets that tell it apart from the box's, the middle of each body [B,N,2] px;
- `name`, `stride` and `min_side_px` of its input, `fixed_size` (None, or the only (H, W) its ONNX graph takes).
"""

from torch import nn

CLASSES = ("fpv", "quadcopter", "hexacopter", "bird", "aeroplane", "helicopter", "balloon", "other")
NAMES = ("yolo-n", "d-fine", "d-fine-nwd", "d-fine-nwd-p2", "d-fine-nwd-p2-dsam", "boresight-p2", "boresight-p2-roi")


def build(name: str, num_classes: int = len(CLASSES), **kw) -> nn.Module:
    """A model with random weights; `ValueError` for an unknown name."""
    if name not in NAMES:
        raise ValueError(f"no model {name!r}: one of {', '.join(NAMES)}")
    if name.startswith("d-fine"):
        from dfine import build_dfine

        return build_dfine(name, num_classes, **kw)
    import convnets

    nets = {"boresight-p2": convnets.BoresightP2, "boresight-p2-roi": convnets.BoresightP2Roi, "yolo-n": convnets.YoloN}
    return nets[name](name, num_classes, **kw)
