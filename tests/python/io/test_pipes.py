"""Named pipes where files are meant are refused at once: reading one would wait for a writer."""

from __future__ import annotations

import json
import subprocess
import sys

from shared import pipes

SECONDS = 120  # for all readers and the start of Python


def test_every_reader_refuses_a_pipe(tmp_path):
    command = [sys.executable, pipes.__file__, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert not done.returncode, done.stderr
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(found) == len(pipes.READERS)
    for each in found:
        assert each["kind"] == "FileFormatError", each
        assert "expected a regular file, got a device, a pipe or a socket" in each["text"], each
        assert each["text"].startswith(str(tmp_path)), each
        assert each["text"].count("expected") == 1, each
