"""Ticks a second from Python, as `cargo bench -- "front door"` measures them in Rust.

    pip install ./python; python3 benches/doors.py
"""

import os
import pathlib
import statistics
import time

import boresight

TICKS = 960
RUNS = 10

os.chdir(pathlib.Path(__file__).resolve().parent.parent)


def seconds(ticks):
    """Time that a second of the run takes in steps of so many ticks [s]."""
    run = boresight.Simulation("scenarios/urban_intercept.toml", detector__kind="truth", engage__authorised=False)
    run.step(TICKS // 2)
    begun = time.perf_counter()
    for _ in range(TICKS // ticks):
        run.step(ticks)
    return time.perf_counter() - begun


for ticks in (1, 20, TICKS):
    median = statistics.median(seconds(ticks) for _ in range(RUNS))
    print(f"step({ticks}): {TICKS / median:,.0f} ticks a second")
