"""The command line, and files and streams that fail."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import strand
from strand import cli

SCENE = strand.synthetic.scene("arc", views=1, camera=strand.synthetic.Camera(size=(40, 30)))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a scene; `strand.reconstruct` is replaced by a function that returns at once."""
    made = strand.Model((), np.eye(4)[None])
    monkeypatch.setattr(strand, "reconstruct", lambda *_, **__: made)
    monkeypatch.chdir(tmp_path)
    SCENE.save("arc.npz")
    return tmp_path


def run(*arguments):
    return cli.main(["reconstruct", *map(str, arguments)])


@pytest.mark.parametrize(
    ("out", "reason"),
    [
        ("/dev/full", "Not a regular file"),
        (".", "Not a regular file"),
        ("loop.json", "Too many levels of symbolic links"),
        ("arc.npz/a.json", "Not a directory"),
        ("no/a.json", "No such file or directory"),
    ],
)
def test_unwritable_outputs_are_refused_before_the_work(folder, monkeypatch, capsys, out, reason):
    def reconstruct(*_, **__):
        raise AssertionError("too late")

    monkeypatch.setattr(strand, "reconstruct", reconstruct)
    Path("loop.json").symlink_to("loop.json")
    assert run("arc.npz", "-o", out) == 3
    assert capsys.readouterr().err.splitlines()[-1] == f"strand: error: {out}: {reason}"


@pytest.mark.parametrize(
    "words", [("reconstruct", "arc.npz", "--figures"), ("demo", "--out")], ids=["figures", "demo"]
)
def test_unwritable_folders_are_refused_before_the_work(folder, monkeypatch, capsys, words):
    def reconstruct(*_, **__):
        raise AssertionError("too late")

    monkeypatch.setattr(strand, "reconstruct", reconstruct)
    for out in ("arc.npz", "arc.npz/drawn", "/proc/self/stat"):
        assert cli.main([*words, out]) == 3
        assert capsys.readouterr().err == f"strand: error: {out}: Not a directory\n"
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert cli.main([*words, "new/drawn"]) == 3
    assert capsys.readouterr().err == "strand: error: new/drawn: Permission denied\n"
    assert not Path("new").exists()


def test_inputs_are_never_overwritten(folder, capsys):
    Path("a.toml").touch()
    Path("link.npz").symlink_to("arc.npz")
    Path("1-raw.png").symlink_to("arc.npz")
    before = Path("arc.npz").read_bytes()
    for arguments in (
        ("arc.npz", "-o", "a.toml", "--config", "a.toml"),
        ("link.npz", "-o", "arc.npz"),
        ("arc.npz", "-o", "link.npz"),
        ("arc.npz", "-o", "a.json", "--figures", "."),
    ):
        assert run(*arguments) == 2
        assert ": expected another file than the inputs, got " in capsys.readouterr().err
    assert Path("arc.npz").read_bytes() == before
    assert not Path("a.toml").read_bytes()


def test_limits_and_outside_apply_to_the_scene(folder, capsys):
    assert run("arc.npz", "-o", "a.json", "--max-bytes", 3000) == 1
    assert "of max_bytes=3000" in capsys.readouterr().err
    np.save("points.npy", np.ones((3, 3)))
    Path("scene").mkdir()
    pose = np.eye(4).tolist()
    Path("scene/scene.toml").write_text(f'[[view]]\nfile = "../points.npy"\npose = {pose}\n')
    assert run("scene", "-o", "a.json") == 1
    assert "outside of the scene's folder; outside=True (--outside) allows that" in capsys.readouterr().err
    assert not Path("a.json").exists()
    assert run("scene", "-o", "a.json", "--outside") == 0
    assert Path("a.json").exists()


@pytest.mark.parametrize("file", ["pipe.npz", "endless.npz", "loop.npz", "huge.toml"])
def test_endless_files_are_refused(folder, capsys, file):
    os.mkfifo("pipe.npz")
    Path("endless.npz").symlink_to("/dev/zero")
    Path("loop.npz").symlink_to("loop.npz")
    with Path("huge.toml").open("wb") as sparse:
        sparse.truncate(1 << 40)
    for arguments in ((file, "-o", "a.json"), ("arc.npz", "-o", "a.json", "--config", file)):
        assert run(*arguments) == (3 if "loop" in file else 1)
        assert capsys.readouterr().err.splitlines()[-1].startswith(f"strand: error: {file}: ")


def test_exhausted_memory_is_an_error_of_one_line(folder, monkeypatch, capsys):
    def load_scene(*_, **__):
        raise MemoryError

    monkeypatch.setattr(cli.inputs, "load_scene", load_scene)
    assert run("arc.npz", "-o", "a.json") == 1
    assert capsys.readouterr().err == "strand: error: out of memory\n"


PROGRAM = """
import strand, numpy, sys
strand.reconstruct = lambda *_, **__: strand.Model((), numpy.eye(4)[None].repeat(5000, 0))
sys.exit(strand.cli.main())
"""


def test_closed_streams_and_full_disks(tmp_path):
    SCENE.save(tmp_path / "arc.npz")
    full = os.open("/dev/full", os.O_WRONLY)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}

    def program(*arguments, **options):
        given = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "env": environment} | options
        command = [sys.executable, "-c", f"import strand.cli{PROGRAM}", *arguments]
        done = subprocess.run(command, cwd=tmp_path, check=False, **given)
        assert b"Traceback" not in (done.stderr or b"")
        assert b"Exception ignored" not in (done.stderr or b"")
        return done

    model = ("reconstruct", "arc.npz", "-o", "a.json")
    done = program(*model, stdout=full)
    assert (done.returncode, done.stderr.splitlines()[-1]) == (
        3,
        b"strand: error: [Errno 28] No space left on device",
    )
    assert program("--help", stdout=full).returncode == 3
    assert program(*model, stderr=full).returncode == 0
    assert program(*model, preexec_fn=lambda: [os.close(stream) for stream in range(3)]).returncode == 0
    (tmp_path / "a.json").write_text("old")
    limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))  # noqa: E731
    done = program(*model, preexec_fn=limit)
    assert (done.returncode, done.stderr.splitlines()[-1]) == (3, b"strand: error: a.json: File too large")
    assert (tmp_path / "a.json").read_text() == "old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.json", "arc.npz"]
    os.close(full)


def test_an_interrupt_during_writing_leaves_the_old_file(folder, monkeypatch, capsys):
    Path("a.json").write_text("old")
    monkeypatch.setattr(os, "fsync", lambda _: signal.raise_signal(signal.SIGINT))
    assert run("arc.npz", "-o", "a.json") == 130
    assert capsys.readouterr().err.splitlines()[-1] == "strand: error: interrupted"
    assert Path("a.json").read_text() == "old"
    assert sorted(path.name for path in folder.iterdir()) == ["a.json", "arc.npz"]
