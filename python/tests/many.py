"""Many runs with pictures in one process: those that are finished, and those that are open at once.

    python python/tests/many.py --finished 70 --open 70

Prints as JSON the memory of the process [MB] after the first run, after each further ten, and the seconds of each part.
Stops with what it has where the machine has less than 2 GB left. Of the runs that are open each is stepped once more at the end.
"""

import argparse
import json
import time
from pathlib import Path

import boresight

LEFT_MB = 2000


def proc_mb(file: str, name: str) -> int:
    """A line of a file of Linux's `/proc` [MB]."""
    for line in Path("/proc", file).read_text().splitlines():
        if line.startswith(name + ":"):
            return int(line.split()[1]) // 1024
    raise ValueError(f"/proc/{file} has no {name}")


def opened(scenario: str, seed: int) -> boresight.Simulation:
    run = boresight.Simulation(scenario, seed=seed, pictures=True, detector__kind="truth")
    run.step(20)
    return run


def measured(count: int, finished: bool, scenario: str) -> dict[str, object]:
    began_s, kept, memory_mb = time.perf_counter(), [], []
    for seed in range(count):
        if proc_mb("meminfo", "MemAvailable") < LEFT_MB:
            break
        run = opened(scenario, seed)
        if finished:
            run.finish()
        # A finished run is kept, too: what it took must be given back all the same.
        kept.append(run)
        if seed == 0 or seed == count - 1 or seed % 10 == 9:
            memory_mb.append(proc_mb("self/status", "VmRSS"))
    hashes = set()
    for run in [] if finished else kept:
        run.step(3)
        hashes.add(run.state_hash)
    return {
        "runs": len(kept),
        "different": len(hashes),
        "memory_mb": memory_mb,
        "seconds": round(time.perf_counter() - began_s, 1),
    }


if __name__ == "__main__":
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--finished", type=int, default=70)
    arguments.add_argument("--open", type=int, default=70)
    arguments.add_argument("--scenario", default="scenarios/urban_intercept.toml")
    told = arguments.parse_args()
    print(
        json.dumps(
            {
                "finished": measured(told.finished, True, told.scenario),
                "open": measured(told.open, False, told.scenario),
            }
        )
    )
