"""Round trips to `boresight serve` from Python: medians over 10,000, on loopback TCP and a Unix socket.

    source scripts/env.sh; python3 benches/lockstep.py $CARGO_TARGET_DIR/release/boresight
"""

import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "python" / "boresight"))

from client import Run  # noqa: E402

COUNT = 10_000
SCENARIO = ["serve", "scenarios/urban_intercept.toml", "--set", "detector.kind=truth", "--set", "duration_s=120"]
SCENARIO += ["--set", "engage.authorised=false"]


def times_us(what):
    times = []
    for _ in range(COUNT):
        begun = time.perf_counter_ns()
        what()
        times.append((time.perf_counter_ns() - begun) / 1e3)
    quantiles = statistics.quantiles(times, n=100)
    return statistics.median(times), quantiles[98]


def measure(program, options):
    child = subprocess.Popen([program, *SCENARIO, *options], cwd=ROOT, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL)
    at = child.stderr.readline().decode().strip().removeprefix("serve  ")
    with Run(at) as run:
        run.step(1000)
        for name, what in [("ping", run.ping), ("step(0)", lambda: run.step(0)), ("step(1)", run.step), ("state", run.state)]:
            median, high = times_us(what)
            print(f"{at.split('/')[0] or 'unix'}: {name}: median {median:.1f} us, 99 % below {high:.1f} us")
        # Ticks at one go: what is left of step(1) is the round trip, and caches that others have used meanwhile.
        begun = time.perf_counter()
        run.step(COUNT)
        print(f"  a tick alone: {(time.perf_counter() - begun) / COUNT * 1e6:.1f} us")
        run.finish()
    child.wait()


with tempfile.TemporaryDirectory() as folder:
    measure(sys.argv[1], ["--listen", "127.0.0.1:0"])
    measure(sys.argv[1], ["--unix", f"{folder}/socket"])
