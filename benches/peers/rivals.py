#!/usr/bin/env python3
"""Puts other trackers beside Boresight's, on the detections of recorded runs, and scores all by one code.

    python benches/peers/rivals.py --out DIR                 all scenes, five seeds each
    python benches/peers/rivals.py --out DIR --only swarm    one scene; may be repeated

The rivals: the paper's rule with eq. 10 in both its readings, a Kalman filter with the global nearest neighbour, JPDA and
multi-frame assignment (MHT) of Stone Soup. Makes a venv of its own, then what DIR lacks: recordings (DIR/runs), the rivals'
tuning on seeds that are not scored (DIR/tuning.json), replays (DIR/replays). Prints Markdown tables, writes DIR/rivals.json
and DIR/rivals.md.
"""

import argparse
import dataclasses
import functools
import hashlib
import json
import math
import multiprocessing
import multiprocessing.pool
import os
import pathlib
import statistics
import sys

import own_venv

ROOT = own_venv.HERE.parents[1]
MEASURED = ("detector.kind=measured", "tracker.rule=global")


@dataclasses.dataclass(frozen=True)
class Scene:
    """A scenario of scenarios/eval, how long of it is scored [s], and whether the network looks at rendered pictures."""

    file: str
    duration_s: float
    pixels: bool = False

    def settings(self):
        """Changes of the scenario, as `--set` takes them."""
        return [*(("detector.kind=onnx", MEASURED[1]) if self.pixels else MEASURED), f"duration_s={self.duration_s:g}"]


# Each ends when what it is about is over: replays take long.
SCENES = {
    "crossing": Scene("suite_crossing", 13),
    "overtaking": Scene("suite_overtaking", 10),
    "swarm": Scene("suite_swarm", 11),
    "birds": Scene("suite_birds", 10),
    "occlusion": Scene("suite_occlusion", 12),
    "decoy": Scene("suite_decoy", 12),
    "weave": Scene("weave", 10),
    "crossing_pixels": Scene("suite_crossing", 13, pixels=True),
}
# Rendered runs take minutes: fewer of them.
MOST_PIXEL_SEEDS = 2
TUNING_SEEDS = (101, 102)
MOST_SEEDS = 20
# What is tried, one after the other; the first is the beginning.
FRONT_END = (("labels", ("all", "uav")), ("floor", (1.0, 0.5)), ("hits", (6, 3)), ("silent_s", (3.0, 1.0)))
ACCELS = (0.5, 0.1, 2.0, 5.0)
# Windows of MHT, which takes minutes: tried in few scenes.
WINDOWS = (3, 5)
FEW = ("crossing",)
# A box within this of something that flies is of it.
MATCH_PX = 8.0
TRACKERS = {
    "boresight": "Boresight",
    "boresight_all": "Boresight, all its tracks",
    "gnn": "Kalman, nearest neighbour",
    "jpda": "Stone Soup JPDA",
    "mht": "Stone Soup MHT",
    "paper_seconds": "paper, eq. 10 as printed",
    "paper_frames": "paper, eq. 10 by frames",
}
SLOW = ("jpda", "mht")
FIGURES = (
    # key, heading, factor, digits
    ("target_on_share", "target on UAV [%]", 100, 1),
    ("target_lost", "losses", 1, 1),
    ("uav_tracked_share", "UAVs tracked [%]", 100, 1),
    ("gospa_mrad", "GOSPA [mrad]", 1, 3),
    ("false_tracks_per_min", "false tracks/min", 1, 1),
    ("false_per_frame", "false/frame", 1, 2),
    ("identity_switches", "switches", 1, 1),
    ("fragmentations", "fragments", 1, 1),
    ("IDF1", "IDF1", 1, 3),
    ("HOTA", "HOTA", 1, 3),
    ("first_track_s", "first track [s]", 1, 2),
    ("localisation_rms_urad", "rms [µrad]", 1, 0),
)


def folder_of(out, scene, seed):
    """Where a run lies."""
    return out / "runs" / f"{scene}-{seed:03}"


