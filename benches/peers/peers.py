#!/usr/bin/env python3
"""Renders one scene with MuJoCo and PyBullet on the CPU and prints it beside Boresight's figures.

    python benches/peers/peers.py              makes a venv of its own, installs, measures
    python benches/peers/peers.py --frames 50  more frames a figure

The scene: a city of 1,050 boxes on a plane, a camera 48 m above it, a body of a small UAV's size
1 km away just above the skyline; 640 x 480, horizontal fields of 1 and 6 degrees as Boresight's precise and search camera
have them; with one sample a pixel, and with four where the engine offers it (MuJoCo: multisampling;
PyBullet: its software renderer offers none, so a picture of twice the side is averaged). Shadows are
off, as in Boresight. Every figure is the median over frames in which the camera turns a little.

Boresight's own column is read from what `cargo bench` left in `--criterion`.
"""

import argparse
import json
import math
import os
import pathlib
import random
import statistics
import sys
import time

import own_venv

WIDTH, HEIGHT = 640, 480
STATION_M = (0.0, 0.0, 48.0)
UAV_M = (-707.0, 707.0, 58.0)
FIELDS_DEG = (1.0, 6.0)
# Criterion's group and name of Boresight's frame at each field.
OURS = {1.0: ("frame", "precise 640x480, rendering and readback"), 6.0: ("frame", "search 640x480, rendering and readback")}
# What else is compared with MuJoCo's full frame of four samples, and its field [deg]. With sensor model and truth a camera
# renders as in a run, the part with something solid in it alone.
MORE = {
    "256 x 256 window": (1.0, ("frame", "precise 256x256, rendering and readback")),
    "all of a frame, 1°": (1.0, ("frame", "precise 640x480, with sensor model and truth")),
    "all of a frame, 6°": (6.0, ("frame", "search 640x480, with sensor model and truth")),
    "woods and fields, 1°": (1.0, ("place", "woods, precise")),
    "woods and fields, 6°": (6.0, ("place", "woods, search")),
}


def city():
    """Centre [m] and half sides [m] of 1,050 boxes about the station, the same in every run."""
    rng = random.Random(1)
    boxes = []
    for row in range(-16, 17):
        for column in range(-16, 17):
            if abs(row) <= 1 and abs(column) <= 1:
                continue  # the station's own block
            # None near the station stands in the way; the far ones make the skyline.
            tall = 54 if math.hypot(row, column) > 9 else 36
            half = (rng.uniform(10, 24), rng.uniform(10, 24), 0.5 * rng.choice((12, 18, 24, 30, tall)))
            boxes.append(((70.0 * row, 70.0 * column, half[2]), half))
    return rng.sample(boxes, 1050)


def uav():
    """Boxes of a quadcopter 0.35 m across: hull and two arms."""
    return [((0, 0, 0), (0.1, 0.1, 0.05)), ((0, 0, 0), (0.17, 0.015, 0.01)), ((0, 0, 0), (0.015, 0.17, 0.01))]


def vertical_deg(horizontal_deg):
    """Vertical field of a picture whose pixels are square."""
    return math.degrees(2 * math.atan(HEIGHT / WIDTH * math.tan(math.radians(horizontal_deg) / 2)))


def median_ms(draw, frames):
    """Median time of `draw(i)` [ms], after two frames that warm up."""
    draw(0)
    draw(1)
    times = []
    for i in range(frames):
        started = time.perf_counter()
        draw(i)
        times.append(1e3 * (time.perf_counter() - started))
    return statistics.median(times)


def aim_m(i):
    """Where frame i looks: near the UAV."""
    return (UAV_M[0] + 0.05 * (i % 20), UAV_M[1], UAV_M[2])


def mujoco_ms(field_deg, samples, frames):
    """Milliseconds a frame, readback included."""
    import mujoco
    import numpy

    def geom(centre, half, grey=0.6):
        return f'<geom type="box" rgba="{grey} {grey} {grey} 1" pos="{centre[0]} {centre[1]} {centre[2]}" size="{half[0]} {half[1]} {half[2]}"/>'

    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco>
        <statistic extent="1" center="0 0 0"/>
        <visual><map znear="0.5" zfar="5000"/><quality offsamples="{samples}" shadowsize="0"/>
          <global offwidth="{WIDTH}" offheight="{HEIGHT}" fovy="{vertical_deg(field_deg)}"/></visual>
        <asset><texture type="skybox" builtin="gradient" rgb1=".4 .6 .9" rgb2=".8 .9 1" width="64" height="384"/></asset>
        <worldbody><light directional="true" dir="-1 1 -2" castshadow="false"/>
          <geom type="plane" size="5000 5000 1"/>
          {"".join(geom(*box) for box in city())}
          <body pos="{UAV_M[0]} {UAV_M[1]} {UAV_M[2]}">{"".join(geom(*box, grey=0.05) for box in uav())}</body>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    pixels = numpy.empty((HEIGHT, WIDTH, 3), numpy.uint8)
    with mujoco.Renderer(model, HEIGHT, WIDTH, max_geom=3000) as renderer:

        def draw(i):
            look = numpy.subtract(aim_m(i), STATION_M)
            camera.lookat, camera.distance = aim_m(i), numpy.linalg.norm(look)
            camera.azimuth = numpy.degrees(numpy.arctan2(look[1], look[0]))
            camera.elevation = numpy.degrees(numpy.arcsin(look[2] / camera.distance))
            renderer.update_scene(data, camera)
            renderer.render(out=pixels)

        result = median_ms(draw, frames)
    if pixels.max() - pixels.min() < 10:
        raise RuntimeError("MuJoCo's picture is blank")
    return result


