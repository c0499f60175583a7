"""Ctrl-C: every kernel lets go of the caller at once, and works on afterwards."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

# What is interrupted: as long as a kernel takes on points that are all neighbours, or on many that are not.
CALLS = {
    "radius_outlier_mask": "strand.radius_outlier_mask(crowd, 1.0, 3)",
    "count_neighbors": "strand.count_neighbors(crowd, 1.0)",
    "count_neighbors_each": "_core.count_neighbors_each([crowd, crowd], 1.0)",
    "normals by k": "strand.estimate_normals(many, k=200)",
    "normals by radius": "strand.estimate_normals(crowd, radius=1.0)",
    "icp": "strand.icp(many, moved, 0.05, max_iterations=10**6, tolerance=0)",
    "centerline": "strand.centerline(many, up, 0.3, 3)",
    "trace_chains": "strand.trace_chains(many, 0.001, 1.0)",
    "trace_tubes": "strand.trace_tubes(many, (0.0, 0.0, 9.0), 0.3)",
    "count_typical_neighbors": "[_core.count_typical_neighbors(crowd, 1.0) for _ in range(10**6)]",
    "find_overlaps": "_core.find_overlaps(crowd, number, arc, 0.0, 0.0)",
    "occludes": "_core.occludes(away, crowd, (0.0, 0.0, -9.0), 0.0)",
    "register_in_turn": "_core.register_in_turn([many, moved], 0.05, 10**6, 0.0)",
    "find_short_outlines": "_core.find_short_outlines(noise, [1.0], 10**5)",
    "nearest": "rope.nearest(crowd)",
    "swept_spheres": "rope.swept_spheres(crowd[:15_000], crowd[1:15_001], 0.002)",
}

CODE = """
import json, os, signal, sys, threading, time
sys.path[:0] = {path!r}
import numpy as np
import strand
import strand._core as _core

rng = np.random.default_rng(0)
crowd, many = rng.uniform(size=(60_000, 3)), rng.uniform(size=(300_000, 3))
number, arc = np.zeros(60_000, np.int64), np.zeros(60_000)
noise = rng.normal(size=(900, 900)).astype(np.float32)
moved, away, up = many + 0.01, crowd + 99.0, many * 0.0 + (0.0, 0.0, 1.0)
small = crowd[:500]
rope = _core.TubeQueries([many[:20_000]], [np.arange(2e4)], [1e-4])
expected = strand.count_neighbors(small, 0.2)


def interrupted(call):
    # seconds from when the signal is due to the exception; None if the call ended before
    ended = threading.Event()

    def interrupt():
        # a call that keeps the interpreter locked delays this
        if not ended.wait(0.1):
            os.kill(os.getpid(), signal.SIGINT)

    interrupting = threading.Thread(target=interrupt)
    due = time.perf_counter() + 0.1
    interrupting.start()
    late = None
    try:
        eval("lambda: " + call)()
        ended.set()
        interrupting.join()
    except KeyboardInterrupt:
        late = time.perf_counter() - due
    return late


late = {{}}
for kernel, call in {calls!r}.items():
    late[kernel] = interrupted(call)
    assert (strand.count_neighbors(small, 0.2) == expected).all()
print(json.dumps(late))
"""


def run_python(code, threads):
    environment = os.environ | {"STRAND_NUM_THREADS": threads}
    command = [sys.executable, "-c", code]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)


@pytest.mark.parametrize("threads", ["1", "2"])
def test_ctrl_c_leaves_every_kernel_at_once(threads):
    code = CODE.format(path=sys.path, calls=CALLS)
    done = run_python(code, threads)
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    late = json.loads(done.stdout)
    assert late.keys() == CALLS.keys()
    assert not [kernel for kernel, seconds in late.items() if seconds is None], "were not interrupted"
    # 0.2 s are promised on a machine that does nothing else
    assert max(late.values()) < 1.0, late


ALARM = """
import signal, sys
sys.path[:0] = {path!r}
import numpy as np
import strand


def ring(*_):
    # a handler may use strand too
    assert (strand.count_neighbors(few, 1.0) == known).all()
    raise TimeoutError


signal.signal(signal.SIGALRM, ring)
points = np.random.default_rng(0).uniform(size=(60_000, 3))
few = points[:9000]
known = strand.count_neighbors(few, 1.0)
signal.setitimer(signal.ITIMER_REAL, 0.1)
try:
    strand.count_neighbors(points, 1.0)
    raise SystemExit("was not interrupted")
except TimeoutError:
    pass
assert (strand.count_neighbors(few, 1.0) == known).all()
"""


@pytest.mark.parametrize("threads", ["1", "2"])
def test_what_another_signals_handler_raises_leaves_too(threads):
    code = ALARM.format(path=sys.path)
    done = run_python(code, threads)
    assert done.returncode == 0, done.stderr
