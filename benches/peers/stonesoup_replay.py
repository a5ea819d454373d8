"""What `stonesoup_tracks.py` measures: a recording's detections through Stone Soup's trackers, and the scores."""

import datetime
import functools
import math
import statistics

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from scipy.optimize import linear_sum_assignment
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.dataassociator.probability import JPDAwithEHM2
from stonesoup.deleter.time import UpdateTimeDeleter
from stonesoup.functions import gm_reduce_single
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.initiator.simple import MultiMeasurementInitiator
from stonesoup.measures import SquaredMahalanobis
from stonesoup.metricgenerator.ospametric import GOSPAMetric
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, Singer
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.array import StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.types.state import GaussianState, State
from stonesoup.types.update import GaussianStateUpdate
from stonesoup.updater.kalman import KalmanUpdater

# Cameras of the preset `urban_1km`: name, horizontal field [deg]; all have 640 x 480 pixels. Their order is that in
# which exposures of one tick are taken.
WIDTH_PX, HEIGHT_PX = 640, 480
FIELDS_DEG = {"stv": 6.0, "ctv": 3.0, "ptv": 1.0}
COARSE = "ctv"

# What a track must have to count, as `boresight eval tracking` has it.
CONFIRMED_HITS = 6
FRESH_S = 0.25  # [s]
# What Boresight's filter states of its targets: manoeuvres held for 3 s, gate at 5σ, an unknown first rate of
# 0.02 rad/s, silent tracks kept for 3 s. In mrad, as all angles here.
ACCEL_TAU_S = 3.0  # [s]
RATE_MRADPS = 20.0  # [mrad/s]
GATE_NIS = 25.0
SILENT_S = 3.0  # [s]
# GOSPA's cut-off: the distance up to which `eval tracking` says that a line of sight is on an object.
CUTOFF_MRAD = 1.0  # [mrad]
ORDER = 2

EPOCH = datetime.datetime(2000, 1, 1)
ANGLES = [0, 3]  # of the state: angle, rate, acceleration of azimuth, then of elevation
NOTHING_HELD = ("search", "acquire", "lost")


class BadInput(Exception):
    """What the user must mend."""


class Camera:
    """A pinhole camera."""

    def __init__(self, field_deg):
        self.focal_px = 0.5 * WIDTH_PX / math.tan(math.radians(field_deg) / 2)
        self.ifov_mrad = 1e3 * 2 * math.atan(0.5 / self.focal_px)
        self.area_mrad2 = WIDTH_PX * HEIGHT_PX * self.ifov_mrad**2

    def az_el_rad(self, rotation, px):
        """Azimuth and elevation of an image point of a camera turned by `rotation` (cam to enu)."""
        ray = rotation @ np.array([px[0] - 0.5 * WIDTH_PX, px[1] - 0.5 * HEIGHT_PX, self.focal_px])
        return math.atan2(ray[0], ray[1]), math.atan2(ray[2], math.hypot(ray[0], ray[1]))

    def project(self, rotation, enu):
        """The image point of a direction, or nothing if that is not in the picture."""
        x, y, z = rotation.T @ enu
        if z <= 0.0:
            return None
        px = 0.5 * WIDTH_PX + self.focal_px * x / z, 0.5 * HEIGHT_PX + self.focal_px * y / z
        return px if 0 <= px[0] < WIDTH_PX and 0 <= px[1] < HEIGHT_PX else None


CAMERAS = {name: Camera(field_deg) for name, field_deg in FIELDS_DEG.items()}


def direction(az_rad, el_rad):
    """Unit vector in enu."""
    return np.array([math.sin(az_rad) * math.cos(el_rad), math.cos(az_rad) * math.cos(el_rad), math.sin(el_rad)])


def rotation_of(q):
    """Matrix of a quaternion message."""
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])


