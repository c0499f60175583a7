"""The examples run, with few views and seeds."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"


pytestmark = pytest.mark.skipif(sys.version_info < (3, 11), reason="MuJoCo 4 needs Python 3.11")


def run_example(folder, *arguments):
    """Return an example's output; it must leave no file."""
    # EGL needs no screen; other systems use their own drawing
    drawn_by = {"MUJOCO_GL": "egl"} if sys.platform == "linux" else {}
    name, *others = map(str, arguments)
    done = subprocess.run(
        [sys.executable, EXAMPLES / name, *others],
        cwd=folder,
        env={**os.environ, **drawn_by},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert list(folder.iterdir()) == []
    return done.stdout


@pytest.mark.parametrize("views", [1, 2])
def test_a_rope_in_mujoco_is_found_where_it_lies(tmp_path, views):
    found = run_example(tmp_path, "simulated_rope.py", "--shape", "overhand", "--views", views)
    rms, most = map(float, re.search(r"off by (\S+) mm \(RMS\), (\S+) mm at most", found).groups())
    assert rms < 0.4
    assert most < 1.5
    length, of = map(int, re.search(r"^(\d+) mm of (\d+) mm", found, re.MULTILINE).groups())
    assert abs(length - of) < 12


@pytest.mark.parametrize(("task", "left"), [("pick", 1), ("straighten", 0), ("untie", 0)])
def test_the_planner_does_what_it_is_asked_to(tmp_path, task, left):
    # how many crossings the simulated rope has then; 20 ropes of each are tried by a bench
    assert run_example(tmp_path, "planner.py", task, "--seed", 6) == f"done: {left} crossings are left\n"


def test_a_gripper_finds_a_place_of_a_rope_that_moves(tmp_path):
    found = run_example(tmp_path, "tracking.py", "pick", "--seed", 4)
    wanted, *ends = map(int, re.search(r"^done: wanted (\d+) mm, is at (\d+) or (\d+) mm", found).groups())
    # either end of the rope may be the tracker's first one
    assert min(abs(wanted - end) for end in ends) <= 15


def test_the_planner_is_short():
    assert len((EXAMPLES / "planner.py").read_text().splitlines()) < 120
