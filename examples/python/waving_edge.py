"""Buildings' edges wave in turbulence: two towers in calm and in strong air, side by side in one picture.

python examples/python/waving_edge.py [PICTURE.png]
"""

import sys

import boresight
import numpy as np
from PIL import Image

AZIMUTH_ELEVATION_DEG = [302.99, -1.1]  # two towers of the generated city
WIDE_DEG = 0.4  # 11 µrad a pixel


def look(cn2):
    """The coarse camera's first frame after the mount has turned there, [480, 640, 3]."""
    changes = {
        "turbulence.cn2_ground": cn2,
        "station.cameras.coarse.hfov_deg": WIDE_DEG,
        "station.cameras.coarse.rate_hz": 2,
        "station.cameras.search.rate_hz": 1,
        "station.mount.base_motion": {"rms_urad": 0, "frequency_hz": 1},
        "detector.kind": "truth",
        "engage.authorised": False,
    }
    with boresight.Simulation("scenarios/urban_intercept.toml", seed=3, pictures=True, set=changes) as run:
        run.give(slew_deg=AZIMUTH_ELEVATION_DEG)
        run.run_until(2.0)
        run.step(960)  # while nothing is held it shows every other frame
        return next(frame.pixels for frame in run.frames if frame.camera == "ctv")


if __name__ == "__main__":
    rows = [look(cn2)[180:480] for cn2 in (1e-15, 1e-13)]
    Image.fromarray(np.concatenate(rows, axis=1)).save(sys.argv[1] if len(sys.argv) > 1 else "waving_edge.png")