class Recording:
    """What run.mcap holds of a run: `poses[tick][camera]` is rotation and place, `batches` are (exposure tick, camera,
    tick from which on they are known, image points [px]) in order of exposure, `distractors[tick]` are places [m],
    `held` are the ticks whose state holds a target."""

    def __init__(self, path):
        self.poses, self.distractors, self.batches, self.held = {}, {}, [], []
        self.last_tick = 0
        try:
            with open(path, "rb") as file:
                reader = make_reader(file, decoder_factories=[DecoderFactory()])
                notes = {note.name: note.metadata for note in reader.iter_metadata()}["boresight"]
                self.scenario, self.seed = notes["scenario"], int(notes["seed"])
                self.tick_hz, epoch_ns = int(notes["tick_hz"]), int(notes["epoch_unix_ns"])
                own = ("tick", "uav_state", "track_state", "detections")
                topics = ["/tf", *(f"/boresight/{name}" for name in own)]
                for _, channel, message, proto in reader.iter_decoded_messages(topics=topics):
                    tick = round((message.log_time - epoch_ns) * 1e-9 * self.tick_hz)
                    self._take(channel.topic, tick, proto)
        except (OSError, McapError, KeyError, ValueError) as error:
            raise BadInput(f"{path}: not a recording of `boresight run`: {error!r}") from error
        order = list(FIELDS_DEG)
        self.batches.sort(key=lambda batch: (batch[0], order.index(batch[1])))

    def _take(self, topic, tick, proto):
        if topic == "/boresight/tick":
            self.last_tick = tick
        elif topic == "/tf":
            self.poses[tick] = {
                t.child_frame_id: (
                    rotation_of(t.rotation),
                    np.array([t.translation.x, t.translation.y, t.translation.z]),
                )
                for t in proto.transforms
                if t.child_frame_id in CAMERAS
            }
        elif topic == "/boresight/uav_state":
            # A UAV's status is what became of it, a distractor's is its kind.
            if proto.status in ("bird", "balloon", "aircraft", "leaf"):
                at = np.array([proto.r_enu_m.x, proto.r_enu_m.y, proto.r_enu_m.z])
                self.distractors.setdefault(tick, []).append(at)
        elif topic == "/boresight/track_state":
            if proto.state not in NOTHING_HELD:
                self.held.append(tick)
        elif topic == "/boresight/detections":
            points = [(0.5 * (d.box.x0_px + d.box.x1_px), 0.5 * (d.box.y0_px + d.box.y1_px)) for d in proto.detections]
            self.batches.append((proto.exposure_tick, proto.camera, proto.available_tick, points))

    def snapshots(self, period_ticks):
        """Ticks of the coarse camera's clock from the first that holds a target on."""
        first = next((tick for tick in self.held if tick % period_ticks == 0), None)
        if first is None:
            raise BadInput("the run never holds a target")
        return list(range(first, self.last_tick + 1, period_ticks))


class Motion(CombinedLinearGaussianTransitionModel):
    """Stone Soup's combined model, which works its matrices out once for each interval."""

    @functools.cache
    def matrix(self, time_interval, **_):
        return super().matrix(time_interval=time_interval)

    @functools.cache
    def covar(self, time_interval, **_):
        return super().covar(time_interval=time_interval)


