"""The examples run as they stand, small."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.mark.skipif(sys.version_info < (3, 11), reason="MuJoCo 4 needs Python 3.11")
@pytest.mark.parametrize("views", [1, 2])
def test_a_rope_in_mujoco_is_found_where_it_lies(tmp_path, views):
    # without a screen; elsewhere MuJoCo draws by what the system has
    drawn_by = {"MUJOCO_GL": "egl"} if sys.platform == "linux" else {}
    done = subprocess.run(
        [sys.executable, EXAMPLES / "simulated_rope.py", "--shape", "overhand", "--views", str(views)],
        cwd=tmp_path,
        env={**os.environ, **drawn_by},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    rms, most = map(float, re.search(r"off by (\S+) mm \(RMS\), (\S+) mm at most", done.stdout).groups())
    assert rms < 0.4
    assert most < 1.5
    length, of = map(int, re.search(r"^(\d+) mm of (\d+) mm", done.stdout, re.MULTILINE).groups())
    assert abs(length - of) < 12
    assert list(tmp_path.iterdir()) == []
