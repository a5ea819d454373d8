"""Runs that `boresight serve` records, with every track of its tracker, and what is read of them.

Angles are in mrad on the sky as the station has it, azimuth times the cosine of the middle's elevation; image points are full-sensor
pixels. Poses are true ones.
"""

import dataclasses
import functools
import importlib.util
import json
import math
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

ROOT = pathlib.Path(__file__).resolve().parents[2]
HOLDING = ("coarse", "precise", "engage")
# What a track must have to count, as `boresight eval tracking` has it.
CONFIRMED_HITS = 6
FRESH_S = 0.25  # [s]
# The distance up to which `eval tracking` says that a line of sight is on an object.
CUTOFF_MRAD = 1.0
# Seen means at least this share of it in the picture and not behind something.
CLEAR_SHARE = 0.5
DISTRACTORS = ("bird", "balloon", "aircraft", "leaf")


class BadInput(Exception):
    """What the user must mend."""


@functools.cache
def client_module():
    """Boresight's client, a file that needs nothing but Python: the package beside it would want the compiled part."""
    path = ROOT / "python" / "boresight" / "client.py"
    spec = importlib.util.spec_from_file_location("boresight_client", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def make(program, scenario, seed, settings, capture, folder):
    """Has Boresight make and record a run in `folder`, unless it is there, and writes down its tracks (`tracks.json`).

    Returns the command that makes the same run without this program. The state is read once a period of the coarse camera.
    """
    options = ["--seed", str(seed), *([] if capture else ["--no-capture"])]
    for setting in settings:
        options += ["--set", setting]
    command = " ".join(["boresight", "run", scenario, *options])
    if (folder / "tracks.json").exists():
        return command
    print(f"rivals: {command}", file=sys.stderr, flush=True)
    client = client_module()
    client = client_module()
    shutil.rmtree(folder, ignore_errors=True)
    with tempfile.TemporaryDirectory() as short:
        # A Unix socket's path has to be short, and only this user reaches it.
        socket = f"{short}/run"
        try:
            server = subprocess.Popen(
                [program, "serve", scenario, *options, "--threads", "1", "--unix", socket, "--out", folder],
                cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            )
        except OSError as error:
            raise BadInput(f"{program}: {error.strerror}; name the program with --boresight") from error
        try:
            while not os.path.exists(socket):
                if server.poll() is not None:
                    raise BadInput(f"`{command}` failed: {server.stderr.read().decode()}")
                time.sleep(0.02)
            document = watch(client, socket)
        except client.ServerError as error:
            raise BadInput(f"`{command}`: {error}") from error
        finally:
            if server.poll() is None:
                try:
                    server.communicate(timeout=60)
                except subprocess.TimeoutExpired:
                    server.terminate()
    (folder / "tracks.json").write_text(json.dumps(document))
    return command


def watch(client, socket):
    """Steps a served run to its end; what its tracker believed, by coarse exposure."""
    with client.Run(socket) as run:
        cameras = {camera.tier: camera for camera in run.welcome.cameras}
        snapshots, over = [], False
        while not over:
            stepped = run.step(cameras["coarse"].period_ticks, state=True)
            over, station = stepped.over, stepped.state.stations[0]
            tracks = [(t.id, *t.az_el_rad, t.uav_probability, t.hits) for t in station.tracks]
            held = station.target if station.state in HOLDING else None
            snapshots.append((stepped.state.tick, held, tracks))
        finished = run.finish()
    return {
        "uavs": run.welcome.uavs,
        "cameras": {
            camera.name: [camera.tier, camera.width_px, camera.height_px, camera.focal_px, camera.period_ticks]
            for camera in cameras.values()
        },
        "state_hash": f"{finished.state_hash:016x}",
        "snapshots": snapshots,
    }


@dataclasses.dataclass(frozen=True)
class Camera:
    """A pinhole camera."""

    tier: str
    width_px: int
    height_px: int
    focal_px: float
    period_ticks: int

    @property
    def ifov_mrad(self):
        """Angle of a pixel on the axis."""
        return 1e3 / self.focal_px

    @property
    def area_mrad2(self):
        """What a picture covers."""
        return self.width_px * self.height_px * self.ifov_mrad**2

    def ray(self, rotation, px):
        """Unit vector in enu of an image point of a camera turned by `rotation` (cam to enu)."""
        ray = np.array([px[0] - 0.5 * self.width_px, px[1] - 0.5 * self.height_px, self.focal_px])
        return rotation @ (ray / np.linalg.norm(ray))

    def project(self, rotation, ray):
        """The image point of a direction, or None if that is not in the picture."""
        x, y, z = rotation.T @ ray
        if z <= 0.0:
            return None
        px = 0.5 * self.width_px + self.focal_px * x / z, 0.5 * self.height_px + self.focal_px * y / z
        return px if 0 <= px[0] < self.width_px and 0 <= px[1] < self.height_px else None


@dataclasses.dataclass(frozen=True)
class Found:
    """One box of the detector: its middle [px], direction (enu), score and class."""

    px: tuple
    ray: np.ndarray
    score: float
    label: str


@dataclasses.dataclass(frozen=True)
class Scan:
    """What one exposure found: ticks of the exposure and from which on it is known, camera, score from which a box counts."""

    exposure: int
    camera: str
    known: int
    threshold: float
    found: tuple


def ray_of(azimuth_rad, elevation_rad):
    """Unit vector in enu; azimuth from north to east."""
    flat = math.cos(elevation_rad)
    return np.array([math.sin(azimuth_rad) * flat, math.cos(azimuth_rad) * flat, math.sin(elevation_rad)])


def rotation_of(q):
    """Matrix of a quaternion message."""
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])


