"""Exit codes, errors of one line, wrong usage and help."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import strand
from strand import cli
from strand.cli import main


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (["no.npz", "-o", "a.json"], 3, "no.npz: No such file or directory"),
        (["empty.npz", "-o", "a.json"], 1, "empty.npz: the file is empty"),
        (["half.npz", "-o", "a.json"], 1, "half.npz: truncated"),
        (["arc.npz", "-o", "no/a.json"], 3, "no/a.json: No such file or directory"),
        (["arc.npz", "-o", "."], 3, ".: Not a regular file"),
        (["arc.npz", "-o", "a.json", "--config", "no.toml"], 3, "no.toml: No such file or directory"),
        (["arc.npz", "-o", "a.json", "--config", "bad.toml"], 1, "bad.toml: "),
        (["arc.npz", "-o", "a.json", "--radius", "0"], 2, "radius: "),
        (["arc.npz", "-o", "a.json", "--ropes", "0"], 2, "ropes: "),
        (
            ["arc.npz", "-o", "a.json", "--mask", "none.npy"],
            2,
            "masks: expected one file for each of 3 views",
        ),
        (
            ["arc.npz", "-o", "a.json", "--mask", *["none.npy"] * 3],
            1,
            "views: no view has a point: view 0 has an",
        ),
        (["arc.npz", "-o", "a.json", "--mask", *["small.npy"] * 3], 1, "small.npy: mask: expected the depth"),
        (["arc.npz", "-o", "a.json", "--mask", *["no.png"] * 3], 3, "no.png: No such file or directory"),
        (["arc.npz", "-o", "a.json", "--ropes", "1", "--length", "1", "2"], 2, "length: "),
        (["arc.npz", "-o", "a.json", "--bounds", "0", "0", "0", "-1", "1", "1"], 2, "bounds: "),
        (["arc.npz", "-o", "a.json", "--bounds", "7", "7", "7", "8", "8", "8"], 1, ""),
    ],
)
def test_expected_errors_are_one_line(scene_npz, tmp_path, monkeypatch, capsys, options, code, message):
    monkeypatch.chdir(tmp_path)
    Path("empty.npz").touch()
    Path("half.npz").write_bytes(scene_npz.read_bytes()[:5000])
    Path("bad.toml").write_text("[tracing]\nneer = 1\n")
    np.save("none.npy", np.zeros((240, 320), dtype=bool))
    np.save("small.npy", np.ones((3, 4), dtype=bool))
    assert main(["reconstruct", *options]) == code
    assert capsys.readouterr().err.splitlines()[-1].startswith(f"strand: error: {message}")
    assert not Path("a.json").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["demolish"],
        ["reconstruct"],
        ["reconstruct", "arc.npz", "-o", "a.json", "--radius", "4.2 inch"],
        ["reconstruct", "arc.npz", "-o", "a.json", "--ropes", "one"],
        ["reconstruct", "", "-o", "a.json"],
        ["reconstruct", "arc.npz", "-o", ""],
        ["reconstruct", "arc.npz", "-o", "a.json", "--mask", ""],
        ["reconstruct", "arc.npz", "-o", "a.json", "--bounds", "1", "2"],
        ["demo", "--seed", "x"],
    ],
)
def test_wrong_usage(arguments, capsys):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    assert "usage: strand" in capsys.readouterr().err


def test_wrong_length_is_explained(capsys):
    with pytest.raises(SystemExit):
        main(["reconstruct", "a.npz", "-o", "a.json", "--radius", "4.2 inch"])
    assert "--radius: length: expected metres, or a number with mm, cm or m" in capsys.readouterr().err


def test_version_and_help(capsys):
    for arguments in (["--version"], ["--help"], ["demo", "--help"], ["reconstruct", "--help"]):
        with pytest.raises(SystemExit) as caught:
            main(arguments)
        assert caught.value.code == 0
        out = capsys.readouterr().out
        assert out == f"strand {strand.__version__}\n" if arguments == ["--version"] else "exit codes:" in out


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (KeyboardInterrupt(), 130, "strand: error: interrupted"),
        (ImportError("pillow is needed here"), 3, "strand: error: pillow is needed here"),
        (PermissionError(13, "Permission denied", "a.npz"), 3, "strand: error: a.npz: Permission denied"),
        (OSError("no space"), 3, "strand: error: no space"),
        (TypeError("radius: expected a number"), 2, "strand: error: radius: expected a number"),
    ],
)
def test_exit_codes(monkeypatch, capsys, error, code, line):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr(cli.inputs, "load_scene", fail)
    assert main(["reconstruct", "a.npz", "-o", "a.json"]) == code
    assert capsys.readouterr().err.splitlines() == [line]


def test_unexpected_errors_are_raised(monkeypatch):
    def fail(*_, **__):
        raise ZeroDivisionError

    monkeypatch.setattr(cli.inputs, "load_scene", fail)
    with pytest.raises(ZeroDivisionError):
        main(["reconstruct", "a.npz", "-o", "a.json"])