def pybullet_ms(field_deg, samples, frames):
    """Milliseconds a frame of the software renderer (TinyRenderer), readback included."""
    import numpy
    import pybullet

    scale = 2 if samples == 4 else 1
    client = pybullet.connect(pybullet.DIRECT)
    try:
        for centre, half in city():
            shape = pybullet.createVisualShape(pybullet.GEOM_BOX, halfExtents=half, rgbaColor=(0.6, 0.6, 0.6, 1))
            pybullet.createMultiBody(0, -1, shape, centre)
        ground = pybullet.createVisualShape(pybullet.GEOM_BOX, halfExtents=(5000, 5000, 0.5))
        pybullet.createMultiBody(0, -1, ground, (0, 0, -0.5))
        for centre, half in uav():
            shape = pybullet.createVisualShape(pybullet.GEOM_BOX, halfExtents=half, rgbaColor=(0.05, 0.05, 0.05, 1))
            pybullet.createMultiBody(0, -1, shape, numpy.add(UAV_M, centre))
        projection = pybullet.computeProjectionMatrixFOV(vertical_deg(field_deg), WIDTH / HEIGHT, 0.5, 5000)
        picture = None

        def draw(i):
            nonlocal picture
            view = pybullet.computeViewMatrix(STATION_M, aim_m(i), (0, 0, 1))
            _, _, rgba, _, _ = pybullet.getCameraImage(
                scale * WIDTH, scale * HEIGHT, view, projection, (1, -1, 2), shadow=0,
                flags=pybullet.ER_NO_SEGMENTATION_MASK, renderer=pybullet.ER_TINY_RENDERER,
            )
            picture = numpy.reshape(rgba, (scale * HEIGHT, scale * WIDTH, 4))[:, :, :3]
            if scale > 1:
                picture = picture.reshape(HEIGHT, scale, WIDTH, scale, 3).mean((1, 3)).astype(numpy.uint8)

        result = median_ms(draw, frames)
    finally:
        pybullet.disconnect(client)
    if picture.max() - picture.min() < 10:
        raise RuntimeError("PyBullet's picture is blank")
    return result


def ours_ms(criterion, bench):
    """Milliseconds from criterion's estimates of a group and name; None if `cargo bench` left none."""
    path = criterion.joinpath(*bench, "new", "estimates.json")
    try:
        return 1e-6 * json.loads(path.read_text())["median"]["point_estimate"]
    except (OSError, ValueError, KeyError):
        return None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR") or own_venv.CACHE / "target")
    parser.add_argument("--frames", type=int, default=20, help="frames a figure (default 20)")
    parser.add_argument("--criterion", type=pathlib.Path, default=target / "criterion",
                        help="folder that `cargo bench` filled (default %(default)s)")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if not args.inside:
        own_venv.continue_in("peers-venv", "requirements.txt")
    # On the CPU, whatever GPU there is: Boresight's figures are for software rendering too.
    os.environ.setdefault("MUJOCO_GL", "egl")
    os.environ.setdefault("LIBGL_ALWAYS_SOFTWARE", "1")
    print("640 x 480, 1,050 boxes, milliseconds a frame with readback (median)\n")
    mujoco = {}  # its four samples [ms] at each field
    print(f"{'field':>6} {'samples':>8} {'Boresight':>10} {'MuJoCo':>8} {'PyBullet':>9}")
    for field_deg in FIELDS_DEG:
        for samples in (0, 4):
            # Boresight's cameras always take four samples.
            ours = ours_ms(args.criterion, OURS[field_deg]) if samples == 4 else None
            cells = [f"{ours:.1f}" if ours else "-"]
            for engine in (mujoco_ms, pybullet_ms):
                try:
                    cells.append(f"{(taken := engine(field_deg, samples, args.frames)):.1f}")
                    if engine is mujoco_ms:
                        mujoco[field_deg] = taken
                except Exception as error:  # an engine that cannot run here leaves its cell empty
                    print(f"peers: {engine.__name__[:-3]}: {error}", file=sys.stderr)
                    cells.append("-")
            print(f"{field_deg:>5.0f}° {max(samples, 1):>8} {cells[0]:>10} {cells[1]:>8} {cells[2]:>9}", flush=True)
    print("\nBoresight's time over that of MuJoCo's full frame of four samples\n")
    full = {f"640 x 480 frame, {field_deg:.0f}°": (field_deg, bench) for field_deg, bench in OURS.items()}
    for name, (field_deg, bench) in (full | MORE).items():
        ours = ours_ms(args.criterion, bench)
        ratio = f"{ours / mujoco[field_deg]:.2f}" if ours and field_deg in mujoco else "-"
        print(f"{name:>30} {ratio:>6}")
    if ours_ms(args.criterion, OURS[FIELDS_DEG[0]]) is None:
        print(f"\nBoresight's column is empty: run `cargo bench` first (looked in {args.criterion})")


if __name__ == "__main__":
    main()