class Recording:
    """One run.

    `cameras` by name, of which `coarse` is the coarse one; `scans` in order of exposure; `rotation[tick][camera]`;
    `truth[tick]` has (name, image point) of all that flies in clear sight in the coarse picture, `in_camera[tick, camera]`
    the same of any exposure; `ticks` are the coarse exposures from which the tracker's state is known, `first` the place
    among them of the first that holds a target; `own[tick]` is (target, tracks).
    """

    def __init__(self, folder):
        try:
            noted = json.loads((folder / "tracks.json").read_text())
            self.cameras = {name: Camera(*values) for name, values in noted["cameras"].items()}
            self.coarse = next(name for name, camera in self.cameras.items() if camera.tier == "coarse")
            self.uavs, self.state_hash = noted["uavs"], noted["state_hash"]
            self.own = {tick: (held, tracks) for tick, held, tracks in noted["snapshots"]}
            self.rotation, self.in_camera, self.kinds, self.scans = {}, {}, {}, []
            with open(folder / "run.mcap", "rb") as file:
                reader = make_reader(file, decoder_factories=[DecoderFactory()])
                notes = {note.name: note.metadata for note in reader.iter_metadata()}["boresight"]
                self.tick_hz, epoch_ns = int(notes["tick_hz"]), int(notes["epoch_unix_ns"])
                raw = []
                topics = ["/tf", *(f"/boresight/{name}" for name in ("uav_state", "frame_truth", "detections"))]
                for _, channel, message, proto in reader.iter_decoded_messages(topics=topics):
                    tick = round((message.log_time - epoch_ns) * 1e-9 * self.tick_hz)
                    self._take(channel.topic, tick, proto, raw)
        except (OSError, McapError, KeyError, ValueError) as error:
            raise BadInput(f"{folder}: not a run that this program recorded: {error!r}; remove it") from error
        # The server names distractors after the UAVs.
        self.uavs = [name for name in self.uavs if self.is_uav(name)]
        for proto in raw:
            camera, rotation = self.cameras[proto.camera], self.rotation[proto.exposure_tick][proto.camera]
            found = []
            for d in proto.detections:
                px = 0.5 * (d.box.x0_px + d.box.x1_px), 0.5 * (d.box.y0_px + d.box.y1_px)
                found.append(Found(px, camera.ray(rotation, px), d.score, d.label))
            self.scans.append(Scan(proto.exposure_tick, proto.camera, proto.available_tick, proto.threshold, tuple(found)))
        self.scans.sort(key=lambda scan: (scan.exposure, list(self.cameras).index(scan.camera)))
        self.truth = {tick: seen for (tick, name), seen in self.in_camera.items() if name == self.coarse}
        self.ticks = sorted(tick for tick in self.own if tick in self.truth and tick in self.rotation)
        self.first = next((i for i, tick in enumerate(self.ticks) if self.own[tick][0] is not None), None)
        if self.first is None:
            raise BadInput(f"{folder}: the run never holds a target")

    def _take(self, topic, tick, proto, raw):
        if topic == "/tf":
            self.rotation[tick] = {
                t.child_frame_id: rotation_of(t.rotation) for t in proto.transforms if t.child_frame_id in self.cameras
            }
        elif topic == "/boresight/uav_state":
            # A UAV's status is what became of it, a distractor's is its kind.
            if proto.status in DISTRACTORS:
                self.kinds[proto.name] = proto.status
        elif topic == "/boresight/frame_truth":
            camera, seen = self.cameras[proto.camera], []
            for uav in proto.uavs:
                px = 0.5 * (uav.box.x0_px + uav.box.x1_px), 0.5 * (uav.box.y0_px + uav.box.y1_px)
                inside = 0 <= px[0] < camera.width_px and 0 <= px[1] < camera.height_px
                if uav.visible_fraction >= CLEAR_SHARE and inside:
                    seen.append((uav.name, px))
            self.in_camera[proto.exposure_tick, proto.camera] = seen
        else:
            raw.append(proto)

    def is_uav(self, name):
        """Whether something that flies is a UAV."""
        return name not in self.kinds

    def centre_rad(self):
        """Azimuth and elevation about which angles are taken: where the coarse camera looks at the first hold."""
        axis = self.rotation[self.ticks[self.first]][self.coarse] @ np.array([0.0, 0.0, 1.0])
        return math.atan2(axis[0], axis[1]), math.asin(axis[2])

    def own_tracks(self, shown_probability):
        """Boresight's shown tracks (identity, x, y) [px] and its target's identity at each of `ticks`.

        A track is shown with six hits, the last within a quarter of a second, and as likely a UAV as `shown_probability`.
        """
        camera, counts, shown, targets = self.cameras[self.coarse], {}, [], []
        for tick in self.ticks:
            held, tracks = self.own[tick]
            row, seen = [], []
            for identity, azimuth, elevation, probability, hits in tracks:
                before, since = counts.get(identity, (0, tick))
                if hits != before:
                    counts[identity] = hits, tick
                    since = tick
                fresh = tick - since < FRESH_S * self.tick_hz
                px = camera.project(self.rotation[tick][self.coarse], ray_of(azimuth, elevation))
                if hits >= CONFIRMED_HITS and fresh and px is not None:
                    seen.append((identity, *px))
                    if probability >= shown_probability:
                        row.append((identity, *px))
            shown.append(row)
            # The target counts whatever it is taken for: the operator pointed at it.
            targets.append(next(((identity, *px) for identity, *px in seen if identity == held), None))
        return shown, targets
