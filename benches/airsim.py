"""Pictures a second through AirSim's own client: the wide camera of `tests/data/airsim.toml`, 256 × 144 pixels, with two fields.

    source scripts/env.sh; PYTHON benches/airsim.py $CARGO_TARGET_DIR/release/boresight

PYTHON is one that has `cosysairsim` or `airsim`. Each picture is of a tick of its own, and so rendered anew.
"""

import pathlib
import statistics
import subprocess
import sys
import time

try:
    import cosysairsim as airsim
except ImportError:
    import airsim

ROOT = pathlib.Path(__file__).resolve().parent.parent
COUNT = 300
KINDS = airsim.ImageType
WANTED = {
    "Scene, raw": [airsim.ImageRequest("0", KINDS.Scene, False, False)],
    "Scene, PNG": [airsim.ImageRequest("0", KINDS.Scene)],
    "DepthPlanar": [airsim.ImageRequest("0", KINDS.DepthPlanar, True)],
    "Segmentation, raw": [airsim.ImageRequest("0", KINDS.Segmentation, False, False)],
    "Scene, DepthPlanar and Segmentation": [
        airsim.ImageRequest("0", KINDS.Scene, False, False),
        airsim.ImageRequest("0", KINDS.DepthPlanar, True),
        airsim.ImageRequest("0", KINDS.Segmentation, False, False),
    ],
}



def measure(hfov_deg):
    words = [sys.argv[1], "serve", "tests/data/airsim.toml", "--airsim", "127.0.0.1:0"]
    words += ["--set", f"station.cameras.search.hfov_deg={hfov_deg}"]
    server = subprocess.Popen(words, cwd=ROOT, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    try:
        for line in server.stderr:
            if line.startswith("airsim "):
                break
        client = airsim.MultirotorClient(port=int(line.rsplit(":", 1)[1]))
        client.simPause(True)
        client.simContinueForTime(2)
        times = []
        for _ in range(2_000):
            begun = time.perf_counter()
            client.ping()
            times.append(time.perf_counter() - begun)
        print(f"{hfov_deg} deg: ping: median {1e6 * statistics.median(times):.0f} us")
        for name, requests in WANTED.items():
            client.simGetImages(requests)
            begun = time.perf_counter()
            for _ in range(COUNT):
                client.simContinueForTime(1 / 960)
                client.simGetImages(requests)
            print(f"{hfov_deg} deg: {name}: {COUNT / (time.perf_counter() - begun):.0f} a second")
    finally:
        server.terminate()
        server.communicate(timeout=60)


# All of the city at once, and a part of it as a search camera's.
measure(60)
measure(6)