@functools.lru_cache(maxsize=1)
def recording(folder):
    """A run, kept until another is asked for."""
    import rivals_recording

    return rivals_recording.Recording(folder)


def counted(out, scene, settings):
    """Errors of the detector by camera over the tuning seeds, of the boxes that these settings let through."""
    return _counted(out, scene, settings.labels, settings.floor)


@functools.cache
def _counted(out, scene, labels, floor):
    import rivals_stonesoup as soup

    settings, sums = soup.Settings(labels=labels, floor=floor), {}
    for seed in tuning_seeds(scene):
        run = recording(folder_of(out, scene, seed))
        for scan in run.scans:
            seen = run.in_camera.get((scan.exposure, scan.camera), [])
            boxes = soup.wanted(scan, settings)
            tally = sums.setdefault(scan.camera, {"scans": 0, "false": 0, "uavs": 0, "found": 0, "squares": []})
            tally["scans"] += 1
            tally["false"] += sum(all(math.dist(box.px, px) > MATCH_PX for _, px in seen) for box in boxes)
            for name, px in seen:
                if run.is_uav(name):
                    near = min((math.dist(box.px, px) for box in boxes), default=math.inf)
                    tally["uavs"] += 1
                    if near <= MATCH_PX:
                        tally["found"] += 1
                        tally["squares"].append(near**2)
    # Bounds keep a filter sane where a camera saw next to nothing: one in a hundred found, a false box in a thousand pictures.
    return {
        name: soup.Rates(
            noise_px=math.sqrt(0.5 * statistics.fmean(tally["squares"])) if tally["squares"] else 1.0,
            found=min(max(tally["found"] / max(tally["uavs"], 1), 0.01), 0.99),
            false=max(tally["false"] / max(tally["scans"], 1), 1e-3),
        )
        for name, tally in sums.items()
    } | {name: soup.Rates(1.0, 0.01, 1e-3) for name in run.cameras if name not in sums}


def replayed(out, scene, seed, kind, settings, rates):
    """Shown tracks and target at each tick of one tracker on one run, and further figures of it."""
    import rivals_scores as scores

    run = recording(folder_of(out, scene, seed))
    if kind.startswith("boresight"):
        shown, targets = run.own_tracks(0.5 if kind == "boresight" else 0.0)
        return run, shown, targets, {}
    if kind.startswith("paper"):
        import rivals_paper

        targets, axis_mrad = rivals_paper.pursue(kind.removeprefix("paper_"), run)
        return run, [[target] if target else [] for target in targets], targets, {"axis_rms_mrad": axis_mrad}
    import rivals_stonesoup as soup

    rows, ms = soup.replay(kind, settings, rates, run)
    shown = scores.shown_of(rows)
    return run, shown, scores.chosen(run, shown), {"ms_per_scan": ms}


def kept_at(job):
    """The file that keeps a replay's figures; another for other settings and another program."""
    out, scene, seed, kind, settings, rates, full = job
    told = [scene, seed, kind, full, settings and dataclasses.asdict(settings)]
    told += [{name: dataclasses.asdict(rate) for name, rate in (rates or {}).items()}, code()]
    key = hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:16]
    return out / "replays" / f"{scene}-{seed:03}-{kind}-{key}.json"


def figures_of(job):
    """Figures of one tracker on one run; from DIR/replays where they are there."""
    out, scene, seed, kind, settings, rates, full = job
    import rivals_scores as scores

    kept = kept_at(job)
    if kept.exists():
        return json.loads(kept.read_text())
    run, shown, targets, more = replayed(out, scene, seed, kind, settings, rates)
    figures = {"state_hash": run.state_hash, **scores.target_figures(run, targets), **scores.track_figures(run, shown), **more}
    if full:
        import score_mot

        name, folder = f"{scene}-{seed:03}", out / "mot" / kind
        scores.write_mot(folder, kind, name, run, shown)
        scored = score_mot.score(folder, kind, [name])[scene]
        figures |= {key: scored[key] for key in ("HOTA", "AssA", "IDF1", "identity_switches", "fragmentations")}
    figures = {key: float(value) if hasattr(value, "item") else value for key, value in figures.items()}
    kept.parent.mkdir(exist_ok=True)
    part = kept.with_suffix(f".{os.getpid()}")
    part.write_text(json.dumps(figures))
    part.replace(kept)
    return figures


