"""The tutorial can be followed: its blocks run one after the other, in an empty folder."""

import os
import re
from pathlib import Path

import pytest


def test_the_tutorial_can_be_followed(tmp_path, capsys):
    pytest.importorskip("pandas")
    blocks = re.findall(r"```python\n(.*?)```", Path("docs/tutorial-python.md").read_text(), re.DOTALL)
    assert len(blocks) == 7
    os.chdir(tmp_path)
    names = {}
    said = []
    for block in blocks:
        exec(block, names)
        said.append(capsys.readouterr().out)
    # What it says of what is wrong is so; lines are printed where it promises them.
    assert "formation" in said[2] and "heap" in said[2]
    assert "energy_j" not in said[3] and said[3].count("\n") >= 5
    for file in ["out/demo/report.html", "out/mine/sweep.html"]:
        assert Path(file).exists(), file
    assert re.search(r"\(\d+, \d+, 3\)", said[6])
