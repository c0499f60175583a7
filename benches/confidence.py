"""Compare the confidence of answers with the truth, and fit its weights to scenes of all kinds.

python benches/confidence.py --out DIR [--scenes N] [--first SEED] [--fit] [--picture FILE]

Scene k has the seed k. The kinds of benches/lib/asked_scenes.py take turns. The caller's hints are drawn at
random: radius, number and lengths of ropes, bounds, masks, colours. An answer is right if there are as many
chains as ropes, and each is within 3 radii of its rope, from end to end in order. A crossing is right if it
exists, with the same strand on top. No answer after 20 s of processor time counts as none.

`--out` gets confidence.jsonl, a line for each scene, and the bench skips scenes that have their line. `--fit`
fits the weights to one half of the seeds, and writes them to the package with a digest of the records. The
tables are about the other half, and about each kind with weights that were fitted to the others.
`--picture` draws reliability diagrams, and errors over coverage.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lib.asked_scenes import KINDS
from lib.judging import SURE
from lib.posterior_fit import Example, fit_posterior
from lib.records import record_answer
from lib.reliability import (
    draw_reliability,
    find_threshold,
    measure_area,
    measure_calibration_error,
    share_sure_and_wrong,
)
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.ropes.order import add_confidence, bound_order
from strand.ropes.posterior import PATH, Posterior

ALLOWED = (0.01, 0.001)  # shares of wrong answers that may pass a threshold
STEPS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97, 1.0001)  # of the table by confidence
CROSSING_BINS = 7  # of the table of crossings

Record = dict[str, Any]
Fit = dict[str, Posterior]
Said = tuple[NDArray[np.float64], NDArray[np.bool_]]
"""Probabilities, and what was right."""


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", type=int, default=5000, metavar="N", help="how many (default: 5000)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="keep confidence.jsonl here")
    parser.add_argument("--fit", action="store_true", help="write the weights into the package")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw reliability diagrams")
    arguments = parser.parse_args()
    if arguments.scenes < 1:
        parser.error("--scenes: expected at least 1")
    seeds = range(arguments.first, arguments.first + arguments.scenes)
    every = collect(seeds, arguments.out / "confidence.jsonl")
    records = [record for record in every if "error" not in record]
    fitted, held = split(records)
    fit = fit_all(fitted)
    if arguments.fit:
        write_fit(fit, fitted)
    print(f"{len(records)} answers, {len(fitted)} fitted, {len(held)} held out\n")
    said, right = say(held, lambda _: fit)
    print_kinds("held out", held, (said, right))
    print()
    print_steps("confidence", STEPS, (said, right))
    print()
    print_thresholds((said, right))
    others = {kind: fit_all([one for one in records if one["kind"] != kind]) for kind in KINDS}
    print()
    left_out = say(records, lambda one: others[one["kind"]])
    print_kinds("kind left out", records, left_out)
    print()
    crossings = say_crossings(held, fit)
    print_steps("crossings", np.linspace(0.0, 1.0, CROSSING_BINS + 1).round(3), crossings)
    print(f"\n{len(crossings[0])} crossings, ECE {measure_calibration_error(*crossings, CROSSING_BINS):.3f}")
    chains = say_chains(held, fit)
    print(f"{len(chains[0])} chains, ECE {measure_calibration_error(*chains):.3f}")
    if arguments.picture:
        groups = {"answers": (said, right), "kinds left out": left_out, "crossings": crossings}
        kind_of = np.array([one["kind"] for one in held])
        kinds = {str(kind): (said[kind_of == kind], right[kind_of == kind]) for kind in np.unique(kind_of)}
        draw_reliability(groups, kinds, arguments.picture)
    return 0


def collect(seeds: range, path: Path) -> list[Record]:
    """Return the records of seeds, from a file as far as it has them; append the others to it."""
    done: dict[int, Record] = {}
    if path.exists():
        done = {one["seed"]: one for one in map(json.loads, path.read_text().splitlines())}
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a") as file, ProcessPoolExecutor() as pool:
        for record in pool.map(record_answer, [seed for seed in seeds if seed not in done], chunksize=4):
            done[record["seed"]] = record
            file.write(json.dumps(record) + "\n")
            file.flush()
    return [done[seed] for seed in seeds]


def split(records: Sequence[Record]) -> tuple[list[Record], list[Record]]:
    """Return the records to fit, and those that are held out: every other round of kinds."""
    parts: tuple[list[Record], list[Record]] = ([], [])
    for one in records:
        parts[one["seed"] // len(KINDS) % 2].append(one)
    return parts


def make_examples(records: Sequence[Record]) -> list[Example]:
    """Return the answers as examples."""
    examples = []
    for one in records:
        alternatives = one["alternatives"]
        right = 0 if one["right"] else next((k for k, (_, so) in enumerate(alternatives, 1) if so), None)
        examples.append(Example(one["evidence"], [cost for cost, _ in alternatives], right, one["bound"]))
    return examples


def make_chain_examples(records: Sequence[Record]) -> list[Example]:
    """Return the chains as examples."""
    return [
        Example(chain["evidence"], (), 0 if chain["right"] else None, chain["bound"])
        for one in records
        for chain in one["chains"]
    ]


def make_crossing_examples(records: Sequence[Record], confidence: NDArray[np.float64]) -> list[Example]:
    """Return the crossings as examples, with the confidence of their answers."""
    return [
        Example(
            add_confidence(crossing["evidence"], float(sure)),
            (),
            0 if crossing["right"] else None,
            float(bound_order(crossing["evidence"])),
        )
        for one, sure in zip(records, confidence, strict=True)
        for crossing in one["crossings"]
    ]


def fit_all(records: Sequence[Record]) -> Fit:
    """Fit the weights of answers, of chains and of crossings."""
    fit = {"answers": fit_posterior(make_examples(records))}
    confidence, _ = say(records, lambda _: fit)
    return {
        **fit,
        "chains": fit_posterior(make_chain_examples(records)),
        "crossings": fit_posterior(make_crossing_examples(records, confidence)),
    }


def write_fit(fit: Fit, records: Sequence[Record]) -> None:
    """Write weights to the package, with the digest of the records that they were fitted to."""
    names = ("seed", "right", "evidence", "bound", "alternatives", "chains", "crossings")
    kept = [[one[name] for name in names] for one in records]
    digest = hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()
    table = {name: dataclasses.asdict(one) for name, one in fit.items()}
    made = {"made by": "benches/confidence.py", "answers": len(records), "digest": digest, **table}
    PATH.write_text(json.dumps(made, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def say(records: Sequence[Record], choose: Callable[[Record], Fit]) -> Said:
    """Return the confidence of each answer, by weights that are chosen for it."""
    said = [
        choose(one)["answers"].compute(example.evidence, example.bound, example.costs)[0]
        for one, example in zip(records, make_examples(records), strict=True)
    ]
    return np.array(said), np.array([one["right"] for one in records])


def say_crossings(records: Sequence[Record], fit: Fit) -> Said:
    """Return the probability of each crossing."""
    confidence, _ = say(records, lambda _: fit)
    return say_examples(fit["crossings"], make_crossing_examples(records, confidence))


def say_chains(records: Sequence[Record], fit: Fit) -> Said:
    """Return the confidence of each chain."""
    return say_examples(fit["chains"], make_chain_examples(records))


def say_examples(posterior: Posterior, examples: Sequence[Example]) -> Said:
    """Return the probability of each example, and which are right."""
    said = np.array([posterior.compute(example.evidence, example.bound)[0] for example in examples])
    return said, np.array([example.right == 0 for example in examples])


def print_kinds(title: str, records: Sequence[Record], every: Said) -> None:
    """Print a row for each kind, and one for all."""
    print_head(title, "answers", "right %", "ECE", "area", "coverage % at 1 % wrong", "sure %", "and wrong %")
    kinds = np.array([one["kind"] for one in records])
    for kind in (*KINDS, "all"):
        here = np.full(len(kinds), True) if kind == "all" else kinds == kind
        if here.any():
            said, right = every[0][here], every[1][here]
            print_row(
                kind,
                len(said),
                f"{100 * right.mean():.1f}",
                f"{measure_calibration_error(said, right):.3f}",
                f"{measure_area(said, right):.3f}",
                f"{100 * find_threshold(said, right, ALLOWED[0])[1]:.0f}",
                f"{100 * (said >= SURE).mean():.0f}",
                f"{100 * share_sure_and_wrong(said, right):.2f}",
            )


def print_steps(title: str, steps: Sequence[float], every: Said) -> None:
    """Print how many are right by their probability."""
    said, right = every
    print_head(title, "answers", "said %", "right %")
    for low, high in pairwise(steps):
        here = (said >= low) & ((said < high) | (high >= 1.0))
        if here.any():
            name = f"{low:g} to {min(high, 1.0):g}"
            print_row(name, here.sum(), f"{100 * said[here].mean():.1f}", f"{100 * right[here].mean():.1f}")


def print_thresholds(every: Said) -> None:
    """Print the confidence above which few answers are wrong, and how many answers are above."""
    print_head("wrong answers allowed", "confidence of at least", "answers above %")
    for allowed in ALLOWED:
        threshold, coverage = find_threshold(*every, allowed)
        print_row(f"1 in {1 / allowed:.0f}", f"{threshold:.3f}", f"{100 * coverage:.0f}")


if __name__ == "__main__":
    run_bench(main)
