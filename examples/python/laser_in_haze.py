"""The laser's own light breaks a track: precise and coarse camera before and while it fires into haze.

python examples/python/laser_in_haze.py [PICTURE.png]    # above without, below with a filter before the cameras
"""

import sys

import boresight
import numpy as np
from PIL import Image

CAMERAS = ["ptv", "ctv"]
SIDE_PX = 128


def look(scenario):
    """What both cameras show in the middle of their sensors, just before fire and 0.25 s into it: 2 × 2 pictures."""
    with boresight.Simulation(f"scenarios/{scenario}.toml", pictures=True) as run:
        shown, before = {}, {}
        fired_s = 0.0
        while fired_s < 0.25:
            run.step(8)
            shown |= {frame.camera: middle(frame) for frame in run.frames}
            if run.stations[0].beam.firing:
                fired_s += 8 / 960
            elif fired_s == 0.0 and run.t_s > 1.0:
                before = dict(shown)
        return [[pictures[camera] for pictures in (before, shown)] for camera in CAMERAS]


def middle(frame):
    """Up to SIDE_PX × SIDE_PX pixels about the middle of what was read out, on black."""
    rows, columns = (max(0, (side - SIDE_PX) // 2) for side in frame.pixels.shape[:2])
    picture = frame.pixels[rows : rows + SIDE_PX, columns : columns + SIDE_PX]
    canvas = np.zeros((SIDE_PX, SIDE_PX, 3), np.uint8)
    canvas[: picture.shape[0], : picture.shape[1]] = picture
    return canvas


if __name__ == "__main__":
    rows = [np.concatenate(sum(look(f"haze_{name}"), []), axis=1) for name in ("bare", "filter")]
    picture = np.concatenate(rows).repeat(2, axis=0).repeat(2, axis=1)
    Image.fromarray(picture).save(sys.argv[1] if len(sys.argv) > 1 else "laser_in_haze.png")
