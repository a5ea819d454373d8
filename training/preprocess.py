"""The one rule from a frame to a model's input, as `boresight` keeps it (tests/data/preprocess.json holds both to it)."""

import numpy as np


def native(rgb: np.ndarray, stride: int, min_side_px: int, fixed_size: tuple[int, int] | None = None) -> np.ndarray:
    """Planes float32 [1,3,H,W] of a picture uint8 [h,w,3]: RGB / 255, zeros at right and bottom up to a multiple of
    `stride` that is at least `min_side_px`, or up to `fixed_size` (H, W); a larger picture is a `ValueError`."""
    h, w = rgb.shape[:2]
    if fixed_size is not None:
        high, wide = fixed_size
        if h > high or w > wide:
            raise ValueError(f"a picture of {w} x {h} does not fit the model's {wide} x {high}")
    else:
        high, wide = (-(-max(side, min_side_px) // stride) * stride for side in (h, w))
    out = np.zeros((1, 3, high, wide), np.float32)
    out[0, :, :h, :w] = np.moveaxis(rgb, 2, 0).astype(np.float32) / np.float32(255)
    return out