@functools.cache
def code():
    """What a replay's figures follow from beside its run: this program's text."""
    files = sorted(own_venv.HERE.glob("rivals_*.py")) + [own_venv.HERE / "requirements-stonesoup.txt"]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def tuning_seeds(scene):
    """Seeds on which a scene's rates and settings are found; none of them is scored."""
    return TUNING_SEEDS[:1] if SCENES[scene].pixels else TUNING_SEEDS


def tune(out, scenes, pool):
    """Settings and rates of each Stone Soup tracker by scene: those of least mean GOSPA over the tuning seeds.

    What makes and ends tracks and the acceleration are chosen by scene with the nearest neighbour, whose filter all three share;
    `mht` chooses its window for all scenes, in a few of them and on the first tuning seed.
    """
    import rivals_stonesoup as soup

    tried = []

    def costs(tries):
        """Mean GOSPA by scene [mrad] of each try: a tracker, its settings by scene, and the seeds of a scene."""
        jobs = [
            (out, scene, seed, kind, settings, counted(out, scene, settings), False)
            for kind, by_scene, seeds_of in tries for scene, settings in by_scene.items() for seed in seeds_of(scene)
        ]
        figures, found = iter(pool.map(figures_of, jobs, chunksize=1)), []
        for kind, by_scene, seeds_of in tries:
            means = {scene: statistics.fmean(next(figures)["gospa_mrad"] for _ in seeds_of(scene)) for scene in by_scene}
            found.append(means)
            named = {scene: dataclasses.asdict(settings) for scene, settings in by_scene.items()}
            tried.append({"tracker": kind, "settings": named, "gospa_mrad": means})
            print(f"rivals: tuning {kind}: {statistics.fmean(means.values()):.4f} mrad", file=sys.stderr, flush=True)
        return found

    def try_all(several):
        """Takes from each of several settings by scene what the nearest neighbour does better with."""
        for by_scene, means in zip(several, costs([("gnn", by_scene, tuning_seeds) for by_scene in several])):
            for scene, reached in means.items():
                if reached < least[scene]:
                    common[scene], least[scene] = by_scene[scene], reached

    begin = soup.Settings(accel=ACCELS[0], window=WINDOWS[0], **{name: values[0] for name, values in FRONT_END})
    common = dict.fromkeys(scenes, begin)
    least = dict.fromkeys(scenes, math.inf)
    try_all([common])
    for name, (_, *others) in FRONT_END:
        try_all([{s: dataclasses.replace(one, **{name: value}) for s, one in common.items()} for value in others])
    try_all([{s: dataclasses.replace(one, accel=accel) for s, one in common.items()} for accel in ACCELS[1:]])
    few = [scene for scene in scenes if scene in FEW] or scenes[:1]
    by_window = costs([
        ("mht", {s: dataclasses.replace(common[s], window=window) for s in few}, lambda scene: tuning_seeds(scene)[:1])
        for window in WINDOWS
    ])
    window = WINDOWS[min(range(len(WINDOWS)), key=lambda i: statistics.fmean(by_window[i].values()))]
    settings = dict.fromkeys(soup.KINDS, {s: dataclasses.replace(one, window=window) for s, one in common.items()})
    chosen = {
        kind: {
            scene: {
                "settings": dataclasses.asdict(one),
                "rates": {name: dataclasses.asdict(rate) for name, rate in counted(out, scene, one).items()},
            }
            for scene, one in by_scene.items()
        }
        for kind, by_scene in settings.items()
    }
    return {"code": code(), "scenes": scenes, "seeds": {s: tuning_seeds(s) for s in scenes}, "chosen": chosen, "tried": tried}


