"""Too little memory: a MemoryError, and the process lives, as far as that is promised."""

from __future__ import annotations

import subprocess
import sys

import pytest

CODE = """
import resource, sys
sys.path[:0] = {path!r}
import numpy as np
import strand

strand.set_num_threads(1)
points = np.random.default_rng(0).uniform(size=({count}, 3))
# each point is a chain of its own: as many arrays as points
ask = lambda points: strand.trace_chains(points, 1e-9, 2e-9)
ask(points[:1000])
with open("/proc/self/status") as status:
    used = next(int(line.split()[1]) * 1024 for line in status if line.startswith("VmSize"))
resource.setrlimit(resource.RLIMIT_AS, (used + {room}, used + {room}))
kept = []
try:
    # one answer may fit into memory that the process has already; all of them do not
    for _ in range({calls}):
        kept.append(ask(points))
    print("held", len(kept))
except MemoryError as error:
    kept.clear()
    print("MemoryError", error)
"""


@pytest.mark.parametrize("megabytes", [1, 2, 4, 8])
def test_more_arrays_than_memory_holds_raise_memory_error(megabytes):
    # at some rooms the small copy of the points is what fails: then a little more room is tried
    for more in range(20):
        room = (megabytes << 20) + (more << 14)
        code = CODE.format(path=sys.path, count=1000, calls=500, room=room)
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith("MemoryError")
        if "no memory for" not in done.stdout:
            break
    assert "no memory for" not in done.stdout


def test_a_copy_of_the_points_that_memory_does_not_hold_raises_memory_error():
    code = CODE.format(path=sys.path, count=4_000_000, calls=1, room=20 << 20)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("MemoryError points: no memory for")