class Replay:
    """A Stone Soup tracker that is fed one exposure after the other."""

    def __init__(self, kind, accel_mradps2, noise_px, miss_rate, false_alarms, centre_rad, tick_hz):
        self.kind, self.centre_rad, self.tick_hz = kind, centre_rad, tick_hz
        # Stationary variance of the acceleration is q τ / 2.
        axis = Singer(noise_diff_coeff=2 * accel_mradps2**2 / ACCEL_TAU_S, damping_coeff=1 / ACCEL_TAU_S)
        self.predictor = KalmanPredictor(Motion([axis, axis]))
        # The default form lets the covariance grow lopsided; after some 2,000 updates the JPDA's tracks are lost by it.
        self.updater = KalmanUpdater(None, use_joseph_cov=True)
        nearest = GNNWith2DAssignment(
            DistanceHypothesiser(self.predictor, self.updater, SquaredMahalanobis(), missed_distance=GATE_NIS)
        )
        deviations = [0.0, RATE_MRADPS, accel_mradps2] * 2
        self.initiator = MultiMeasurementInitiator(
            prior_state=GaussianState(np.zeros((6, 1)), np.diag(np.square(deviations))),
            deleter=UpdateTimeDeleter(datetime.timedelta(seconds=FRESH_S)),
            data_associator=nearest,
            updater=self.updater,
            min_points=CONFIRMED_HITS,
        )
        self.models, self.associators = {}, {}
        for name, camera in CAMERAS.items():
            sigma_mrad = noise_px * camera.ifov_mrad
            spread = np.diag([(sigma_mrad / math.cos(centre_rad[1])) ** 2, sigma_mrad**2])
            self.models[name] = LinearGaussian(ndim_state=6, mapping=ANGLES, noise_covar=spread)
            self.associators[name] = nearest
            if kind == "jpda":
                likely = PDAHypothesiser(
                    self.predictor,
                    self.updater,
                    clutter_spatial_density=false_alarms / camera.area_mrad2,
                    prob_detect=1 - miss_rate,
                    prob_gate=1 - math.exp(-GATE_NIS / 2),  # χ² of two degrees of freedom
                )
                self.associators[name] = JPDAwithEHM2(likely)
        self.tracks, self.numbers, self.last_hit = [], {}, {}

    def time(self, tick):
        """A tick as Stone Soup has times."""
        return EPOCH + datetime.timedelta(seconds=tick / self.tick_hz)

    def angles_mrad(self, az_rad, el_rad):
        """Angles from the centre, where azimuth is not near its seam."""
        az0_rad, el0_rad = self.centre_rad
        return 1e3 * math.remainder(az_rad - az0_rad, 2 * math.pi), 1e3 * (el_rad - el0_rad)

    def enu(self, state):
        """Where a state points."""
        az_mrad, el_mrad = (float(state.state_vector[i, 0]) for i in ANGLES)
        return direction(self.centre_rad[0] + 1e-3 * az_mrad, self.centre_rad[1] + 1e-3 * el_mrad)

    def look(self, tick, name, rotation, points_px):
        """Takes one exposure in."""
        time, camera = self.time(tick), CAMERAS[name]
        detections = {
            Detection(
                np.array([self.angles_mrad(*camera.az_el_rad(rotation, px))]).T,
                timestamp=time,
                measurement_model=self.models[name],
            )
            for px in points_px
        }
        # What the camera does not see it cannot miss.
        in_view = [
            track for track in self.tracks
            if camera.project(rotation, self.enu(self.predictor.predict(track, timestamp=time))) is not None
        ]
        left = set(detections)
        for track, hypotheses in self.associators[name].associate(in_view, detections, time).items():
            state, used = self.mixed(hypotheses) if self.kind == "jpda" else self.nearest(hypotheses)
            track.append(state)
            if used:
                self.last_hit[track] = tick
            left -= used
        # Stone Soup's UpdateTimeDeleter, without its walk over all that a track ever was.
        self.tracks = [track for track in self.tracks if self.silent_s(track, tick) <= SILENT_S]
        new = self.initiator.initiate(left, time)
        # A set has no order of its own; identities are to be the same in every run.
        for track in sorted(new, key=lambda track: float(track.state_vector[0, 0])):
            self.numbers[track] = len(self.numbers) + 1
            self.last_hit[track] = tick
            self.tracks.append(track)

    def silent_s(self, track, tick):
        """Time since a track was last hit."""
        return (tick - self.last_hit[track]) / self.tick_hz

    def nearest(self, hypothesis):
        """State of a track after one assignment, and what it took."""
        if not hypothesis:
            return hypothesis.prediction, set()
        return self.updater.update(hypothesis), {hypothesis.measurement}

    def mixed(self, hypotheses):
        """State of a track after a weighted assignment, and what it took; as Stone Soup's MultiTargetMixtureTracker."""
        states = [self.updater.update(h) if h else h.prediction for h in hypotheses]
        mean, covar = gm_reduce_single(
            StateVectors([state.state_vector for state in states]),
            np.stack([state.covar for state in states], axis=2),
            np.asarray([h.probability for h in hypotheses]),
        )
        missed = next(h.weight for h in hypotheses if not h)
        used = {h.measurement for h in hypotheses if h and h.weight > missed}
        time = states[0].timestamp
        if used:
            return GaussianStateUpdate(mean, covar, hypotheses, time), used
        return GaussianStatePrediction(mean, covar, time), used

    def shown(self, tick, rotation):
        """Identity and image point in the coarse camera of the tracks that count at a tick."""
        found = []
        for track in self.tracks:
            if self.silent_s(track, tick) < FRESH_S:
                state = self.predictor.predict(track, timestamp=self.time(tick))
                px = CAMERAS[COARSE].project(rotation, self.enu(state))
                if px is not None:
                    found.append((self.numbers[track], *px))
        return found


