"""Runs with pictures, one after another and at once, in a process of their own."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

#: What a run of `urban_intercept` with pictures takes while it is open [MB], by the same script: some 400.
ONE_RUN_MB = 400


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads memory as Linux tells it")
def test_a_finished_run_gives_its_memory_back_and_several_are_open_at_once():
    words = [sys.executable, str(Path(__file__).with_name("many.py")), "--finished", "5", "--open", "3"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    told = json.loads(done.stdout.splitlines()[-1])
    first_mb, last_mb = told["finished"]["memory_mb"]
    assert told["finished"]["runs"] == 5
    # Four more would take 1,600 MB if they kept it.
    assert last_mb - first_mb < ONE_RUN_MB
    assert (told["open"]["runs"], told["open"]["different"]) == (3, 3)
