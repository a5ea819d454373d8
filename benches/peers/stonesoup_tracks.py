#!/usr/bin/env python3
"""Replays the detections of the suite's runs through Stone Soup's trackers and scores them beside Boresight's.

    python benches/peers/stonesoup_tracks.py --out DIR                  five seeds of each scene
    python benches/peers/stonesoup_tracks.py --out DIR --only swarm     one scene; may be repeated

Makes a venv of its own, then what DIR lacks: Boresight's own tracks and the truth
(`boresight eval tracking --only suite`, DIR/eval, all 20 seeds) and the recordings of the same runs
(`boresight run`, DIR/runs). Prints a Markdown table and writes DIR/stonesoup_tracks.json.
"""

import argparse
import hashlib
import json
import os
import pathlib
import subprocess
import sys
import tomllib

import own_venv

ROOT = own_venv.HERE.parents[1]
# The suite of `boresight eval tracking`, and those of its scenes in which something else flies.
SCENES = ("crossing", "overtaking", "swarm", "birds", "occlusion", "decoy")
WITH_DISTRACTORS = ("birds", "decoy")
SEEDS = 20
TRACKERS = {"global": "Boresight", "gnn": "Stone Soup GNN", "jpda": "Stone Soup JPDA"}
COARSE_PERIOD_TICKS = 16  # 60 Hz of 960
LEAST_SIDE_PX = 8.0  # of a scored box


def detector_of(scene):
    """Stated errors of the scene's truth detector; the script knows no other detector."""
    from stonesoup_replay import BadInput

    path = ROOT / "scenarios" / "eval" / f"suite_{scene}.toml"
    scenario = tomllib.loads(path.read_text())
    detector = scenario.get("detector", {})
    if detector.get("kind") != "truth" or scenario["station"]["cameras"]["preset"] != "urban_1km":
        raise BadInput(f"{path}: wants the truth detector and the cameras urban_1km")
    errors = detector["truth"]
    return {
        "noise_px": errors["noise_px"],
        "miss_rate": errors["miss_rate"],
        "false_alarms": errors["false_alarms_per_frame"],
    }


def make(boresight, arguments, wanted):
    """Has Boresight make the file `wanted`, unless it is there; returns the command."""
    from stonesoup_replay import BadInput

    command = ["boresight", *map(str, arguments)]
    if not wanted.exists():
        print(f"peers: {' '.join(command)}", file=sys.stderr, flush=True)
        try:
            done = subprocess.run([boresight, *command[1:]], cwd=ROOT, stdout=subprocess.DEVNULL)
        except OSError as error:
            raise BadInput(f"{boresight}: {error.strerror}; name the program with --boresight") from error
        if done.returncode or not wanted.exists():
            raise BadInput(f"`{' '.join(command)}` failed and left no {wanted}")
    return " ".join(command)


def rows_of(path, frames):
    """(identity, x, y) of the centres in a MOTChallenge file, by frame."""
    by_frame = [[] for _ in range(frames)]
    for line in path.read_text().splitlines():
        frame, identity, left, top, width, height = (float(value) for value in line.split(",")[:6])
        by_frame[int(frame) - 1].append((int(identity), left + 0.5 * width, top + 0.5 * height))
    return by_frame


