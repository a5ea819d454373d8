"""Stone Soup's trackers, fed with a recording one exposure after the other.

- `gnn`: a Kalman filter and the global nearest neighbour (`GNNWith2DAssignment`).
- `jpda`: joint probabilistic data association, exact (`JPDAwithEHM2`).
- `mht`: Stone Soup has no tracker called so; its multi-frame assignment (`MFADataAssociator`, `MFAHypothesiser`) is one that is
  track-oriented: hypotheses over a window, the best of all tracks together, n-scan pruning.

States: angle, rate, acceleration of azimuth (times the cosine of the middle's elevation), then of elevation; mrad, mrad/s, mrad/s².
"""

import dataclasses
import datetime
import functools
import math
import time

import numpy as np
from stonesoup.dataassociator.mfa import MFADataAssociator
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.dataassociator.probability import JPDAwithEHM2
from stonesoup.deleter.time import UpdateTimeDeleter
from stonesoup.functions import gm_reduce_single
from stonesoup.hypothesiser.base import Hypothesiser
from stonesoup.base import Property
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.hypothesiser.mfa import MFAHypothesiser
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.initiator.simple import MultiMeasurementInitiator
from stonesoup.measures import SquaredMahalanobis
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, Singer
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.array import CovarianceMatrix, StateVector, StateVectors
from stonesoup.types.detection import Detection, MissedDetection
from stonesoup.types.hypothesis import SingleProbabilityHypothesis
from stonesoup.types.mixture import GaussianMixture
from stonesoup.types.multihypothesis import MultipleHypothesis
from stonesoup.types.numeric import Probability
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.types.state import GaussianState, TaggedWeightedGaussianState
from stonesoup.types.update import GaussianMixtureUpdate, GaussianStateUpdate
from stonesoup.updater.kalman import KalmanUpdater

from rivals_recording import FRESH_S, ray_of

KINDS = ("gnn", "jpda", "mht")
# What Boresight's filter states of its targets: manoeuvres held for 3 s, gate at 5σ, an unknown first rate of 0.02 rad/s.
ACCEL_TAU_S = 3.0  # [s]
RATE_MRADPS = 20.0  # [mrad/s]
GATE_NIS = 25.0
GATE_PROBABILITY = 1 - math.exp(-GATE_NIS / 2)  # χ² of two degrees of freedom
# Of a track's hypotheses so many of the likeliest are kept: their number decides how long a scan takes.
MOST_COMPONENTS = 5
UAV_LABELS = ("uav", "drone", "quadcopter", "hexacopter", "octocopter", "multirotor", "fixed_wing")

EPOCH = datetime.datetime(2000, 1, 1)
ANGLES = [0, 3]


@dataclasses.dataclass(frozen=True)
class Settings:
    """What is tuned.

    accel: rms acceleration that the filter expects [mrad/s², m/s² at 1 km]. labels: "all" boxes, or those called a UAV.
    floor: a box goes on with a track from this share of the detector's threshold on; it starts one from the threshold on.
    hits: boxes that start a track, none more than 0.25 s apart. silent_s: a track without hits is kept so long [s].
    window: scans over which `mht` keeps hypotheses.
    """

    accel: float = 1.0
    labels: str = "all"
    floor: float = 1.0
    hits: int = 6
    silent_s: float = 3.0
    window: int = 3


@dataclasses.dataclass(frozen=True)
class Rates:
    """A camera's errors as measured: noise of a box's middle per axis [px], chance to find what it sees, false boxes a picture."""

    noise_px: float
    found: float
    false: float


def wanted(scan, settings):
    """The boxes of a scan that a tracker with these settings gets."""
    return [
        box for box in scan.found
        if box.score >= settings.floor * scan.threshold and (settings.labels == "all" or box.label in UAV_LABELS)
    ]


class Motion(CombinedLinearGaussianTransitionModel):
    """Stone Soup's combined model, which works its matrices out once for each interval."""

    def matrix(self, time_interval, **_):
        return self._matrix(time_interval)

    def covar(self, time_interval, **_):
        return self._covar(time_interval)

    @functools.cache
    def _matrix(self, time_interval):
        return np.asarray(super().matrix(time_interval=time_interval), float)

    @functools.cache
    def _covar(self, time_interval):
        return np.asarray(super().covar(time_interval=time_interval), float)


class Predictor(KalmanPredictor):
    """Stone Soup's, without the control that nothing here has: half of its time went into adding zeros."""

    def _predicted_covariance(self, prior, predict_over_interval, **_):
        matrix = self.transition_model.matrix(predict_over_interval)
        covar = matrix @ np.asarray(prior.covar, float) @ matrix.T + self.transition_model.covar(predict_over_interval)
        return covar.view(CovarianceMatrix)

    def _transition_function(self, prior, time_interval=None, **_):
        return (self.transition_model.matrix(time_interval) @ np.asarray(prior.state_vector, float)).view(StateVector)


class Angles(LinearGaussian):
    """Stone Soup's model of a measurement, which works its matrix out once."""

    @functools.cached_property
    def _once(self):
        return super().matrix()

    def matrix(self, **_):
        return self._once