def pooled_rows(out, scenes, seeds_by, tuned, pool, commands, ready):
    """A row for each scene and tracker: figures pooled over the seeds, and each seed's own. `seeds_by` has a scene's by
    tracker; with `ready` only replays count that are there."""
    import rivals_scores as scores
    import rivals_stonesoup as soup

    def job_of(scene, seed, kind):
        settings = rates = None
        if kind in soup.KINDS:
            mine = tuned["chosen"][kind][scene]
            settings = soup.Settings(**mine["settings"])
            rates = {name: soup.Rates(**rate) for name, rate in mine["rates"].items()}
        return out, scene, seed, kind, settings, rates, True

    # Those that take long come last, so that a run that is stopped has the others.
    jobs = []
    for kinds in ([kind for kind in TRACKERS if kind not in SLOW], SLOW):
        for seed in range(1, MOST_SEEDS + 1):
            jobs += [job_of(scene, seed, kind) for scene in scenes for kind in kinds if seed in seeds_by(scene, kind)]
    if ready:
        jobs = [job for job in jobs if kept_at(job).exists()]
    done_of = {}
    for _, scene, seed, kind, *_ in jobs:
        done_of.setdefault((scene, kind), []).append(seed)
    figures, done = [], 0
    for one in pool.imap(figures_of, jobs, chunksize=len(SLOW)):
        figures.append(one)
        done += 1
        print(f"rivals: {done} of {len(jobs)} replays", file=sys.stderr, flush=True)
    rows = []
    keys = [key for key, *_ in FIGURES] + [
        "target_wrong_share", "of_them_on_distractors_per_min", "missed_per_frame", "AssA", "axis_rms_mrad", "ms_per_scan",
    ]
    for scene in scenes:
        for kind in TRACKERS:
            mine = [f for f, job in zip(figures, jobs) if (job[1], job[3]) == (scene, kind)]
            rows.append({
                "scene": scene, "tracker": TRACKERS[kind], "seeds": done_of.get((scene, kind), []),
                **{key: scores.pooled([f.get(key) for f in mine]) for key in keys},
                "by_seed": mine, "commands": commands[scene],
            })
    if len(scenes) > 1:
        for kind in TRACKERS:
            # Every scene counts alike: a seed's figure is the mean over scenes, so the interval is over seeds.
            of_scene = [scene for scene in scenes if not SCENES[scene].pixels]
            every = sorted(set.intersection(*(set(done_of.get((scene, kind), [])) for scene in of_scene)))
            means = []
            for seed in every:
                mine = [f for f, job in zip(figures, jobs) if job[1] in of_scene and job[2] == seed and job[3] == kind]
                known = {key: [f[key] for f in mine if f.get(key) is not None] for key in keys}
                means.append({key: statistics.fmean(values) for key, values in known.items() if values})
            rows.append({
                "scene": "all but pixels", "tracker": TRACKERS[kind], "seeds": every,
                **{key: scores.pooled([f.get(key) for f in means]) for key in keys},
            })
    return rows


def cell(value, factor, digits):
    """Mean and half an interval, as text."""
    if value["mean"] is None:
        return "–"
    text = f"{factor * value['mean']:.{digits}f}"
    return text if value["half"] is None else f"{text} ± {factor * value['half']:.{digits}f}"


def table(rows):
    """Rows in Markdown."""
    head = ["scene", "tracker", "seeds", *(heading for _, heading, *_ in FIGURES)]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for row in rows:
        if not row["seeds"]:
            continue
        cells = [row["scene"].replace("_", ", "), row["tracker"], str(len(row["seeds"]))]
        cells += [cell(row[key], factor, digits) for key, _, factor, digits in FIGURES]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def axis_table(rows):
    """How far the axis of each reading of eq. 10 is from the UAV, by scene."""
    lines = ["| scene | eq. 10 as printed [mrad] | by frames [mrad] |", "|---|---|---|"]
    by = {(row["scene"], row["tracker"]): row["axis_rms_mrad"] for row in rows}
    for scene in dict.fromkeys(row["scene"] for row in rows):
        pair = [cell(by[scene, TRACKERS[f"paper_{reading}"]], 1, 1) for reading in ("seconds", "frames")]
        lines.append(f"| {scene.replace('_', ', ')} | {' | '.join(pair)} |")
    return "\n".join(lines)


