"""Reconstruct random scenes, and count the answers that are right, and those that are sure and wrong.

python benches/fresh.py [--scenes N] [--first SEED] [--noise KIND] [--relative LOW HIGH] [--out DIR]

Scene k has the seed k: 0 to 8 crossings, 1 to 3 ropes or one of the shapes with crossings, knots among them,
and a radius of 2 to 10 mm. The kinds of noise are:

- plain: normal and independent, 0.05 to 1 radii; 1 to 7 views of 320 x 240 to 1280 x 720 pixels,
- small: as plain, but 0.3 to 1.5 mm for any radius,
- correlated: one or three masked views of 640 x 480 pixels through an imitated camera. The errors reach 0.5
  to 2 times as far as the camera's own, and have 0.05 to 1 radii on a surface. Ropes have a radius of at most
  3 to 8 pixels.

The radius is given, the number of ropes is not. `--out` gets a line of JSON for each scene, and the bench
skips scenes that have their line. It also gets fresh.png of the scenes of this run, and curves.png of all
scenes in the file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from lib.judging import SURE, judge_scene
from lib.random_scenes import KINDS, RELATIVE, draw_scene
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row

NOISES = (0.0, 0.1, 0.2, 0.4, 0.6, 0.8, 1.01)  # radii: steps of curves
CORRELATIONS = (0.1, 1.0, 2.0, 4.0, 8.0, 16.0)  # pixels: steps of curves
# kind of noise, the quantity of the curve, its steps and its name
CURVES = (
    ("plain", "relative", NOISES, "plain noise / r"),
    ("correlated", "relative", NOISES, "noise of imitated cameras / r"),
    ("correlated", "correlation", CORRELATIONS, "its correlation length, px"),
)
MIN_SCENES = 5  # of a place of a curve


def judge_seed(seed: int, noise: str, relative: tuple[float, float]) -> dict[str, Any]:
    """Reconstruct the scene of a seed, and compare the answer with the truth."""
    synthetic, record = draw_scene(seed, noise, relative)
    found, _ = judge_scene(synthetic, give_radius=True, give_ropes=False)
    record |= {"right": found.right, "confidence": found.confidence, "found": found.found}
    record |= {"error": found.error} if found.error else {"rms": found.rms, "frechet": found.frechet}
    return {**record, "seconds": found.seconds, "asked": [noise, *relative]}


def compute_rates(records: Sequence[dict[str, Any]]) -> list[tuple[str, str, int, float, float, float]]:
    """Return rows: quantity, value, number of scenes, shares that are right, sure, and sure and wrong."""
    relative_edges = (0.0, 0.1, 0.2, 0.4, 1.01)  # radii
    noise_edges = (0.0, 0.3e-3, 0.7e-3, 1.1e-3, 1.5e-3, 3e-3, 6e-3, 11e-3)  # metres
    confidence_edges = (0.0, 0.1, 0.5, 0.8, SURE, 1.01)

    def each(key: str, group: Sequence[dict[str, Any]]) -> list[tuple[str, list[dict[str, Any]]]]:
        return [(str(n), [r for r in group if r[key] == n]) for n in sorted({r[key] for r in group})]

    def between(
        key: str, edges: Sequence[float], group: Sequence[dict[str, Any]], unit: float = 1.0
    ) -> list[tuple[str, list[dict[str, Any]]]]:
        return [
            (f"{low / unit:.1f}-{high / unit:.1f}", [r for r in group if low <= r[key] < high])
            for low, high in pairwise(edges)
        ]

    groups = [("all", "", list(records))]
    groups += [("noise", *group) for group in each("kind", records)]
    for key in ("crossings", "ropes", "views"):
        groups += [(key, *group) for group in each(key, records)]
    groups += [("noise mm", *group) for group in between("noise", noise_edges, records, 1e-3)]
    groups += [("noise / r", *group) for group in between("relative", relative_edges, records)]
    groups += [("confidence", *group) for group in between("confidence", confidence_edges, records)]
    for kind in KINDS:
        of_kind = [r for r in records if r["kind"] == kind]
        groups += [(f"{kind}, views", *group) for group in each("views", of_kind)]
        groups += [(f"{kind}, noise / r", *group) for group in between("relative", NOISES, of_kind)]
        for views in (1, 3):
            seen = [r for r in of_kind if r["views"] == views]
            title = f"{kind}, noise / r, {views} view{'s' * (views > 1)}"
            groups += [(title, *group) for group in between("relative", NOISES, seen)]
    correlated = [r for r in records if r["kind"] == "correlated"]
    for title, views in (
        ("correlation px", (1, 3)),
        ("correlation px, 1 view", (1,)),
        ("correlation px, 3 views", (3,)),
    ):
        seen = [r for r in correlated if r["views"] in views]
        groups += [(title, *group) for group in between("correlation", CORRELATIONS, seen)]
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


def plot_rates(rows: Sequence[tuple[str, str, int, float, float, float]], path: Path) -> None:
    """Draw the shares over crossings, views, noise and correlation."""
    kinds = ["crossings", "views", "plain, noise / r", "correlated, noise / r", "correlation px"]
    figure = Figure(figsize=(14, 3), layout="constrained")
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


def plot_curves(records: Sequence[dict[str, Any]], path: Path) -> None:
    """Draw the share of right answers over noise and correlation, for one view and three."""
    figure = Figure(figsize=(10, 2.8), layout="constrained")
    axes = figure.subplots(1, len(CURVES), sharey=True)
    for axis, (kind, key, edges, label) in zip(axes, CURVES, strict=True):
        for views, colour in ((1, "#4c78a8"), (3, "#f58518")):
            seen = [r for r in records if r["kind"] == kind and r["views"] == views]
            groups = [[r for r in seen if low <= r[key] < high] for low, high in pairwise(edges)]
            shown = [group for group in groups if len(group) >= MIN_SCENES]
            at = [float(np.mean([r[key] for r in group])) for group in shown]
            right = [float(np.mean([r["right"] for r in group])) for group in shown]
            # standard deviation of a share, with one more scene of each outcome
            sd = [
                math.sqrt((n * p + 1) * (n * (1 - p) + 1) / (n + 2) ** 2 / (n + 3))
                for n, p in zip(map(len, shown), right, strict=True)
            ]
            name = f"{views} view{'s' * (views > 1)}"
            axis.errorbar(
                at,
                [100 * p for p in right],
                [100 * s for s in sd],
                color=colour,
                marker="o",
                capsize=2,
                label=name,
            )
        axis.set_xlabel(label)
        axis.set_ylim(0, 105)
        axis.set_xlim(0, 1)
    axes[-1].set_xscale("log")
    axes[-1].set_xlim(0.3, 12)
    ticks = [1, 2, 4, 8]
    axes[-1].set_xticks(ticks, [str(tick) for tick in ticks], minor=False)
    axes[-1].minorticks_off()
    axes[0].set_ylabel("% of scenes right")
    drawn = [axis for axis in axes if axis.get_legend_handles_labels()[0]]
    if drawn:
        drawn[0].legend(fontsize=7, loc="lower left")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", type=int, default=500, metavar="N", help="how many (default: 500)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="write fresh.png, curves.png and fresh.jsonl here"
    )
    parser.add_argument(
        "--noise",
        choices=("both", "small", *KINDS),
        default="both",
        help="its kind (default: plain or correlated)",
    )
    parser.add_argument(
        "--relative",
        type=float,
        nargs=2,
        default=RELATIVE,
        metavar=("LOW", "HIGH"),
        help="range of plain and correlated noise, radii (default: 0.05 1)",
    )
    arguments = parser.parse_args()
    relative = tuple(arguments.relative)
    if not 0 <= relative[0] <= relative[1]:
        parser.error("--relative: expected 0 <= LOW <= HIGH")
    asked = [arguments.noise, *relative]
    records = []
    lines = arguments.out / "fresh.jsonl" if arguments.out else None
    done = {}
    if lines is not None and lines.exists():
        known = map(json.loads, lines.read_text().splitlines())
        done = {record["seed"]: record for record in known if record.get("asked") == asked}
    for seed in range(arguments.first, arguments.first + arguments.scenes):
        if seed in done:
            records.append(done[seed])
            continue
        records.append(judge_seed(seed, arguments.noise, relative))
        if lines is not None:
            lines.parent.mkdir(parents=True, exist_ok=True)
            with lines.open("a") as file:
                file.write(json.dumps(records[-1]) + "\n")
    print_head("", "", "scenes", "right %", f"confidence ≥ {SURE} %", "sure and wrong %")
    rows = compute_rates(records)
    for what, which, count, *shares in rows:
        print_row(what, which, count, *(f"{100 * share:.1f}" for share in shares))
    if lines is not None:
        plot_rates(rows, lines.with_name("fresh.png"))
        every = [json.loads(line) for line in lines.read_text().splitlines()]
        plot_curves(every, lines.with_name("curves.png"))
    return 0


if __name__ == "__main__":
    run_bench(main)
