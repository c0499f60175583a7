"""Batches by Ray: a cluster of a head and two workers on the loopback address, started here."""

from __future__ import annotations

import os
import secrets
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
import ray
from ray import exceptions as errors
from ray._raylet import Config
from ray.cluster_utils import Cluster

from shared.batch_recordings import SETTINGS, Deadly, FullDisk, find_shards, read_table, save_scenes
from strand.batch import Counts, EngineError, find_units, load_table, ray_engine, run
from strand.batch.engines import MAX_ATTEMPTS
from strand.batch.shards import list_shards, prepare_folder
from strand.batch.work import Work

COUNT = 12
HERE = "127.0.0.1"
# another loopback address: it reaches servers on all addresses, but not those on 127.0.0.1
ELSEWHERE = "127.0.0.2"


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    return save_scenes(tmp_path_factory.mktemp("recordings"), COUNT)


@pytest.fixture(scope="module")
def expected(recordings, tmp_path_factory):
    """The table of the local engine."""
    out = tmp_path_factory.mktemp("expected")
    run(recordings, out, SETTINGS, root=recordings, workers=1)
    return read_table(out)


@pytest.fixture(scope="module")
def cluster():
    """The address of a private cluster: loopback only, with its own token, without statistics."""
    with pytest.MonkeyPatch.context() as patch:
        # its processes import the same modules as this one
        patch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        # without a token, Ray would leave one in the user's folder
        patch.setenv("RAY_AUTH_TOKEN", secrets.token_hex(32))
        patch.setenv("RAY_AUTH_MODE", "token")
        # as `ray_engine._listen_on_loopback`, for drivers too
        patch.setenv("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0")
        patch.setattr(ray._private.ray_constants, "ENABLE_RAY_CLUSTER", False)
        # Ray reads its settings when it is imported
        Config.initialize("")
        node = {"node_ip_address": HERE, "object_store_memory": 80 << 20, "include_dashboard": False}
        started = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, **node})
        for _ in range(2):
            started.add_node(num_cpus=1, **node)
        yield started.address
        ray.shutdown()
        started.shutdown()
    Config.initialize("")


def by_ray(recordings, out, cluster, **more):
    return run(recordings, out, SETTINGS, root=recordings, engine="ray", address=cluster, **more)


def test_rows_are_those_of_the_local_engine_bit_for_bit(recordings, expected, cluster, tmp_path):
    seen = []
    assert by_ray(recordings, tmp_path, cluster, progress=seen.append) == Counts(COUNT, 0, COUNT, 0)
    assert [one.made for one in seen] == list(range(1, COUNT + 1))
    assert read_table(tmp_path).equals(expected)
    assert by_ray(recordings, tmp_path, cluster) == Counts(0, COUNT, 0, 0)
    # one engine skips the other's units
    assert run(recordings, tmp_path, SETTINGS, root=recordings) == Counts(0, COUNT, 0, 0)
    assert not ray.is_initialized()


def test_both_workers_have_the_given_number_of_threads(recordings, cluster):
    ray.init(address=cluster, log_to_driver=False)
    try:
        alive = [node for node in ray.nodes() if node["Alive"]]
        assert sorted(node["Resources"].get("CPU", 0) for node in alive) == [0, 1, 1]
        assert {node["NodeManagerAddress"] for node in alive} == {HERE}
        assert reached(alive, cluster) == set()
        units = list(find_units([recordings], SETTINGS, recordings))[:6]
        answers = dict(ray_engine.run_units(where, iter(units), 1, 1))
        # each task had the only CPU of its node
        assert len({node for node, _ in answers.values()}) == 2
        assert {threads for _, threads in answers.values()} == {1}
        # a task with two threads does not fit on two machines with one CPU each
        with pytest.raises(ValueError, match="threads: expected at most 1"):
            next(ray_engine.run_units(where, iter(units), 1, 2))
        # a Ray that the caller has connected to stays
        assert ray.is_initialized()
    finally:
        ray.shutdown()


def reached(nodes, cluster):
    """Return the ports of a cluster that other machines can reach."""
    ports = {int(cluster.rpartition(":")[2])}
    ports |= {node[kind] for node in nodes for kind in ("NodeManagerPort", "ObjectManagerPort")}
    found = set()
    for port in ports:
        socket.create_connection((HERE, port), timeout=5.0).close()
        try:
            socket.create_connection((ELSEWHERE, port), timeout=5.0).close()
        except OSError:
            continue
        found.add(port)
    return found


