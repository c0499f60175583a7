"""Reconstruct fresh random scenes and say how often the answer is right, and how often it is sure and wrong.

python benches/fresh.py [--scenes N] [--first SEED] [--noise KIND] [--relative LOW HIGH] [--out DIR]

Scene k is drawn from the seed k: 0 to 8 crossings, 1 to 3 ropes (or one of the shapes with crossings, knots
among them), a radius of 2 to 10 mm. Noise is of these kinds:

- plain: normal and independent, 0.05 to 1 radii; 1 to 7 views, a camera of 320 x 240 to 1280 x 720 pixels
  (the finest with one or two views);
- small: as plain, but 0.3 to 1.5 mm whatever the radius;
- correlated: one or three masked views of 640 x 480 pixels through an imitated camera, whose errors are 0.5
  to 2 times as far correlated as its own and 0.05 to 1 radii on a surface, to which those at edges add; ropes
  of at most 3 to 8 pixels' radius.

The radius is given, the number of ropes is not. `--out` gets one line of JSON for each scene; scenes that
have their line there are not done again. It also gets fresh.png, of the scenes that were asked for, and
curves.png, of all that have their line there.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from lib.judging import SURE, judge_scene
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.synthetic import (
    CAMERAS,
    Camera,
    DepthCamera,
    Layout,
    Noise,
    Segmentation,
    SyntheticScene,
    random_ropes,
    scene,
)
from strand.synthetic.camera import FOCAL_LENGTH

SHAPES = ("loop", "figure8", "overhand", "paper", "coil")
SIZES = ((320, 240), (640, 480), (1280, 720))
KINDS = ("plain", "correlated")
RELATIVE = (0.05, 1.0)  # radii, the noise
FINE = (0.0, 0.1, 0.2, 0.4, 0.6, 0.8, 1.01)
CORRELATIONS = (0.1, 1.0, 2.0, 4.0, 8.0, 16.0)
# kind, what the curve goes over, its steps, and how it is called
CURVES = (
    ("plain", "relative", FINE, "plain noise / r"),
    ("correlated", "relative", FINE, "noise of imitated cameras / r"),
    ("correlated", "correlation", CORRELATIONS, "its correlation length, px"),
)
FEWEST = 5  # scenes of a place of a curve


def draw(
    seed: int, noise: str = "both", relative: tuple[float, float] = RELATIVE
) -> tuple[SyntheticScene, dict[str, Any]]:
    """Return the scene of a seed with noise of a kind and a range in radii, and what was drawn for it."""
    rng = np.random.default_rng(seed)
    radius = float(np.exp(rng.uniform(math.log(2e-3), math.log(10e-3))))
    if noise == "small":
        kind, error = "plain", float(rng.uniform(0.3e-3, 1.5e-3))
    else:
        kind, error = KINDS[int(rng.integers(2))], float(rng.uniform(*relative)) * radius
        kind = kind if noise == "both" else noise
    drawn = {"radius": radius, "noise": error, "seed": seed}
    drawn |= {"kind": kind, "relative": error / radius, "correlation": 0.0}
    common: dict[str, Any] = {"radius": radius, "noise": Noise(depth=error), "seed": seed}
    if kind == "plain":
        views = int(rng.choice([1, 2, 3, 5, 7]))
        size = SIZES[int(rng.choice(3, p=[0.7, 0.22, 0.08]))]
        if size == SIZES[-1]:
            views = min(views, 2)
        common["camera"] = Camera(size=size)
    else:
        name, stretch = (
            str(rng.choice(list(CAMERAS))),
            float(np.exp(rng.uniform(math.log(0.5), math.log(2.0)))),
        )
        device = _stretched(CAMERAS[name], stretch)
        views, size = int(rng.choice([1, 3])), SIZES[1]
        common["camera"] = Camera(device, size=size)
        common["mask"] = Segmentation(grow=int(rng.integers(-1, 2)))
        common["layout"] = Layout(distance=FOCAL_LENGTH * size[0] * radius / float(rng.uniform(3.0, 8.0)))
        drawn |= {"camera": name, "correlation": device.correlation_length}
    common["views"] = views
    drawn |= {"views": views, "size": size}
    ropes, crossings = int(rng.choice([1, 2, 3], p=[0.5, 0.3, 0.2])), int(rng.integers(0, 9))
    drawn |= {"ropes": ropes, "crossings": crossings}
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


def _stretched(camera: DepthCamera, stretch: float) -> DepthCamera:
    """Return the camera with errors that are so many times as far correlated, and as wide a window."""
    grain = tuple((stretch * smoothness, share) for smoothness, share in camera.grain)
    return dataclasses.replace(camera, grain=grain, window=stretch * camera.window)


def judge(seed: int, noise: str, relative: tuple[float, float]) -> dict[str, Any]:
    """Reconstruct one scene and compare with the truth."""
    synthetic, record = draw(seed, noise, relative)
    found, _ = judge_scene(synthetic, tell_radius=True, tell_ropes=False)
    record |= {"right": found.right, "confidence": found.confidence, "found": found.found}
    record |= {"error": found.error} if found.error else {"rms": found.rms, "frechet": found.frechet}
    return {**record, "seconds": found.seconds, "asked": [noise, *relative]}


def rates(records: Sequence[dict[str, Any]]) -> list[tuple[str, str, int, float, float, float]]:
    """Rows of what, which, how many, share right, share sure of those right, share sure and wrong."""
    relative_edges = (0.0, 0.1, 0.2, 0.4, 1.01)
    noise_edges = (0.0, 0.3e-3, 0.7e-3, 1.1e-3, 1.5e-3, 3e-3, 6e-3, 11e-3)
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
        groups += [(f"{kind}, noise / r", *group) for group in between("relative", FINE, of_kind)]
        for views in (1, 3):
            seen = [r for r in of_kind if r["views"] == views]
            title = f"{kind}, noise / r, {views} view{'s' * (views > 1)}"
            groups += [(title, *group) for group in between("relative", FINE, seen)]
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


def plot(rows: Sequence[tuple[str, str, int, float, float, float]], path: Path) -> None:
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


def curves(records: Sequence[dict[str, Any]], path: Path) -> None:
    """Plot how many are right over noise and correlation, for one view and three."""
    figure = Figure(figsize=(10, 2.8), layout="constrained")
    axes = figure.subplots(1, len(CURVES), sharey=True)
    for axis, (kind, key, edges, label) in zip(axes, CURVES, strict=True):
        for views, colour in ((1, "#4c78a8"), (3, "#f58518")):
            seen = [r for r in records if r["kind"] == kind and r["views"] == views]
            groups = [[r for r in seen if low <= r[key] < high] for low, high in pairwise(edges)]
            shown = [group for group in groups if len(group) >= FEWEST]
            at = [float(np.mean([r[key] for r in group])) for group in shown]
            right = [float(np.mean([r["right"] for r in group])) for group in shown]
            # a standard deviation of a share, of one scene more of each kind
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
        help="of which kind (default: plain or correlated)",
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
        records.append(judge(seed, arguments.noise, relative))
        if lines is not None:
            lines.parent.mkdir(parents=True, exist_ok=True)
            with lines.open("a") as file:
                file.write(json.dumps(records[-1]) + "\n")
    print_head("", "", "scenes", "right %", f"confidence ≥ {SURE} %", "sure and wrong %")
    rows = rates(records)
    for what, which, count, *shares in rows:
        print_row(what, which, count, *(f"{100 * share:.1f}" for share in shares))
    if lines is not None:
        plot(rows, lines.with_name("fresh.png"))
        every = [json.loads(line) for line in lines.read_text().splitlines()]
        curves(every, lines.with_name("curves.png"))
    return 0


if __name__ == "__main__":
    run_bench(main)
