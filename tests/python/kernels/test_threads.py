"""Threads and processes: the same answers for any number of them."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import strand
import strand._core as _core
from shared.kernel_calls import ARRAYS, CALLS, CLOUDS, assert_same, call_kernel, list_arrays, make_lattice
from strand import count_neighbors


def test_the_number_of_threads(threads):
    assert strand.num_threads() >= 1
    threads(3)
    assert strand.num_threads() == 3
    threads(2**40)
    assert strand.num_threads() == 256
    threads(0)
    assert strand.num_threads() >= 1


@pytest.mark.parametrize("kernel", CALLS)
def test_answers_do_not_depend_on_the_number_of_threads(kernel, threads):
    big = {
        name: np.tile(array, (40, 1)) + np.random.default_rng(2).normal(0, 1e-3, (40 * len(array), 3))
        if (kernel, name) in CLOUDS and "normals" not in name
        else np.tile(array, (40, 1))
        if (kernel, name) in CLOUDS
        else array
        for name, array in ARRAYS[kernel].items()
    }
    threads(1)
    expected = call_kernel(kernel, **big)
    for count in (2, 3, 7):
        threads(count)
        assert_same(call_kernel(kernel, **big), expected)


def test_changing_the_number_of_threads_often_does_not_pile_up_threads(threads):
    def running():
        with open("/proc/self/status") as status:
            return next(int(line.split()[1]) for line in status if line.startswith("Threads:"))

    for count in (1, 2):
        threads(count)
        count_neighbors(make_lattice(), 0.5)
    before = running()
    for count in (1, 2) * 20 + (*range(3, 120, 13), 2):
        threads(count)
        count_neighbors(make_lattice(), 0.5)
    # threads whose pool is no longer wanted end by themselves
    until = time.monotonic() + 10.0
    while running() > before and time.monotonic() < until:
        time.sleep(0.01)
    assert running() <= before


def python(code, **variables):
    """What a Python of its own prints."""
    path = f"import sys; sys.path[:0] = {sys.path!r}\n"
    environment = {**os.environ, **variables}
    return subprocess.run(
        [sys.executable, "-c", path + code], capture_output=True, text=True, env=environment, timeout=60
    )


@pytest.mark.parametrize(("said", "threads"), [("3", 3), (" 2 ", 2), ("100000", 256)])
def test_the_environment_says_how_many_threads(said, threads):
    done = python("import strand; print(strand.num_threads())", STRAND_NUM_THREADS=said)
    assert done.stdout == f"{threads}\n", done.stderr


@pytest.mark.parametrize("said", ["0", ""])
def test_the_environment_may_leave_the_number_of_threads_open(said):
    code = "import os, strand; print(strand.num_threads() == len(os.sched_getaffinity(0)))"
    assert python(code, STRAND_NUM_THREADS=said).stdout == "True\n"


CORES = """
import os, strand
strand.num_threads()
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
child = os.fork()
if not child:
    os._exit(strand.num_threads())
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
strand.set_num_threads(0)
print(strand.num_threads())
"""


def test_cores_are_counted_again_in_a_forked_process_and_when_asked():
    assert python(CORES, STRAND_NUM_THREADS="").stdout == "1\n1\n"


@pytest.mark.parametrize("said", ["many", "-1", "2.5"])
def test_an_environment_that_says_no_number_of_threads_is_refused(said):
    done = python("import strand", STRAND_NUM_THREADS=said)
    assert done.returncode == 1
    assert f'ValueError: STRAND_NUM_THREADS: expected a whole number >= 0, got "{said}"' in done.stderr


def test_what_is_set_holds_over_the_environment():
    code = "import strand; strand.set_num_threads(2); print(strand.num_threads())"
    assert python(code, STRAND_NUM_THREADS="5").stdout == "2\n"


def test_sub_interpreters_are_refused():
    code = """
import strand
try:
    import _interpreters as interpreters
except ImportError:  # before Python 3.13
    import _xxsubinterpreters as interpreters
try:
    failed = interpreters.run_string(
        interpreters.create(), f"import sys; sys.path[:0] = {sys.path!r}\\nimport strand"
    ).formatted
