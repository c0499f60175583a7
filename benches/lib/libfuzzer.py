"""Runs of libFuzzer, as a program of its own or within Atheris, and what they print."""

from __future__ import annotations

import re
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from lib.tables import print_head, print_row

SLOWEST = 120  # seconds of one input by the clock, which other programs make longer
MEMORY = 2048  # MB of the process


@dataclass(frozen=True)
class Outcome:
    """The counts of a run.

    Attributes
    ----------
    inputs : int
        Inputs that ran.
    seconds : float
        How long they took.
    before, after : int
        Edges that the first inputs and all inputs covered.
    corpus : int
        Inputs that cover something of their own.
    crash : str
        Why the run ended early; empty if it did not.
    """

    inputs: int
    seconds: float
    before: int
    after: int
    corpus: int
    crash: str


def run_fuzzer(
    command: Sequence[str],
    folders: Sequence[Path],
    findings: Path,
    *,
    environment: Mapping[str, str],
    inputs: int,
    seconds: int,
    length: int,
) -> Outcome:
    """Run a fuzzer until it has had so many inputs or seconds, and return what it found.

    The first of `folders` gets the inputs that cover something new; the others hold the first inputs.
    `findings` is the start of the paths of inputs that end the process.
    """
    options = [f"-runs={inputs}", f"-max_total_time={seconds}", f"-max_len={length}", "-print_final_stats=1"]
    options += [f"-timeout={SLOWEST}", f"-rss_limit_mb={MEMORY}", f"-artifact_prefix={findings}"]
    done = subprocess.run(
        [*command, *options, *map(str, folders)],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        check=False,
    )
    return read_output(done.stderr, done.returncode)


def read_output(text: str, code: int) -> Outcome:
    """Return what libFuzzer says in its log."""
    states = re.findall(r"^#(\d+)\s+(\w+)\s+cov: (\d+) .*?corp: (\d+)/", text, re.MULTILINE)
    if not states:
        raise RuntimeError(f"the fuzzer did not start:\n{text[-2000:]}")
    first = next((state for state in states if state[1] == "INITED"), states[0])
    counts = dict(re.findall(r"^stat::(\w+):\s+(\d+)$", text, re.MULTILINE))
    inputs = int(counts.get("number_of_executed_units", states[-1][0]))
    rate = int(counts.get("average_exec_per_sec", 0))
    crash = ""
    if code != 0:
        why = re.search(r"panicked at (.*)|Uncaught Python exception: ===\n(.*)|ERROR: (.*)", text)
        crash = next((part for part in why.groups() if part), "") if why else f"exit code {code}"
    return Outcome(
        inputs, inputs / rate if rate else 0.0, int(first[2]), int(states[-1][2]), int(states[-1][3]), crash
    )


class Table:
    """A table of runs, a row for each.

    Attributes
    ----------
    crashes : list of str
        The names of runs that ended early, and why.
    """

    def __init__(self, first: str, last: str) -> None:
        """Print the head; `first` says what runs, and `last` how a run ends early, in plural."""
        self.crashes: list[str] = []
        self._ends = last
        self._inputs = 0
        self._started = time.monotonic()
        print_head(first, "inputs", "a second", "edges at the start", "at the end", "corpus", last)

    def add(self, name: str, found: Outcome) -> None:
        """Print the row of a run."""
        self._inputs += found.inputs
        rate = round(found.inputs / found.seconds) if found.seconds else found.inputs
        counts = (found.inputs, rate, found.before, found.after, found.corpus, int(bool(found.crash)))
        print_row(name, *(f"{count:,}" for count in counts))
        self.crashes += [f"{name}: {found.crash}"] if found.crash else []

    def end(self) -> int:
        """Print the sums, and return the exit code: 1 if a run ended early."""
        minutes = (time.monotonic() - self._started) / 60
        print(f"\n{self._inputs:,} inputs in {minutes:.0f} minutes, {len(self.crashes)} {self._ends}")
        for crash in self.crashes:
            print(f"- {crash}")
        return int(bool(self.crashes))
