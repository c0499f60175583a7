"""Perturb random scenes in every known way, and count the answers that are sure and wrong.

python benches/severity.py [--scenes N] [--first SEED] [--only TEXT] [--out DIR]

Scene k has the seed k: 0 to 3 crossings, one or two ropes, a radius of 2.5 to 7 mm, 3, 5 or 7 views of 320 x
240 pixels, independent noise of 0.05 to 0.2 radii. Each kind of benches/lib/perturbations.py at each strength
changes N of them. The radius is given, the number of ropes is not, unless it is the perturbation. An answer
is right if its chains are within 3 radii of the ropes, in the world frame.

No answer after 8 s of processor time counts as none.

`--out` gets severity.jsonl, a line for each run, and severity.png. The bench skips runs that have their line.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import signal
import time
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import strand
from lib import pictures
from lib.judging import MAX_NEAR, SURE
from lib.measure import measure_chains
from lib.perturbations import FOREIGN, KINDS, Given, Kind
from lib.results import make_parser, run_bench
from lib.tables import format_head, format_row
from strand.synthetic import Noise, SyntheticScene, random_ropes, scene

MAX_SECONDS = 8  # of processor time for an answer


@functools.lru_cache(maxsize=1)
def draw_scene(seed: int, masked: bool) -> SyntheticScene:
    """Return the scene of a seed."""
    rng = np.random.default_rng(seed)
    radius = float(np.exp(rng.uniform(math.log(2.5e-3), math.log(7e-3))))
    ropes, crossings = int(rng.choice([1, 2], p=[0.75, 0.25])), int(rng.integers(0, 4))
    while True:
        try:
            chains = random_ropes(crossings, ropes, radius, seed)
            break
        except ValueError:
            crossings -= 1
    drawn = scene(
        chains=chains,
        radius=radius,
        seed=seed,
        noise=Noise(depth=float(rng.uniform(0.05, 0.2)) * radius),
        views=int(rng.choice([3, 5, 7], p=[0.6, 0.25, 0.15])),
        mask=strand.synthetic.Segmentation() if masked else None,
    )
    return dataclasses.replace(drawn, name=f"severity_{seed}")


def draw_other_scene(seed: int, views: int) -> SyntheticScene:
    """Return another scene, of other ropes, with as many views."""
    like = draw_scene.__wrapped__(seed + FOREIGN, False)
    return scene(chains=like.truth, radius=like.radius, seed=seed, noise=Noise(depth=like.noise), views=views)


def perturb_scene(seed: int, name: str, strength: float) -> Given:
    """Return the input of a perturbed scene."""
    kind = KINDS[name]
    right = draw_scene(seed, kind.masked)
    whole = Given.of(right, lambda: draw_other_scene(seed, len(right.depth)))
    chance = np.random.default_rng([seed, zlib.crc32(name.encode()), round(1e6 * abs(strength))])
    return kind.change(whole, strength, chance)


def judge_run(seed: int, name: str, strength: float) -> dict[str, Any]:
    """Reconstruct a perturbed scene, and compare the answer with the truth."""
    perturbed = perturb_scene(seed, name, strength)
    record = {"seed": seed, "kind": name, "strength": strength, "views": len(perturbed.depth)}
    start = time.process_time()
    signal.setitimer(signal.ITIMER_PROF, MAX_SECONDS)
    try:
        model = perturbed.reconstruct()
    except (strand.StrandError, TimeoutError) as error:
        return {**record, "right": False, "confidence": 0.0, "error": str(error)}
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    seconds = time.process_time() - start
    found = measure_chains(
        [chain.points for chain in model.chains], perturbed.scene.truth, perturbed.scene.radius
    )
    return {
        **record,
        "right": found.chains == found.ropes and found.frechet <= MAX_NEAR,
        "confidence": model.confidence,
        "frechet": found.frechet,
        "rms": found.rms,
        "doubts": [(doubt.kind, round(doubt.amount, 3)) for doubt in model.doubts],
        "seconds": seconds,
    }


def raise_timeout(*_: object) -> None:
    """End a reconstruction that takes too long, as a handler of signals."""
    raise TimeoutError(f"no answer after {MAX_SECONDS} s of processor time")


def count_shares(records: Sequence[dict[str, Any]]) -> tuple[int, int, int]:
    """Count the records that are right, sure, and sure and wrong."""
    sure = [r for r in records if r["confidence"] >= SURE]
    return sum(r["right"] for r in records), len(sure), sum(not r["right"] for r in sure)


def format_table(records: Sequence[dict[str, Any]]) -> str:
    """Return a table with a row for each kind and strength, and one for all."""
    lines = [
        format_head("perturbation", "strength", "scenes", "right", f"confidence ≥ {SURE}", "sure and wrong")
    ]
    for name, kind in KINDS.items():
        for strength in kind.strengths:
            some = [r for r in records if r["kind"] == name and r["strength"] == strength]
            if some:
                lines.append(
                    format_row(name, format_strength(kind, strength), len(some), *count_shares(some))
                )
    lines.append(format_row("all", "", len(records), *count_shares(records)))
    return "\n".join(lines)


def format_strength(kind: Kind, strength: float) -> str:
    """Return a strength with its unit."""
    if kind.unit == "m":
        return f"{strength * 1e3:.3g} mm"
    if kind.unit == "rad":
        return f"{math.degrees(strength):.2g}°"
    if kind.unit in ("", "of the width"):
        return f"{100 * strength:g} % {kind.unit}".strip()
    return f"{strength:g} {kind.unit}"


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", type=int, default=30, metavar="N", help="of each strength (default: 30)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument("--only", default="", metavar="TEXT", help="kinds whose name holds this text")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write severity.jsonl and .png here")
    arguments = parser.parse_args()
    if arguments.scenes < 1:
        parser.error("--scenes: expected at least 1")
    names = [name for name in KINDS if arguments.only in name]
    if not names:
        parser.error(f"--only: no kind whose name holds {arguments.only!r}")
    lines = arguments.out / "severity.jsonl" if arguments.out else None
    known = {}
    if lines is not None:
        lines.parent.mkdir(parents=True, exist_ok=True)
        if lines.exists():
            each = map(json.loads, lines.read_text().splitlines())
            known = {(r["seed"], r["kind"], r["strength"]): r for r in each}
    # scenes are small: one thread, so that several runs share a machine
    strand.set_num_threads(1)
    signal.signal(signal.SIGPROF, raise_timeout)
    records = []
    # kinds without masks first, so that a scene is drawn only twice
    names.sort(key=lambda name: KINDS[name].masked)
    for seed in range(arguments.first, arguments.first + arguments.scenes):
        for name in names:
            for strength in KINDS[name].strengths:
                done = known.get((seed, name, strength))
                if done is None:
                    done = judge_run(seed, name, strength)
                    if lines is not None:
                        with lines.open("a") as file:
                            file.write(json.dumps(done) + "\n")
                records.append(done)
    print(format_table(records))
    if arguments.out is not None:
        pictures.draw_severity(records, KINDS, format_strength, arguments.out / "severity.png")
    return 0


if __name__ == "__main__":
    run_bench(main)
