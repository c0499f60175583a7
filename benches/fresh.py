"""Reconstruct fresh random scenes and say how often the answer is right, and how often it is sure and wrong.

python benches/fresh.py [--scenes N] [--first SEED] [--out DIR]

Scene k is drawn from the seed k: 0 to 8 crossings, 1 to 3 ropes (or one of the shapes with crossings, knots
among them), a radius of 2 to 10 mm, 1 to 7 views, a camera of 320 x 240 to 1280 x 720 pixels (the finest with
one or two views), 0.3 to 1.5 mm of noise. The radius is given, the number of ropes is not. `--out` gets a
plot and one line of JSON for each scene; scenes that have their line there are not done again.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from measure import measured
from tables import head, row

import strand
from strand.synthetic import SyntheticScene, random_ropes, scene

SHAPES = ("loop", "figure8", "overhand", "paper", "coil")
SIZES = ((320, 240), (640, 480), (1280, 720))
SURE = 0.9


def draw(seed: int) -> tuple[SyntheticScene, dict[str, Any]]:
    """Return the scene of a seed, and what was drawn for it."""
    rng = np.random.default_rng(seed)
    radius = float(np.exp(rng.uniform(math.log(2e-3), math.log(10e-3))))
    noise = float(rng.uniform(0.3e-3, 1.5e-3))
    views = int(rng.choice([1, 2, 3, 5, 7]))
    size = SIZES[int(rng.choice(3, p=[0.7, 0.22, 0.08]))]
    if size == SIZES[-1]:
        views = min(views, 2)
    ropes, crossings = int(rng.choice([1, 2, 3], p=[0.5, 0.3, 0.2])), int(rng.integers(0, 9))
    common = {"radius": radius, "noise": noise, "views": views, "size": size, "seed": seed}
    drawn: dict[str, Any] = {**common, "ropes": ropes, "crossings": crossings}
    if rng.random() < 0.2:
        name = str(rng.choice(SHAPES))
        drawn |= {"ropes": 1, "shape": name}
        drawn["crossings"] = {"loop": 1, "figure8": 2, "overhand": 3, "paper": 3, "coil": 0}[name]
        return scene(name, **common), drawn
    while True:
        try:
            chains = random_ropes(crossings, ropes, radius, seed)
        except ValueError:
            # many crossings are hard to draw with few ropes
            ropes, crossings = min(ropes + 1, 3), crossings - (ropes == 3)
            drawn |= {"ropes": ropes, "crossings": crossings}
            continue
        return scene(chains=chains, **common), drawn


def judge(seed: int) -> dict[str, Any]:
    """Reconstruct one scene and compare with the truth."""
    synthetic, record = draw(seed)
    start = time.perf_counter()
    record |= {"seed": seed, "right": False, "confidence": 0.0, "found": 0}
    try:
        model = strand.reconstruct(synthetic.views, synthetic.radius, synthetic.bounds)
    except strand.StrandError as error:
        record["error"] = str(error)
    else:
        found = measured([chain.points for chain in model.chains], synthetic.truth, synthetic.radius)
        record |= {
            "right": found.right,
            "confidence": model.confidence,
            "found": len(model.chains),
            "rms": found.rms,
            "frechet": found.frechet,
        }
    record["seconds"] = time.perf_counter() - start
    return record


def rates(records: Sequence[dict[str, Any]]) -> list[tuple[str, str, int, float, float, float]]:
    """Rows of what, which, how many, share right, share sure of those right, share sure and wrong."""
    noise_edges, relative_edges = (0.3e-3, 0.7e-3, 1.1e-3, 1.5e-3), (0.0, 0.1, 0.2, 0.4, 1.0)
    confidence_edges = (0.0, 0.1, 0.5, 0.8, SURE, 1.0)

    def between(key: Callable[[dict[str, Any]], float], low: float, high: float) -> list[dict[str, Any]]:
        return [record for record in records if low <= key(record) < high]

    groups = [("all", "", list(records))]
    groups += [
        ("crossings", str(n), [r for r in records if r["crossings"] == n])
        for n in sorted({r["crossings"] for r in records})
    ]
    groups += [
        ("ropes", str(n), [r for r in records if r["ropes"] == n])
        for n in sorted({r["ropes"] for r in records})
    ]
    groups += [
        ("views", str(n), [r for r in records if r["views"] == n])
        for n in sorted({r["views"] for r in records})
    ]
    groups += [
        ("noise mm", f"{low * 1e3:.1f}-{high * 1e3:.1f}", between(lambda r: r["noise"], low, high))
        for low, high in pairwise(noise_edges)
    ]
    groups += [
        ("noise / r", f"{low:.1f}-{high:.1f}", between(lambda r: r["noise"] / r["radius"], low, high))
        for low, high in pairwise(relative_edges)
    ]
    groups += [
        ("confidence", f"{low:.1f}-{high:.1f}", between(lambda r: r["confidence"], low, high))
        for low, high in pairwise(confidence_edges)
    ]
    rows = []
    for what, which, group in groups:
        if group:
            right = [r for r in group if r["right"]]
            sure = [r for r in group if r["confidence"] >= SURE]
            wrong = [r for r in sure if not r["right"]]
            rows.append(
                (
                    what,
                    which,
                    len(group),
                    len(right) / len(group),
                    len(sure) / len(group),
                    len(wrong) / len(group),
                )
            )
    return rows


def plot(rows: Sequence[tuple[str, str, int, float, float, float]], path: Path) -> None:
    kinds = ["crossings", "views", "noise mm", "noise / r"]
    figure = Figure(figsize=(11, 3), layout="constrained")
    axes = figure.subplots(1, len(kinds), sharey=True)
    for axis, kind in zip(axes, kinds, strict=True):
        shown = [row for row in rows if row[0] == kind]
        at = np.arange(len(shown))
        axis.bar(at, [100 * row[3] for row in shown], color="#4c78a8", label="right")
        axis.plot(at, [100 * row[4] for row in shown], "o", color="#222222", label=f"confidence ≥ {SURE}")
        axis.plot(at, [100 * row[5] for row in shown], "x", color="#e45756", label="sure and wrong")
        axis.set_xticks(at, [row[1] for row in shown])
        axis.set_xlabel(kind)
    axes[0].set_ylabel("% of scenes")
    axes[0].legend(fontsize=7, loc="lower left")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=500, metavar="N", help="how many (default: 500)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write fresh.png and fresh.jsonl here")
    arguments = parser.parse_args()
    records = []
    lines = arguments.out / "fresh.jsonl" if arguments.out else None
    done = {}
    if lines is not None and lines.exists():
        done = {record["seed"]: record for record in map(json.loads, lines.read_text().splitlines())}
    for seed in range(arguments.first, arguments.first + arguments.scenes):
        if seed in done:
            records.append(done[seed])
            continue
        records.append(judge(seed))
        if lines is not None:
            lines.parent.mkdir(parents=True, exist_ok=True)
            with lines.open("a") as file:
                file.write(json.dumps(records[-1]) + "\n")
    print(head("", "", "scenes", "right %", f"confidence ≥ {SURE} %", "sure and wrong %"))
    rows = rates(records)
    for what, which, count, *shares in rows:
        print(row(what, which, count, *(f"{100 * share:.1f}" for share in shares)))
    if arguments.out:
        plot(rows, arguments.out / "fresh.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
