"""The installed program, and what it shows on a terminal."""

from __future__ import annotations

import contextlib
import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import pytest

import strand

PROGRAM = str(Path(sys.executable).with_name("strand"))


@pytest.mark.parametrize("program", [[PROGRAM], [sys.executable, "-m", "strand"]])
def test_installed_program(program, scene_npz, tmp_path):
    done = subprocess.run(
        [*program, "reconstruct", str(scene_npz), "-o", str(tmp_path / "a.json")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert strand.load_model(tmp_path / "a.json").chains


def test_closed_pipe_is_not_an_error(scene_npz, tmp_path):
    process = subprocess.Popen(
        [PROGRAM, "reconstruct", str(scene_npz), "-o", str(tmp_path / "a.json")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    process.stdout.close()
    err = process.stderr.read()
    process.stderr.close()
    assert process.wait() == 141
    assert "Error" not in err
    assert "Traceback" not in err


SLOW = """
import sys, time, strand, strand.cli

def reconstruct(*_, progress, **__):
    for stage in stages.split(","):
        progress(stage)
        time.sleep(float(seconds))
    return made

*sys.argv, stages, seconds = sys.argv
made = strand.Model((), __import__("numpy").eye(4)[None])
strand.reconstruct = reconstruct
sys.exit(strand.cli.main())
"""


def on_a_terminal(*command):
    """Return the exit code of a command, and all that it writes to a terminal of its own."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        command, stdout=theirs, stderr=theirs, env=os.environ | {"TERM": "xterm", "COLUMNS": "80"}
    )
    os.close(theirs)
    shown = b""
    with contextlib.suppress(OSError):  # the terminal has no user any more
        while block := os.read(ours, 4096):
            shown += block
    os.close(ours)
    return process.wait(), shown.decode()


def test_long_work_shows_stages_and_times_on_a_terminal(scene_npz):
    command = [sys.executable, "-c", SLOW, "reconstruct", str(scene_npz)]
    code, shown = on_a_terminal(*command, "first,second,third", "0.7")
    assert code == 0
    pictures = re.sub(r"\x1b\[[0-9;]*m", "", shown).split("\x1b[2K")
    rows = [re.findall(r"(first|second|third) +(\d\.\d) s", picture) for picture in pictures]
    # the display appears after a second, and its last state has all three stages
    begun = next(filter(None, rows))
    assert begun[0][0] == "first"
    assert sum(float(seconds) for _, seconds in begun) >= 1.0
    last = [row for row in rows if row][-1]
    assert [name for name, _ in last] == ["first", "second", "third"]
    assert float(last[0][1]) >= 0.7
    # it vanishes before the answer is printed
    after = shown[shown.rindex("third") :]
    assert "\x1b[?25h" in after
    assert after.index("\x1b[?25h") < after.index("Check it")
    assert "strand: " not in shown


def test_short_work_shows_no_display(scene_npz):
    command = [sys.executable, "-c", SLOW, "reconstruct", str(scene_npz)]
    code, shown = on_a_terminal(*command, "one", "0.1")
    assert code == 0
    assert "\x1b" not in shown
    assert "one " not in shown


def test_errors_break_between_words_on_a_terminal(scene_npz):
    code, shown = on_a_terminal(PROGRAM, "reconstruct", "a.npz", "b.npz")
    assert code == 2
    lines = shown.splitlines()
    assert len(lines) == 2
    assert all(len(line) <= 80 for line in lines)
    assert " ".join(shown.split()).startswith(
        "strand: error: SCENE: expected one, got 2; for files of several views"
    )