ALONE = """
import os
import sys
from contextlib import suppress
from pathlib import Path
import ray
from ray._raylet import AuthenticationMode, get_authentication_mode
from shared.batch_recordings import SETTINGS
from strand.batch import run
from test_ray_engine import reached

def look(done):
    assert reached(ray.nodes(), ray.get_runtime_context().gcs_address) == set()
    assert get_authentication_mode() == AuthenticationMode.TOKEN
    token = os.environ["RAY_AUTH_TOKEN"]
    for process in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            assert token not in process.read_text()
    tokens.add(token)

if __name__ == "__main__":
    given, out = sys.argv[1:]
    tokens = set()
    for folder in (out, out + "2"):
        print(run(given, folder, SETTINGS, root=given, engine="ray", workers=1, progress=look).made)
        # Ray sets this one itself
        assert {name for name in os.environ if name.startswith("RAY_")} <= {"RAY_CLIENT_MODE"}
    assert len(tokens) == 2
"""


def test_a_local_ray_is_private_quiet_and_leaves_no_files(tmp_path):
    recordings = save_scenes(tmp_path / "in", 2)
    run(recordings, tmp_path / "expected", SETTINGS, root=recordings, workers=1)
    # not below tmp_path: names of sockets must be short
    with tempfile.TemporaryDirectory() as folder:
        path = os.pathsep.join([*sys.path, str(Path(__file__).parent)])
        # the environment of a user who has not configured Ray
        environment = {name: value for name, value in os.environ.items() if not name.startswith("RAY_")}
        environment |= {"PYTHONPATH": path, "HOME": folder, "TMPDIR": folder}
        command = [sys.executable, "-c", ALONE, str(recordings), str(tmp_path / "out")]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout, done.stderr) == (0, "2\n2\n", "")
        assert list(Path(folder, "ray").glob("session_2*")) == []
        assert not Path(folder, ".ray").exists()
    assert read_table(tmp_path / "out").equals(read_table(tmp_path / "expected"))


def test_tasks_are_counted_per_machine():
    nodes = [
        {"Alive": alive, "Resources": {"CPU": cpus}} for alive, cpus in [(True, 3), (True, 5), (False, 8)]
    ]
    nodes.append({"Alive": True, "Resources": {}})
    assert [ray_engine._count_tasks(nodes, threads) for threads in (1, 2, 3, 4, 5)] == [8, 3, 2, 1, 1]
    with pytest.raises(ValueError, match="threads: expected at most 5"):
        ray_engine._count_tasks(nodes, 6)
    with pytest.raises(ValueError, match="threads: expected at most 0"):
        ray_engine._count_tasks([], 1)


@pytest.mark.parametrize("error", [errors.NodeDiedError("gone"), errors.ObjectLostError("ab", None, "")])
def test_a_dead_machine_counts_as_a_dead_process(monkeypatch, error):
    assert ray_engine._get_counts(answering(monkeypatch, error), None) is None


def test_errors_of_the_work_are_raised_unchanged(monkeypatch):
    full = OSError("No space left")
    with pytest.raises(OSError, match="No space left"):
        ray_engine._get_counts(answering(monkeypatch, errors.RayTaskError("f", "", full)), None)


def answering(monkeypatch, error):
    """Return Ray with a `get` that raises an error."""

    def get(reference):
        raise error

    monkeypatch.setattr(ray, "get", get)
    return ray


def test_an_error_of_ray_is_an_engine_error(recordings, monkeypatch):
    monkeypatch.setattr(ray, "is_initialized", lambda: True)
    monkeypatch.setattr(ray, "remote", lambda **_: lambda task: task)

    def lost(work):
        raise errors.RaySystemError("the driver's node is gone")

    monkeypatch.setattr(ray, "put", lost)
    with pytest.raises(EngineError, match=r"Ray: .*the driver's node is gone"):
        next(ray_engine.run_units(where, find_units([recordings], SETTINGS, recordings), 1, 1))


def test_a_ray_that_does_not_start_is_an_engine_error(recordings, monkeypatch):
    def other(**_):
        raise RuntimeError("Version mismatch: the cluster has another")

    monkeypatch.setattr(ray, "init", other)
    for address in (None, "auto"):
        with pytest.raises(EngineError, match="Ray: Version mismatch"):
            next(ray_engine.run_units(where, find_units([recordings], SETTINGS, recordings), 1, 1, address))


