"""Scores the MOTChallenge files of `boresight eval tracking` with TrackEval.

    pip install -r tests/requirements-mot.txt
    python tests/score_mot.py OUT

OUT is the folder given to `boresight eval tracking --out`. Writes OUT/mot_scores.json and prints a
table: HOTA, DetA and AssA (mean over thresholds), IDF1, MOTA and identity switches, for each set
(`all`, `lock`), rule and scenario, over all its seeds. Fractions are between 0 and 1.
"""

import contextlib
import io
import json
import sys
import warnings
from pathlib import Path

import numpy as np

# Plotting, which is not wanted here, warns on import in some versions.
warnings.filterwarnings("ignore")
import trackeval  # noqa: E402


def score(folder: Path, rule: str, sequences: list[str]) -> dict[str, dict]:
    """Scores of one rule below `folder` (a set's folder of the rule), by scenario and over all."""
    config = {
        "PRINT_RESULTS": False,
        "PRINT_CONFIG": False,
        "TIME_PROGRESS": False,
        "OUTPUT_SUMMARY": False,
        "OUTPUT_DETAILED": False,
        "PLOT_CURVES": False,
        "LOG_ON_ERROR": None,
    }
    dataset = trackeval.datasets.MotChallenge2DBox(
        {
            "GT_FOLDER": str(folder / "gt"),
            "TRACKERS_FOLDER": str(folder / "trackers"),
            "TRACKERS_TO_EVAL": [rule],
            "SEQ_INFO": dict.fromkeys(sequences),
            "SKIP_SPLIT_FOL": True,
            "BENCHMARK": "boresight",
            "DO_PREPROC": False,
            "PRINT_CONFIG": False,
        }
    )
    metrics = {
        "HOTA": trackeval.metrics.HOTA(),
        "CLEAR": trackeval.metrics.CLEAR({"PRINT_CONFIG": False}),
        "Identity": trackeval.metrics.Identity({"PRINT_CONFIG": False}),
    }
    # TrackEval talks about its progress.
    with contextlib.redirect_stdout(io.StringIO()):
        results, _ = trackeval.Evaluator(config).evaluate([dataset], list(metrics.values()))
    by_sequence = results["MotChallenge2DBox"][rule]
    groups: dict[str, list[str]] = {}
    for name in sequences:
        groups.setdefault(name.rsplit("-", 1)[0], []).append(name)
    groups["all scenarios"] = sequences
    scores = {}
    for scenario, names in groups.items():
        combined = {
            key: metric.combine_sequences({n: by_sequence[n]["pedestrian"][key] for n in names})
            for key, metric in metrics.items()
        }
        hota, clear, identity = combined["HOTA"], combined["CLEAR"], combined["Identity"]
        scores[scenario] = {
            "sequences": len(names),
            "frames": int(clear["CLR_Frames"]),
            "HOTA": float(np.mean(hota["HOTA"])),
            "DetA": float(np.mean(hota["DetA"])),
            "AssA": float(np.mean(hota["AssA"])),
            "LocA": float(np.mean(hota["LocA"])),
            "IDF1": float(identity["IDF1"]),
            "MOTA": float(clear["MOTA"]),
            "identity_switches": int(clear["IDSW"]),
            "misses": int(clear["CLR_FN"]),
            "false_positives": int(clear["CLR_FP"]),
            "fragmentations": int(clear["Frag"]),
        }
    return scores


def main() -> int:
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    out = Path(sys.argv[1])
    rows = []
    for folder in sorted(out.glob("mot/*/*")):
        which, rule = folder.parts[-2:]
        sequences = sorted(path.name for path in (folder / "gt").iterdir())
        for scenario, scores in score(folder, rule, sequences).items():
            rows.append({"set": which, "rule": rule, "scenario": scenario, **scores})
    if not rows:
        print(f"{out}: no folder mot/ with sequences; run `boresight eval tracking --out {out}`", file=sys.stderr)
        return 2
    document = {"scorer": "trackeval", "version": trackeval_version(), "rows": rows}
    (out / "mot_scores.json").write_text(json.dumps(document, indent=2) + "\n")
    print(f"{'set':<5} {'rule':<7} {'scenario':<14} {'HOTA':>6} {'DetA':>6} {'AssA':>6} {'IDF1':>6} {'IDSW':>5}")
    for row in rows:
        print(
            f"{row['set']:<5} {row['rule']:<7} {row['scenario']:<14} {row['HOTA']:>6.3f} {row['DetA']:>6.3f}"
            f" {row['AssA']:>6.3f} {row['IDF1']:>6.3f} {row['identity_switches']:>5}"
        )
    return 0


def trackeval_version() -> str:
    from importlib.metadata import version

    return version("trackeval")


if __name__ == "__main__":
    sys.exit(main())
