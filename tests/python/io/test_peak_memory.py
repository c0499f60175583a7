"""Reading a file takes no more memory and time than its limit allows, whatever the file declares."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from shared import peaks
from shared.tricks.all_tricks import list_tricks


@pytest.fixture(scope="module")
def measured():
    """Return the memory, the time and the outcome of each trick."""
    done = subprocess.run([sys.executable, peaks.__file__], capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
    return {each["name"]: each for each in map(json.loads, done.stdout.splitlines())}


@pytest.mark.parametrize("trick", list_tricks(), ids=lambda trick: trick.name)
def test_memory_stays_within_twice_the_limit(measured, trick):
    found = measured[trick.name]
    kind = found["outcome"].partition(":")[0]
    assert kind == ("answer" if trick.answered else "FileFormatError"), found
    assert found["memory"] <= trick.most, found
    # a trick that is not refused early may run into the limit on processor time
    assert found["seconds"] < min(trick.seconds, peaks.SECONDS), found


def test_tricks_have_names_of_their_own():
    names = [trick.name for trick in list_tricks()]
    assert len(set(names)) == len(names)
