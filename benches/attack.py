"""Call every kernel and public function with mad arguments, and print what breaks.

python benches/attack.py [--calls N] [--seed N] [--only NAME ...]

Numbers are NaN, infinite, huge, tiny, zero or negative. Arrays are empty, have other shapes, types and
strides, are read-only, or are no arrays at all. Calls run in a process of their own with little memory.
Findings are:

- the end of that process,
- an exception that is not allowed (`lib/public_calls.py`),
- NaN in an answer,
- a call that takes longer than ten seconds.

The exit code is 1 if there are findings.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import resource
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

from lib.public_calls import CALLS, ITERATIVE, SHARES, UNCHECKED, list_allowed, list_numbers
from lib.results import make_parser, run_bench

MAX_SECONDS = 10.0  # of a call
MEMORY = 3 << 30  # bytes for a process
MANY_ITERATIONS = 10**4  # a call that asks for more may take long
CALLS_AT_ONCE = 100_000  # of one process

# fmt: off
NUMBERS = (
    0.0, -0.0, 1.0, -1.0, 1e-3, 1e3, 1e9, -1e9, 1e-9, 1e99, 1e100, 1e154, 1e300, -1e300, 1e-160, 1e-300,
    5e-324,
)
WILD = (*NUMBERS, math.nan, math.inf, -math.inf)
COUNTS = (0, 1, 2, 3, 7, 255, 10**4, 2**31 - 1, 2**31, 2**53, 2**63 - 1, 2**63, 2**64, -1, -(2**63), True)
OTHERS = (
    None, "points", b"", [], {}, (), object(), 1 + 2j, [[1.0, 2.0], [3.0]], "1.0", np.datetime64("2020"),
)
TYPES = ("f2", "f4", "f8", ">f8", "i1", "i8", "u8", "c16", "bool", "O", "U3", "longdouble")
SHAPES = ((), (0,), (3,), (0, 3), (1, 3), (3, 1), (5, 2), (4, 4), (2, 3, 3), (1, 0), (3, 0))
# fmt: on


def spoil_array(array: np.ndarray, chance: random.Random) -> object:
    """Return an array with something wrong, or only odd."""
    array = np.array(array)
    way = chance.randrange(16)
    if way < 5 and array.size and array.dtype.kind == "f":
        flat = array.reshape(-1)
        for _ in range(chance.choice((1, 1, 5, flat.size))):
            flat[chance.randrange(flat.size)] = chance.choice(WILD)
        return array
    if way == 5 and array.dtype.kind == "f":
        with np.errstate(all="ignore"):
            return array * chance.choice(NUMBERS)
    if way == 6 and array.dtype.kind == "f":
        return array + chance.choice((1e3, 1e6, 1e9, 1e15, 1e99))
    if way == 7:
        return array[: chance.choice((0, 1, 2, 3, 5))] if array.ndim else array
    if way == 8:
        return np.resize(array, chance.choice(SHAPES))
    if way == 9:
        # words are not whole numbers
        kind = "O" if array.dtype.kind in "UO" else chance.choice(TYPES)
        with np.errstate(all="ignore"):
            return array.astype(kind)
    if way == 10:
        return np.repeat(array, 2, axis=0)[::2] if array.ndim else array
    if way == 11:
        array.flags.writeable = False
        return np.asfortranarray(array)
    if way == 12:
        return array[::-1] if array.ndim else array
    if way == 13:
        return array.tolist()
    if way == 14:
        return np.zeros_like(array)
    return np.ma.masked_array(array, mask=False)


def spoil(value: object, chance: random.Random) -> object:
    """Return something else in place of a value."""
    if chance.random() < 0.08:
        return chance.choice(OTHERS)
    if isinstance(value, np.ndarray):
        return spoil_array(value, chance)
    if isinstance(value, bool) or value is None:
        return chance.choice((True, False, None, 1, "no"))
    if isinstance(value, int):
        return chance.choice(COUNTS)
    if isinstance(value, float):
        return chance.choice((*WILD, 10**400, np.float32(1.0), "1"))
    if isinstance(value, (list, tuple)):
        items = list(value)
        way = chance.random()
        if way < 0.1:
            items = items[:-1]
        elif way < 0.2:
            items = items + items[-1:]
        elif items:
            place = chance.randrange(len(items))
            items[place] = spoil(items[place], chance)
        return type(value)(items)
    return chance.choice(OTHERS)


def make_calls(first: int, calls: int, only: list[str]) -> None:
    """Make calls. Write each one down before it is made, as it may end the process."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    def ring(*_: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, ring)
    names, notes, outcomes = only or sorted(CALLS), sys.stdout, Counter()
    for number in range(first, first + calls):
        chance = random.Random(number)
        name = chance.choice(names)
        while chance.random() > SHARES.get(name, 1.0):
            name = chance.choice(names)
        function, arguments, options = CALLS[name]
        arguments, options, expected = list(arguments), dict(options), list_allowed(name)
        for _ in range(chance.choice((0, 1, 1, 1, 2, 3))):
            place = chance.randrange(len(arguments) + len(options))
            if place < len(arguments):
                arguments[place] = spoil(arguments[place], chance)
            else:
                key = sorted(options)[place - len(arguments)]
                options[key] = spoil(options[key], chance)
        notes.seek(0)
        notes.write(json.dumps([number, name]) + " " * 40)
        notes.flush()
        start = time.perf_counter()
        signal.setitimer(signal.ITIMER_REAL, MAX_SECONDS)
        try:
            answer = function(*arguments, **options)
            outcome = "answers"
            if name not in UNCHECKED and any(
                each.dtype.kind == "f" and np.isnan(each).any() for each in list_numbers(answer)
            ):
                outcome = "NaN in the answer"
        except TimeoutError:
            asked = [*arguments, *options.values()]
            endless = name in ITERATIVE and any(
                isinstance(each, int) and each > MANY_ITERATIONS for each in asked
            )
            outcome = "as long as asked" if endless else "takes too long"
        except expected as error:
            outcome = type(error).__name__
            if "internal error" in str(error):
                outcome = str(error)
        except BaseException as error:
            outcome = f"{type(error).__name__}: {error}"
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        outcomes[outcome] += 1
        known = {"answers", "as long as asked", "NotEnoughDataError", "NoRopeError"}
        if outcome not in known | {kind.__name__ for kind in expected}:
            taken = round(time.perf_counter() - start, 1)
            print(json.dumps([number, name, outcome[:300], taken]), file=sys.stderr, flush=True)
    print(json.dumps(["outcomes", outcomes, first + calls - 1]), file=sys.stderr, flush=True)


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--calls", type=int, default=20_000, metavar="N", help="how many (default: 20000)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="the first call's seed (default: 0)")
    parser.add_argument(
        "--only", nargs="*", default=[], metavar="NAME", choices=sorted(CALLS), help="call only these"
    )
    parser.add_argument("--within", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.within:
        make_calls(arguments.seed, arguments.calls, arguments.only)
        return 0
    seed, last = arguments.seed, arguments.seed + arguments.calls
    findings, outcomes = [], Counter()
    at = Path(f"attack.{arguments.seed}.at")
    while seed < last:
        calls = min(last - seed, CALLS_AT_ONCE)
        command = [sys.executable, __file__, "--within", "--seed", str(seed), "--calls", str(calls)]
        command += ["--only", *arguments.only] if arguments.only else []
        with at.open("w+") as notes:
            done = subprocess.run(command, stdout=notes, stderr=subprocess.PIPE, text=True, check=False)
            notes.seek(0)
            place = json.loads(notes.read().strip() or f'[{seed}, "start"]')
        for line in done.stderr.splitlines():
            try:
                found = json.loads(line)
            except ValueError:
                continue
            if found[0] == "outcomes":
                outcomes.update(found[1])
                place = [found[2], "end"]
            else:
                findings.append(found)
                print(*found, flush=True)
        if done.returncode:
            findings.append([*place, f"ends the process with {done.returncode}"])
            print(*findings[-1], done.stderr[-300:], flush=True)
        seed = place[0] + 1
    at.unlink()
    print(f"{arguments.calls} calls, {len(findings)} findings; {dict(outcomes)}")
    return 1 if findings else 0


if __name__ == "__main__":
    run_bench(main)