@pytest.mark.parametrize("address", ["127.0.0.1:{}", "ray://localhost:{}", "[::1]:{}", "127.0.0.1:99999"])
def test_a_missing_cluster_is_an_error_at_once(recordings, tmp_path, address):
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    begun = time.monotonic()
    with pytest.raises(ConnectionError, match="address: no cluster of Ray answers at"):
        by_ray(recordings, tmp_path, address.format(port))
    assert time.monotonic() - begun < 5.0


def where(unit):
    """Return the node of a task, and its number of threads."""
    import strand

    time.sleep(0.3)
    return ray.get_runtime_context().get_node_id(), strand.num_threads()


def test_units_are_taken_no_faster_than_they_are_done(recordings, cluster):
    units = list(find_units([recordings], SETTINGS, recordings))
    taken = []

    def given():
        for unit in units:
            taken.append(unit)
            yield unit

    ends = ray_engine.run_units(where, given(), 1, 1, cluster)
    for done, _ in enumerate(ends, start=1):
        # two workers, each with waiting units
        assert len(taken) <= done + 2 * ray_engine.AHEAD
    assert len(taken) == COUNT


def test_a_killed_worker_is_replaced_and_a_deadly_unit_given_up(recordings, cluster, tmp_path):
    out, notes = tmp_path / "out", tmp_path / "notes"
    notes.mkdir()
    prepare_folder(out, SETTINGS, recordings)
    units = list(find_units([recordings], SETTINGS, recordings))[:6]
    bad, bad_once = units[1].recording, units[4].recording
    work = Work(SETTINGS, str(out))
    deadly = Deadly(Deadly(work, (bad_once,), 1, str(notes)), (bad,), 99, str(notes))
    answers = dict(ray_engine.run_units(deadly, iter(units), 1, 1, cluster))
    assert [unit.recording for unit, written in answers.items() if written is None] == [bad]
    assert len(answers) == len(units)
    assert (notes / bad.replace("/", "-")).read_bytes() == b"x" * MAX_ATTEMPTS
    assert len(load_table(out)) == len(units) - 1


def test_a_full_disk_stops_the_run_and_leaves_whole_shards(recordings, expected, cluster, tmp_path):
    prepare_folder(tmp_path, SETTINGS, recordings)
    full = FullDisk(Work(SETTINGS, str(tmp_path)), 4)
    with pytest.raises(OSError, match="No space left"):
        list(ray_engine.run_units(full, find_units([recordings], SETTINGS, recordings), 1, 1, cluster))
    count = len(find_shards(tmp_path))
    assert 0 < count < COUNT
    assert by_ray(recordings, tmp_path, cluster).skipped >= count
    assert read_table(tmp_path).equals(expected)


DRIVER = """
import sys
from shared.batch_recordings import SETTINGS
from strand.batch import run

run(sys.argv[1], sys.argv[2], SETTINGS, root=sys.argv[1], engine="ray", address=sys.argv[3])
"""


def test_a_killed_driver_leaves_whole_shards_and_the_next_run_completes_them(
    recordings, expected, cluster, tmp_path
):
    prepare_folder(tmp_path, SETTINGS, recordings)
    command = [sys.executable, "-c", DRIVER, str(recordings), str(tmp_path), cluster]
    driver = subprocess.Popen(command, stderr=subprocess.PIPE)
    end = time.monotonic() + 60.0
    while len(list_shards(tmp_path)) < 2:
        assert time.monotonic() < end
        time.sleep(0.002)
    os.kill(driver.pid, signal.SIGKILL)
    driver.communicate()
    count = len(find_shards(tmp_path))
    assert 2 <= count < COUNT
    done = by_ray(recordings, tmp_path, cluster)
    assert done.made + done.skipped == COUNT
    assert done.skipped >= count
    assert read_table(tmp_path).equals(expected)
    assert len(list_shards(Path(tmp_path))) == COUNT


def test_ray_is_asked_for_where_it_is_missing(recordings, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ImportError, match=r'ray is needed here: pip install "[\w.-]+\[ray\]"'):
        run(recordings, tmp_path / "out", engine="ray")
    assert not (tmp_path / "out").exists()
