"""A program may end while daemon threads are in calls of strand: nothing aborts."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

PROGRAMS = 16  # each aborted about one time in three when Python's end cut a call of NumPy off
CODE = """
import sys, threading, time
sys.path[:0] = {path!r}
import numpy as np
import strand._core as _core

CALLS = (
    # converted by NumPy, in part by its code in Python
    lambda: _core.count_neighbors(thin, 0.01),
    lambda: _core.count_neighbors(rows, 0.01),
    # an error with the text of a type, which Python makes
    lambda: _core.count_neighbors(whole, 0.01),
    # a kernel without the GIL
    lambda: _core.radius_outlier_mask(many, 0.1, 3),
)
many = np.random.default_rng(0).normal(size=(3000, 6))
thin, rows, whole = many[:20, ::2].astype(np.float32), many[:20, :3].tolist(), np.ones((20, 3), int)
many = many[:, ::2]

def call_on(call):
    while True:
        for _ in range(100):
            try:
                call()
            except TypeError:
                pass

sys.setswitchinterval(1e-6)
for number in range(20):
    threading.Thread(target=call_on, args=(CALLS[number % len(CALLS)],), daemon=True).start()
end = time.perf_counter() + 0.05
while time.perf_counter() < end:
    pass
"""


def run_program(_: int) -> tuple[int, str]:
    code = CODE.format(path=sys.path)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    return done.returncode, done.stderr


def test_programs_end_in_peace_while_daemon_threads_call():
    with ThreadPoolExecutor(2) as pool:
        assert set(pool.map(run_program, range(PROGRAMS))) == {(0, "")}