def replay(kind, accel_mradps2, recording, ticks, detector):
    """The tracks at `ticks`: a list of (identity, x, y) [px] for each."""
    rotation, _ = recording.poses[ticks[0]][COARSE]
    centre_rad = CAMERAS[COARSE].az_el_rad(rotation, (0.5 * WIDTH_PX, 0.5 * HEIGHT_PX))
    tracker = Replay(kind, accel_mradps2, **detector, centre_rad=centre_rad, tick_hz=recording.tick_hz)
    batches, next_batch, shown = recording.batches, 0, []
    for tick in ticks:
        # In order of exposure, none before it is known.
        while next_batch < len(batches) and batches[next_batch][2] <= tick:
            exposure, camera, _, points_px = batches[next_batch]
            tracker.look(exposure, camera, recording.poses[exposure][camera][0], points_px)
            next_batch += 1
        shown.append(tracker.shown(tick, recording.poses[tick][COARSE][0]))
    return shown


def on_distractors(recording, ticks, truth, shown):
    """The tracks without those that are on a distractor: assigned to all that fly, at most the cut-off away."""
    camera, kept = CAMERAS[COARSE], []
    for tick, uavs, tracks in zip(ticks, truth, shown):
        rotation, place = recording.poses[tick][COARSE]
        others = [camera.project(rotation, at - place) for at in recording.distractors.get(tick, [])]
        objects = [(x, y) for _, x, y in uavs] + [px for px in others if px is not None]
        if not tracks or len(objects) == len(uavs):
            kept.append(tracks)
            continue
        away = np.array([[camera.ifov_mrad * math.dist(track[1:], px) for px in objects] for track in tracks])
        pairs = zip(*linear_sum_assignment(np.minimum(away, CUTOFF_MRAD)))
        drop = {row for row, column in pairs if column >= len(uavs) and away[row, column] < CUTOFF_MRAD}
        kept.append([track for row, track in enumerate(tracks) if row not in drop])
    return kept


class Tally:
    """GOSPA and the share of one identity, over runs."""

    def __init__(self):
        self.metric = GOSPAMetric(p=ORDER, c=CUTOFF_MRAD)
        self.distances, self.kept = [], []
        self.localisation = self.matched = self.missed = self.false = 0.0

    def add(self, truth, shown):
        """Takes one run in."""
        ifov_mrad, owners, seen = CAMERAS[COARSE].ifov_mrad, {}, {}
        for uavs, tracks in zip(truth, shown):
            if not uavs and not tracks:
                self.distances.append(0.0)
                continue
            found, true = (
                [State(np.array([[x], [y]]) * ifov_mrad, EPOCH) for _, x, y in rows] for rows in (tracks, uavs)
            )
            metric, assigned = self.metric.compute_gospa_metric(found, true)
            part = metric.value
            penalty = CUTOFF_MRAD**ORDER / 2
            self.distances.append(float(part["distance"]))
            self.localisation += part["localisation"]
            self.missed += part["missed"] / penalty
            self.false += part["false"] / penalty
            for index, (uav, *_) in enumerate(uavs):
                seen[uav] = seen.get(uav, 0) + 1
                if len(assigned) and assigned[index] >= 0:
                    self.matched += 1
                    counts = owners.setdefault(uav, {})
                    identity = tracks[assigned[index]][0]
                    counts[identity] = counts.get(identity, 0) + 1
        self.kept += [max(owners.get(uav, {0: 0}).values()) / frames for uav, frames in seen.items()]

    def figures(self):
        """What the runs say together; rounded, for Stone Soup sums in an order that memory addresses decide."""
        frames = len(self.distances)
        figures = {
            "gospa_mrad": statistics.fmean(self.distances),
            "localisation_rms_urad": 1e3 * math.sqrt(self.localisation / self.matched) if self.matched else None,
            "missed_per_frame": self.missed / frames,
            "false_per_frame": self.false / frames,
            "one_identity_share": statistics.fmean(self.kept),
        }
        return {"frames": frames, **{key: value and round(value, 9) for key, value in figures.items()}}