def write_rows(path, by_frame):
    """Writes centres as MOTChallenge boxes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    half = 0.5 * LEAST_SIDE_PX
    path.write_text("".join(
        f"{index + 1},{identity},{x - half:.3f},{y - half:.3f},{LEAST_SIDE_PX},{LEAST_SIDE_PX},1,1,1\n"
        for index, rows in enumerate(by_frame) for identity, x, y in rows
    ))


def measure_scene(scene, args):
    """Rows of the result for one scene."""
    import score_mot
    import stonesoup_replay as soup

    detector = detector_of(scene)
    own = args.out / "eval" / "mot" / "all" / "global"
    sets = ["all", "without distractors"] if scene in WITH_DISTRACTORS else ["all"]
    tallies = {(which, rule): soup.Tally() for which in sets for rule in TRACKERS}
    commands, names = [], []
    for seed in range(1, args.seeds + 1):
        name = f"{scene}-{seed:02}"
        names.append(name)
        folder = args.out / "runs" / name
        scenario = f"scenarios/eval/suite_{scene}.toml"
        commands.append(make(
            args.boresight,
            ["run", scenario, "--seed", seed, "--no-capture", "--set", "tracker.rule=global", "--out", folder],
            folder / "run.mcap",
        ))
        recording = soup.Recording(folder / "run.mcap")
        ticks = recording.snapshots(COARSE_PERIOD_TICKS)
        info = (own / "gt" / name / "seqinfo.ini").read_text()
        same = (recording.scenario, recording.seed) == (f"suite_{scene}", seed) and f"seqLength={len(ticks)}\n" in info
        if not same:
            raise soup.BadInput(f"{folder}: not the run that {args.out / 'eval'} scored; remove both")
        truth = rows_of(own / "gt" / name / "gt" / "gt.txt", len(ticks))
        shown = {"global": rows_of(own / "trackers" / "global" / "data" / f"{name}.txt", len(ticks))}
        for kind in ("gnn", "jpda"):
            print(f"peers: {name}, {kind}", file=sys.stderr, flush=True)
            shown[kind] = soup.replay(kind, args.accel, recording, ticks, detector)
        for (which, rule), tally in tallies.items():
            tracks = shown[rule]
            if which != "all":
                tracks = soup.on_distractors(recording, ticks, truth, tracks)
            tally.add(truth, tracks)
            mot = args.out / "mot" / which.replace(" ", "_") / rule
            gt = mot / "gt" / name
            write_rows(gt / "gt" / "gt.txt", truth)
            (gt / "seqinfo.ini").write_text(info)
            write_rows(mot / "trackers" / rule / "data" / f"{name}.txt", tracks)
    rows = []
    for (which, rule), tally in tallies.items():
        mot = args.out / "mot" / which.replace(" ", "_") / rule
        scored = score_mot.score(mot, rule, names)[scene]
        identity = {key: scored[key] for key in ("HOTA", "AssA", "IDF1", "identity_switches")}
        rows.append({
            "scene": scene, "detector": "truth", "set": which, "tracker": TRACKERS[rule], "seeds": args.seeds,
            **tally.figures(), **identity, "commands": commands,
        })
    return rows


def table(rows):
    """The rows in Markdown."""
    head = ("scene (detector)", "tracker", "GOSPA [mrad]", "localisation rms [µrad]", "missed / frame",
            "false / frame", "IDF1", "switches", "one identity", "HOTA")
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for row in rows:
        scene = row["scene"] + ("" if row["set"] == "all" else ", distractors' tracks not counted")
        rms = row["localisation_rms_urad"]
        cells = (
            f"{scene} (truth)", row["tracker"], f"{row['gospa_mrad']:.3f}", "–" if rms is None else f"{rms:.1f}",
            f"{row['missed_per_frame']:.3f}", f"{row['false_per_frame']:.3f}", f"{row['IDF1']:.3f}",
            str(row["identity_switches"]), f"{row['one_identity_share']:.3f}", f"{row['HOTA']:.3f}",
        )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def measure(args):
    """Makes what is missing, measures, prints and writes."""
    import stonesoup_replay as soup

    evaluated = make(
        args.boresight, ["eval", "tracking", "--only", "suite", "--out", args.out / "eval"],
        args.out / "eval" / "tracking.json",
    )
    rows = [row for scene in SCENES if scene in (args.only or SCENES) for row in measure_scene(scene, args)]
    binary = pathlib.Path(args.boresight)
    document = {
        "packages": (own_venv.HERE / "requirements-stonesoup.txt").read_text().split(),
        "boresight_sha256": hashlib.sha256(binary.read_bytes()).hexdigest() if binary.is_file() else None,
        "eval_command": evaluated,
        "gospa": {"order": soup.ORDER, "cutoff_mrad": soup.CUTOFF_MRAD, "alpha": 2},
        "stone_soup": {
            "singer_accel_mradps2": args.accel,
            "singer_tau_s": soup.ACCEL_TAU_S,
            "initial_rate_mradps": soup.RATE_MRADPS,
            "gate_nis": soup.GATE_NIS,
            "hits_to_confirm": soup.CONFIRMED_HITS,
            "fresh_s": soup.FRESH_S,
            "deleted_after_s": soup.SILENT_S,
        },
        "rows": rows,
    }
    (args.out / "stonesoup_tracks.json").write_text(json.dumps(document, indent=2) + "\n")
    print(table(rows))


def positive(text):
    """A number above zero."""
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError("not a positive number")
    return value


def seeds(text):
    """As many seeds as `eval tracking` has, or fewer."""
    value = int(text)
    if not 1 <= value <= SEEDS:
        raise argparse.ArgumentTypeError(f"not from 1 to {SEEDS}")
    return value


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR") or own_venv.CACHE / "target")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="folder for the runs and results")
    parser.add_argument("--boresight", default=str(target / "release" / "boresight"),
                        help="program (default %(default)s)")
    parser.add_argument("--seeds", type=seeds, default=5, help="seeds a scene, 1 to 20 (default 5)")
    parser.add_argument("--accel", type=positive, default=2.0,
                        help="rms acceleration that Stone Soup's filter assumes [mrad/s²; m/s² at 1 km] (default 2)")
    parser.add_argument("--only", action="append", choices=SCENES, help="only this scene; may be repeated")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if not args.inside:
        own_venv.continue_in("stonesoup-venv", "requirements-stonesoup.txt")
    args.out = args.out.resolve()
    sys.path.insert(0, str(ROOT / "tests"))
    from stonesoup_replay import BadInput

    try:
        measure(args)
    except (BadInput, OSError) as error:
        print(f"stonesoup_tracks: {error}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