except getattr(interpreters, "RunFailedError", ()) as error:
    failed = str(error)
print(failed.splitlines()[0])
print(len(strand.count_neighbors([[0.0, 0.0, 0.0]], 1.0)))
"""
    done = python(code)
    assert done.returncode == 0, done.stderr
    refused, works = done.stdout.splitlines()
    assert "ImportError" in refused
    assert works == "1"


def test_several_python_threads_may_call_at_once():
    expected = {kernel: call_kernel(kernel) for kernel in CALLS}
    with ThreadPoolExecutor(8) as executor:
        calls = [(kernel, executor.submit(call_kernel, kernel)) for _ in range(25) for kernel in CALLS]
        for kernel, future in calls:
            assert_same(future.result(timeout=60), expected[kernel])


def test_python_goes_on_while_a_kernel_works():
    # one place, so that every point is every other's neighbour: much work for little memory
    points = np.zeros((12_000, 3))
    steps = 0
    done = threading.Event()

    def step():
        nonlocal steps
        while not done.is_set():
            steps += 1
            time.sleep(0.0005)

    stepping = threading.Thread(target=step)
    stepping.start()
    try:
        taken = 0
        # with the interpreter locked for the whole call it could take a step or two in any of them; otherwise
        # other programs may still keep it from more in some
        for _ in range(20):
            before = steps
            count_neighbors(points, 1.0)
            taken = max(taken, steps - before)
            if taken >= 5:
                break
    finally:
        done.set()
        stepping.join()
    assert taken >= 5


def assert_goes_on(thread):
    """This thread goes on until another ends; the interpreter is not locked meanwhile."""
    steps = 0
    while thread.is_alive():
        time.sleep(0.001)
        steps += 1
    # with the interpreter locked while a call waits, hardly any step could be taken
    assert steps >= 50


@pytest.mark.parametrize("kernel", [count_neighbors, strand.radius_outlier_mask])
def test_python_goes_on_while_a_short_call_waits_for_a_long_one(kernel):
    many = np.random.default_rng(0).uniform(size=(60_000, 3))
    few = many[:300]
    wanted = (1.0,) if kernel is count_neighbors else (1.0, 3)
    long = threading.Thread(target=count_neighbors, args=(many, 1.0))
    short = threading.Thread(target=kernel, args=(few, *wanted))
    long.start()
    time.sleep(0.05)
    short.start()
    assert_goes_on(long)
    short.join()


def test_python_goes_on_while_a_query_waits_for_a_long_kernel():
    points = np.random.default_rng(0).uniform(size=(200_000, 3))
    rope = _core.TubeQueries([points[:100]], [np.arange(100.0)], [0.01])
    long = threading.Thread(target=strand.estimate_normals, args=(points,), kwargs={"k": 200})
    long.start()
    time.sleep(0.05)
    # on the main thread and on another
    other = threading.Thread(target=rope.nearest, args=(points[:1000],))
    other.start()
    rope.nearest(points[:1000])
    assert_goes_on(long)
    other.join()


def forked_answers(queue):
    queue.put([list_arrays(call_kernel(kernel)) for kernel in CALLS])


@pytest.mark.parametrize("busy", [False, True])
def test_a_forked_process_can_call_after_its_parent_did(busy):
    expected = [list_arrays(call_kernel(kernel)) for kernel in CALLS]
    stop = threading.Event()

    def keep_working():
        while not stop.is_set():
            count_neighbors(make_lattice(2000), 0.5)

    # a kernel at work at the moment of the fork
    working = threading.Thread(target=keep_working)
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    children = [context.Process(target=forked_answers, args=(queue,), daemon=True) for _ in range(4)]
    if busy:
        working.start()
    try:
        for child in children:
            child.start()
        for _ in children:
            for got, want in zip(queue.get(timeout=30), expected, strict=True):
                assert_same(got, want)
        for child in children:
            child.join(timeout=30)
            assert child.exitcode == 0
    finally:
        stop.set()
        if busy:
            working.join()
        for child in children:
            if child.is_alive():
                child.kill()
