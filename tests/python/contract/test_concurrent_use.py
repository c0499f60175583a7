"""Threads that share views and a model at the same time get the bits of one thread."""

from __future__ import annotations

import subprocess
import sys
import sysconfig
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import strand
from strand import count_neighbors, estimate_normals

THREADS = 8
POINTS = np.random.default_rng(0).uniform(-0.1, 0.1, (40, 3))
ASKED = {
    "arc_length": lambda model: [chain.arc_length for chain in model.chains],
    "tangents": lambda model: [chain.tangents for chain in model.chains],
    "curvature": lambda model: [chain.curvature for chain in model.chains],
    "bends": lambda model: [chain.min_bend_radius() for chain in model.chains],
    "frames": lambda model: [chain.frames_at(chain.arc_length) for chain in model.chains],
    "distances": lambda model: model.signed_distance(POINTS),
    "crossings": lambda model: repr(model.crossings()),
    "contacts": lambda model: repr(model.contacts(0.01)),
    "knots": lambda model: [repr(chain.knot()) for chain in model.chains],
    "pulls": lambda model: repr(model.pull_plan()),
    "saved": lambda model: (repr(model.warnings), model.confidence, repr(model.doubts)),
}


@pytest.fixture(scope="module")
def made():
    return strand.synthetic.scene(
        "overhand", views=2, camera=strand.synthetic.Camera(size=(160, 120)), seed=3
    )


@pytest.fixture
def often_switched():
    """Let threads take turns as often as possible, if there is a lock."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def get_bits(value):
    """Return a value's bits."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, (list, tuple)):
        return [get_bits(each) for each in value]
    return value if isinstance(value, (str, float, int, bool)) else repr(value)


def solve(made, views=None):
    return strand.reconstruct(made.views if views is None else views, made.radius, made.bounds, ropes=1)


def collect_bits(model):
    return get_bits([*(chain.points for chain in model.chains), model.poses, model.pose_sd, model.confidence])


def run_at_once(work):
    """Return each thread's result; all start together."""
    start = threading.Barrier(THREADS)

    def go(number):
        start.wait(timeout=60)
        return work(number)

    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(go, range(THREADS), timeout=240))


@pytest.mark.usefixtures("often_switched")
def test_views_that_threads_share_give_the_same_model(made):
    expected = collect_bits(solve(made))
    views = made.views
    assert run_at_once(lambda _: collect_bits(solve(made, views))) == [expected] * THREADS


@pytest.mark.usefixtures("often_switched")
def test_a_model_that_threads_share_gives_the_same_answers(made):
    alone = solve(made)
    expected = {name: get_bits(ask(alone)) for name, ask in ASKED.items()}
    names = list(ASKED)

    def answers(model, number):
        """Ask all, each second thread from another question on: two threads ask the same at once."""
        turned = names[number // 2 :] + names[: number // 2]
        return {name: get_bits(ASKED[name](model)) for name in turned}

    for _ in range(3):
        model = solve(made)
        for found in run_at_once(lambda number, model=model: answers(model, number)):
            assert found == expected


@pytest.mark.usefixtures("often_switched")
def test_kernels_give_the_same_while_the_number_of_threads_changes(threads):
    points = np.random.default_rng(1).uniform(size=(3000, 3))
    kernels = [lambda: count_neighbors(points, 0.1), lambda: estimate_normals(points, k=8)]
    expected = [get_bits(kernel()) for kernel in kernels]

    def work(number):
        for count in range(1, 6):
            if number == 0:
                threads(count)
            for kernel, wanted in zip(kernels, expected, strict=True):
                assert get_bits(kernel()) == wanted
        return True

    assert all(run_at_once(work))


def test_an_interpreter_without_a_lock_stays_so():
    code = f"import sys; sys.path[:0] = {sys.path!r}\nimport strand\n"
    code += "print(getattr(sys, '_is_gil_enabled', lambda: True)())"
    command = [sys.executable, "-W", "error::RuntimeWarning", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    locked = not sysconfig.get_config_var("Py_GIL_DISABLED")
    assert done.stdout == f"{locked}\n", done.stderr
