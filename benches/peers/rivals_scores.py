"""The scores of all trackers, by one code, against the recorded truth.

A run's tracks are lists of (identity, x, y) [px] in the coarse camera's picture, one for each of its exposures; a target is such a
triple or None. On something means at most `CUTOFF_MRAD` from it.
"""

import datetime
import math
import statistics

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.stats import t as student
from stonesoup.metricgenerator.ospametric import GOSPAMetric
from stonesoup.types.state import State

from rivals_recording import CUTOFF_MRAD

ORDER = 2  # of GOSPA, whose cut-off is CUTOFF_MRAD
EPOCH = datetime.datetime(2000, 1, 1)
# After the first hold a tracker may sort out for so long which UAV is meant.
SETTLED_S = 1.0
LEAST_SIDE_PX = 8.0  # of a box that TrackEval scores


def chosen(recording, shown):
    """The target of a tracker that chooses none by itself, at each tick: one of the tracks shown there, or None.

    The operator points at the scenario's first UAV: the first track shown on it from the first hold on. That identity is the target
    until it is shown for the last time. Then it is the shown track nearest to where the lost one last was.
    """
    camera, target, last, targets = recording.cameras[recording.coarse], None, None, []
    end = {identity: index for index, row in enumerate(shown) for identity, *_ in row}
    for index, (tick, row) in enumerate(zip(recording.ticks, shown)):
        at = {identity: (x, y) for identity, x, y in row}
        if index >= recording.first and (target is None or end[target] < index):
            near, reach_px = last, math.inf
            if last is None:
                near = dict(recording.truth[tick]).get(recording.uavs[0])
                reach_px = CUTOFF_MRAD / camera.ifov_mrad
            away = [(math.dist(near, place), identity) for identity, place in at.items()] if near else []
            distance, identity = min(away, default=(math.inf, None))
            target = identity if distance <= reach_px else None
        targets.append((target, *at[target]) if target in at else None)
        last = at.get(target, last)
    return targets


def shown_of(rows):
    """The tracks that count: those with a fresh hit."""
    return [[track[:3] for track in row if track[3]] for row in rows]


def assigned(camera, tracks, objects):
    """Pairs (track, object) of places in both lists, at most the cut-off apart."""
    if not tracks or not objects:
        return []
    away = np.array([[camera.ifov_mrad * math.dist(track[1:], px) for _, px in objects] for track in tracks])
    pairs = zip(*linear_sum_assignment(np.minimum(away, CUTOFF_MRAD)))
    return [(row, column) for row, column in pairs if away[row, column] < CUTOFF_MRAD]


def target_figures(recording, targets):
    """Shares of the frames that show the lock in clear sight: target on it, on something else; how often it was lost.

    Frames count from a second after the first hold on. The lock is the first UAV that the target is on from then on, whichever it
    is: UAVs that begin within a milliradian of each other leave it open which of them the operator has pointed at.
    """
    camera = recording.cameras[recording.coarse]
    begin = recording.ticks[recording.first] + SETTLED_S * recording.tick_hz
    frames = []
    for tick, target in zip(recording.ticks, targets):
        if tick < begin:
            continue
        objects = recording.truth[tick]
        away = [(camera.ifov_mrad * math.dist(target[1:], px), name) for name, px in objects] if target else []
        distance, name = min(away, default=(math.inf, None))
        frames.append((target is not None, name if distance < CUTOFF_MRAD else None, dict(objects)))
    lock = next((name for _, name, _ in frames if name is not None and recording.is_uav(name)), None)
    if lock is None:
        return {"target_on_share": 0.0, "target_wrong_share": None, "target_lost": None}
    seen = [(has, name == lock) for has, name, objects in frames if lock in objects]
    return {
        "target_on_share": statistics.fmean(on for _, on in seen),
        "target_wrong_share": statistics.fmean(has and not on for has, on in seen),
        "target_lost": sum(before and not on for (_, before), (_, on) in zip(seen, seen[1:])),
    }