def measure(args):
    """Makes what is missing, tunes, measures, prints and writes."""
    import rivals_recording

    scenes = [scene for scene in SCENES if scene in (args.only or SCENES)]
    commands = {}

    def seeds_of(scene):
        return range(1, min(args.seeds, MOST_PIXEL_SEEDS if SCENES[scene].pixels else args.seeds) + 1)

    def seeds_by(scene, kind):
        return range(1, min(len(seeds_of(scene)), args.slow_seeds or MOST_SEEDS) + 1) if kind in SLOW else seeds_of(scene)

    def made(job):
        scene, seed = job
        of = SCENES[scene]
        return rivals_recording.make(
            args.boresight, f"scenarios/eval/{of.file}.toml", seed, of.settings(), of.pixels, folder_of(args.out, scene, seed)
        )

    # Rendered runs first: they take longest.
    runs = [
        (scene, seed) for scene in sorted(scenes, key=lambda scene: not SCENES[scene].pixels)
        for seed in (*tuning_seeds(scene), *seeds_of(scene))
    ]
    with multiprocessing.pool.ThreadPool(args.jobs) as threads:
        for (scene, _), command in zip(runs, threads.map(made, runs, chunksize=1)):
            commands.setdefault(scene, []).append(command)
    with multiprocessing.get_context("fork").Pool(args.jobs) as pool:
        kept = args.out / "tuning.json"
        tuned = json.loads(kept.read_text()) if kept.exists() else {}
        if tuned.get("scenes") != scenes or tuned.get("code") != code():
            tuned = tune(args.out, scenes, pool)
            kept.write_text(json.dumps(tuned, indent=1) + "\n")
        rows = pooled_rows(args.out, scenes, seeds_by, tuned, pool, commands, args.ready)
    binary = pathlib.Path(args.boresight)
    document = {
        "packages": (own_venv.HERE / "requirements-stonesoup.txt").read_text().split(),
        "boresight_sha256": hashlib.sha256(binary.read_bytes()).hexdigest() if binary.is_file() else None,
        "tuning": {key: tuned[key] for key in ("seeds", "chosen")},
        "rows": rows,
    }
    (args.out / "rivals.json").write_text(json.dumps(document, indent=1) + "\n")
    text = f"{table(rows)}\n\n{axis_table(rows)}\n"
    (args.out / "rivals.md").write_text(text)
    print(text, end="")


def number(most):
    """A whole number from 1 to `most`."""
    def parse(text):
        value = int(text)
        if not 1 <= value <= most:
            raise argparse.ArgumentTypeError(f"not from 1 to {most}")
        return value
    return parse


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR") or own_venv.CACHE / "target")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="folder for the runs and results")
    parser.add_argument("--boresight", default=str(target / "release" / "boresight"), help="program (default %(default)s)")
    parser.add_argument("--seeds", type=number(MOST_SEEDS), default=5, help="seeds a scene from 1 on (default 5)")
    parser.add_argument("--slow-seeds", type=number(MOST_SEEDS), help="of JPDA and MHT, which take minutes a run (default: as many)")
    parser.add_argument("--ready", action="store_true", help="only tables, of the replays that are there")
    parser.add_argument("--jobs", type=number(256), default=os.cpu_count(), help="replays at a time (default: all cores)")
    parser.add_argument("--only", action="append", choices=SCENES, help="only this scene; may be repeated")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if not args.inside:
        own_venv.continue_in("stonesoup-venv", "requirements-stonesoup.txt")
    # Matrices are small, and replays run beside each other.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    args.out = args.out.resolve()
    args.out.mkdir(parents=True, exist_ok=True)
    sys.path.insert(0, str(ROOT / "tests"))
    from rivals_recording import BadInput

    try:
        measure(args)
    except (BadInput, OSError) as error:
        print(f"rivals: {error}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