class Near(Hypothesiser):
    """Hands on what lies in a rectangle about the gate, which spares Stone Soup work and changes no result.

    Where `sees` says that a state is not in the picture there is one hypothesis, certain: what a camera does not see it cannot
    miss. Multi-frame assignment wants every track in every scan.
    """

    hypothesiser: Hypothesiser = Property(doc="what makes hypotheses of the rest")
    predictor: KalmanPredictor = Property(doc="the same as that one's")
    sees: object = Property(default=None, doc="whether a state is in the picture at a time")

    def hypothesise(self, track, detections, timestamp, **kwargs):
        if self.sees is not None and not self.sees(track, timestamp):
            prediction = self.predictor.predict(track, timestamp=timestamp)
            missed = SingleProbabilityHypothesis(prediction, MissedDetection(timestamp=timestamp), Probability(1))
            return MultipleHypothesis([missed])
        return self.hypothesiser.hypothesise(track, self.near(track, detections, timestamp), timestamp, **kwargs)

    def near(self, track, detections, timestamp):
        """Those of the detections that may lie in a track's gate."""
        if not detections:
            return set()
        prediction = self.predictor.predict(track, timestamp=timestamp)
        x, p = np.asarray(prediction.state_vector, float), np.asarray(prediction.covar, float)
        near = set()
        for one in detections:
            noise = one.measurement_model.noise_covar
            if all(
                (float(one.state_vector[k, 0]) - x[i, 0]) ** 2 <= GATE_NIS * (p[i, i] + float(noise[k, k]))
                for k, i in enumerate(ANGLES)
            ):
                near.add(one)
        return near