def track_figures(recording, shown):
    """GOSPA and its parts, share of UAV time with a track, false tracks a minute, time to the first track."""
    camera = recording.cameras[recording.coarse]
    metric = GOSPAMetric(p=ORDER, c=CUTOFF_MRAD)
    penalty = CUTOFF_MRAD**ORDER / 2
    distances, squares, covered, total, missed, false = [], 0.0, 0, 0, 0.0, 0.0
    frames_of, on_uav, on_other = {}, {}, {}
    seen_first, tracked_first = {}, {}
    for index, (tick, tracks) in enumerate(zip(recording.ticks, shown)):
        objects = recording.truth[tick]
        uavs = [one for one in objects if recording.is_uav(one[0])]
        for name, _ in uavs:
            seen_first.setdefault(name, tick)
        pairs = assigned(camera, tracks, objects)
        for _, column in pairs:
            tracked_first.setdefault(objects[column][0], tick)
        if index < recording.first:
            continue
        for identity, *_ in tracks:
            frames_of[identity] = frames_of.get(identity, 0) + 1
        for row, column in pairs:
            counts = on_uav if recording.is_uav(objects[column][0]) else on_other
            counts[tracks[row][0]] = counts.get(tracks[row][0], 0) + 1
        of_uavs = assigned(camera, tracks, uavs)
        covered += len(of_uavs)
        total += len(uavs)
        squares += sum((camera.ifov_mrad * math.dist(tracks[row][1:], uavs[column][1])) ** 2 for row, column in of_uavs)
        if not uavs and not tracks:
            distances.append(0.0)
            continue
        points = [
            [State(np.array([[x], [y]]) * camera.ifov_mrad, EPOCH) for x, y in places]
            for places in ([track[1:] for track in tracks], [px for _, px in uavs])
        ]
        value = metric.compute_gospa_metric(*points)[0].value
        distances.append(float(value["distance"]))
        missed += value["missed"] / penalty
        false += value["false"] / penalty
    minutes = len(distances) * camera.period_ticks / recording.tick_hz / 60
    not_uav = [one for one, frames in frames_of.items() if on_uav.get(one, 0) < 0.5 * frames]
    on_distractor = [one for one in not_uav if on_other.get(one, 0) >= 0.5 * frames_of[one]]
    end = recording.ticks[-1]
    waits = [(tracked_first.get(name, end) - tick) / recording.tick_hz for name, tick in seen_first.items()]
    return {
        "gospa_mrad": statistics.fmean(distances),
        "localisation_rms_urad": 1e3 * math.sqrt(squares / covered) if covered else None,
        "uav_tracked_share": covered / total if total else None,
        "missed_per_frame": missed / len(distances),
        "false_per_frame": false / len(distances),
        "false_tracks_per_min": len(not_uav) / minutes,
        "of_them_on_distractors_per_min": len(on_distractor) / minutes,
        "first_track_s": statistics.fmean(waits) if waits else None,
    }


def write_mot(folder, rule, name, recording, shown):
    """Truth and tracks as MOTChallenge files, from the first hold on, for TrackEval."""
    camera, half = recording.cameras[recording.coarse], 0.5 * LEAST_SIDE_PX
    gt, data = folder / "gt" / name, folder / "trackers" / rule / "data"
    (gt / "gt").mkdir(parents=True, exist_ok=True)
    data.mkdir(parents=True, exist_ok=True)

    def lines(rows):
        return "".join(
            f"{index + 1},{identity},{x - half:.3f},{y - half:.3f},{LEAST_SIDE_PX},{LEAST_SIDE_PX},1,1,1\n"
            for index, row in enumerate(rows) for identity, x, y in row
        )

    numbers = {uav: index + 1 for index, uav in enumerate(recording.uavs)}
    ticks = recording.ticks[recording.first:]
    truth = [[(numbers[n], *px) for n, px in recording.truth[tick] if n in numbers] for tick in ticks]
    (gt / "gt" / "gt.txt").write_text(lines(truth))
    (gt / "seqinfo.ini").write_text(
        f"[Sequence]\nname={name}\nimDir=img1\nframeRate={recording.tick_hz // camera.period_ticks}\n"
        f"seqLength={len(ticks)}\nimWidth={camera.width_px}\nimHeight={camera.height_px}\nimExt=.jpg\n"
    )
    (data / f"{name}.txt").write_text(lines(shown[recording.first:]))


def pooled(values):
    """Mean over seeds and half of its 95 % interval by Student's t: None of less than three, of which it says nothing."""
    values = [value for value in values if value is not None]
    if not values:
        return {"mean": None, "half": None, "n": 0}
    mean, count = statistics.fmean(values), len(values)
    half = None
    if count > 2:
        half = float(student.ppf(0.975, count - 1)) * statistics.stdev(values) / math.sqrt(count)
    return {"mean": round(mean, 9), "half": None if half is None else round(half, 9), "n": count}