class Replay:
    """A Stone Soup tracker. `rates` by camera."""

    def __init__(self, kind, settings, rates, recording):
        self.kind, self.settings = kind, settings
        self.cameras, self.tick_hz = recording.cameras, recording.tick_hz
        self.centre_rad = recording.centre_rad()
        # Stationary variance of the acceleration is q τ / 2.
        axis = Singer(noise_diff_coeff=2 * settings.accel**2 / ACCEL_TAU_S, damping_coeff=1 / ACCEL_TAU_S)
        self.predictor = Predictor(Motion([axis, axis]))
        # The default form lets the covariance grow lopsided; after some 2,000 updates the JPDA's tracks are lost by it.
        self.updater = KalmanUpdater(None, use_joseph_cov=True)
        distance = DistanceHypothesiser(self.predictor, self.updater, SquaredMahalanobis(), missed_distance=GATE_NIS)
        nearest = GNNWith2DAssignment(Near(distance, self.predictor))
        deviations = [0.0, RATE_MRADPS, settings.accel] * 2
        self.initiator = MultiMeasurementInitiator(
            prior_state=GaussianState(np.zeros((6, 1)), np.diag(np.square(deviations))),
            deleter=UpdateTimeDeleter(datetime.timedelta(seconds=FRESH_S)),
            data_associator=nearest,
            updater=self.updater,
            min_points=settings.hits,
        )
        self.models, self.associators = {}, {}
        for name, camera in self.cameras.items():
            rate = rates[name]
            spread = np.diag([(rate.noise_px * camera.ifov_mrad) ** 2] * 2)
            self.models[name] = Angles(ndim_state=6, mapping=ANGLES, noise_covar=spread)
            likely = PDAHypothesiser(
                self.predictor,
                self.updater,
                clutter_spatial_density=rate.false / camera.area_mrad2,
                prob_detect=rate.found,
                prob_gate=GATE_PROBABILITY,
                # Multi-frame assignment sets them against a false alarm's likelihood ratio of 1.
                normalise=kind != "mht",
            )
            self.associators[name] = nearest
            if kind == "jpda":
                self.associators[name] = JPDAwithEHM2(Near(likely, self.predictor))
            elif kind == "mht":
                many = MFAHypothesiser(Near(likely, self.predictor))
                self.associators[name] = MFADataAssociator(many, slide_window=settings.window)
        self.tracks, self.numbers, self.last_hit = [], {}, {}
        self.scans, self.spent_s = 0, 0.0

    def time(self, tick):
        """A tick as Stone Soup has times."""
        return EPOCH + datetime.timedelta(seconds=tick / self.tick_hz)

    def angles_mrad(self, ray):
        """Angles from the centre, where azimuth is not near its seam."""
        azimuth, elevation = math.atan2(ray[0], ray[1]), math.asin(ray[2])
        across = math.remainder(azimuth - self.centre_rad[0], 2 * math.pi) * math.cos(self.centre_rad[1])
        return 1e3 * across, 1e3 * (elevation - self.centre_rad[1])

    def best(self, state):
        """The likeliest Gaussian of a state."""
        if isinstance(state, GaussianMixture):
            return max(state.components, key=lambda component: component.weight)
        return state

    def ray(self, state, at):
        """Where a state points at a time, by its rates alone: the acceleration moves nothing in so short a time."""
        state = self.best(getattr(state, "state", state))
        ahead_s = (at - state.timestamp).total_seconds()
        x = state.state_vector
        across, up = (float(x[i, 0]) + ahead_s * (float(x[i + 1, 0]) + 0.5 * ahead_s * float(x[i + 2, 0])) for i in ANGLES)
        azimuth = self.centre_rad[0] + 1e-3 * across / math.cos(self.centre_rad[1])
        return ray_of(azimuth, self.centre_rad[1] + 1e-3 * up)

    def look(self, scan, rotation):
        """Takes one exposure in; `rotation` turns the camera's frame into enu."""
        began = time.process_time()
        at, camera, name = self.time(scan.exposure), self.cameras[scan.camera], scan.camera
        detections, starts = [], set()
        for box in wanted(scan, self.settings):
            vector = np.array([self.angles_mrad(box.ray)]).T
            detection = Detection(vector, timestamp=at, measurement_model=self.models[name])
            detections.append(detection)
            if box.score >= scan.threshold:
                starts.add(detection)

        def sees(state, timestamp):
            return camera.project(rotation, self.ray(state, timestamp)) is not None

        associator = self.associators[name]
        if self.kind == "mht":
            associator.hypothesiser.hypothesiser.sees = sees
            asked = self.tracks
        else:
            asked = [track for track in self.tracks if sees(track, at)]
        used_by_any = set()
        for track, hypotheses in self.associated(associator, asked, detections, at):
            state, used = {"gnn": self.nearest, "jpda": self.mixed, "mht": self.many}[self.kind](hypotheses)
            track.append(state)
            # Nothing here looks further back, and Stone Soup keeps all of it.
            del track.states[:-2]
            if used:
                self.last_hit[track] = scan.exposure
            used_by_any |= used
        # Stone Soup's UpdateTimeDeleter, without its walk over all that a track ever was.
        self.tracks = [track for track in self.tracks if self.quiet_s(track, scan.exposure) <= self.settings.silent_s]
        new = self.initiator.initiate(starts - used_by_any, at)
        # A set has no order of its own; identities are to be the same in every run.
        for track in sorted(new, key=lambda track: float(track.state_vector[0, 0])):
            if self.kind == "mht":
                state = track.state
                track.append(GaussianMixture([TaggedWeightedGaussianState(
                    state.state_vector, state.covar, state.timestamp, weight=Probability(1), tag=[0] * self.settings.window
                )]))
            self.numbers[track] = len(self.numbers) + 1
            self.last_hit[track] = scan.exposure
            self.tracks.append(track)
        self.scans += 1
        self.spent_s += time.process_time() - began

    def associated(self, associator, tracks, detections, at):
        """Each track with what Stone Soup says of it.

        JPDA is asked for one group of tracks at a time that share boxes, for its time grows with all that it is asked at once.
        Groups share nothing, so that no probability changes.
        """
        if self.kind != "jpda":
            return list(associator.associate(tracks, set(detections), at).items())
        groups = []
        for track in tracks:
            group = {track}, associator.hypothesiser.near(track, detections, at)
            for other in [other for other in groups if other[1] & group[1]]:
                groups.remove(other)
                group = group[0] | other[0], group[1] | other[1]
            groups.append(group)
        return [pair for some, boxes in groups for pair in associator.associate(some, boxes, at).items()]

    def quiet_s(self, track, tick):
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
        at = states[0].timestamp
        if used:
            return GaussianStateUpdate(mean, covar, hypotheses, at), used
        return GaussianStatePrediction(mean, covar, at), used

    def many(self, hypotheses):
        """The hypotheses that are left of a track as one mixture, and what the likeliest took."""
        kept = sorted(hypotheses, key=lambda h: h.prediction.weight, reverse=True)[:MOST_COMPONENTS]
        components = [self.updater.update(h) if h else h.prediction for h in kept]
        for component in components:
            # Older choices are made, and a tag is copied with every hypothesis.
            component.tag = component.tag[-self.settings.window:]
        used = {kept[0].measurement} if kept[0] else set()
        return GaussianMixtureUpdate(components=components, hypothesis=MultipleHypothesis(kept)), used

    def alive(self, tick, camera, rotation):
        """Tracks in a camera's picture at a tick: identity, x, y [px], and whether the last hit is fresh."""
        found = []
        for track in self.tracks:
            px = camera.project(rotation, self.ray(track, self.time(tick)))
            if px is not None:
                found.append((self.numbers[track], *px, self.quiet_s(track, tick) < FRESH_S))
        return found


def replay(kind, settings, rates, recording):
    """All tracks at each of the recording's ticks, as `Replay.alive` has them, and the time a scan took [ms]."""
    tracker = Replay(kind, settings, rates, recording)
    camera, next_scan, rows = recording.cameras[recording.coarse], 0, []
    for tick in recording.ticks:
        # In order of exposure, none before it is known.
        while next_scan < len(recording.scans) and recording.scans[next_scan].known <= tick:
            scan = recording.scans[next_scan]
            tracker.look(scan, recording.rotation[scan.exposure][scan.camera])
            next_scan += 1
        rows.append(tracker.alive(tick, camera, recording.rotation[tick][recording.coarse]))
    return rows, 1e3 * tracker.spent_s / max(tracker.scans, 1)
