"""Reconstruct scenes, and compare the order at crossings with the probability that the model reports.

python benches/order.py [--scenes N] [--first SEED] [--noise KIND] [--relative LOW HIGH] [--out DIR]
python benches/order.py --collection [DIR] [--only TEXT]

Random scenes are those of benches/fresh.py with the same seeds. The bench compares a crossing of a model with
the true crossing of the same strands in the plan. A crossing is wrong if the other strand is on top there, or
if there is no such crossing. `--out` gets order.jsonl, one line for each scene, and order.png. The bench
skips scenes that have their line.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

import strand
from fresh import KINDS, RELATIVE, draw_scene
from lib import collection
from lib.measure import measure_chains
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.ropes.crossings import Crossing
from strand.synthetic import SyntheticScene

Array = NDArray[np.float64]

MAX_DISTANCE = 4.0  # radii in the plan, from a crossing to its true one
BESIDE = np.linspace(-8.0, 8.0, 17)  # radii along a strand: places that identify it
MAX_OFFSET = 1.5  # radii in the plan: mean distance of these places from the true strand
FAR = 1e3  # radii: not the same crossing
PROBABILITIES = (0.0, 0.25, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 1.0001)  # steps of the table
NOISES = (0.0, 0.1, 0.2, 0.4, 0.6, 0.8, 1.6)  # radii: steps of the table


@dataclass(frozen=True)
class Found:
    """A crossing of a model beside the truth.

    Attributes
    ----------
    probability : float
        The model's probability that the order is right.
    true : int or None
        The number of its true crossing; None if there is none.
    right : bool
        Whether it has a true crossing with the same strand on top.
    """

    probability: float
    true: int | None
    right: bool


def find_true_crossings(truth: Sequence[Array], radius: float) -> tuple[strand.Model, tuple[Crossing, ...]]:
    """Return the true ropes as a model, and their crossings seen from above."""
    ropes = strand.Model(tuple(strand.Chain(nodes, radius) for nodes in truth), np.eye(4)[None])
    return ropes, ropes.crossings()


def compare_crossings(
    chains: Sequence[strand.Chain],
    crossings: Sequence[Crossing],
    truth: Sequence[Array],
    radius: float,
) -> list[Found]:
    """Return for each crossing whether it is a true one, and whether its order is right.

    Places in the plan, up to 8 radii from the crossing, identify a strand. Heights play no part.

    Parameters
    ----------
    chains : sequence of Chain
    crossings : sequence of Crossing
        Of the chains, seen from above.
    truth : sequence of (N, 3) ndarray
        The ropes' centrelines, metres.
    radius : float
        The ropes' radius, metres.
    """
    ropes, true = find_true_crossings(truth, radius)
    away = np.full((len(crossings), len(true)), FAR)
    right = np.zeros(away.shape, dtype=bool)
    for i, crossing in enumerate(crossings):
        upper, lower = (_places_beside(chains, at, radius) for at in (crossing.over, crossing.under))
        for k, other in enumerate(true):
            if np.linalg.norm((other.place - crossing.place)[:2]) > MAX_DISTANCE * radius:
                continue
            over, under = (_places_beside(ropes.chains, at, radius, 4) for at in (other.over, other.under))
            same = max(_mean_distance(upper, over), _mean_distance(lower, under))
            turned = max(_mean_distance(upper, under), _mean_distance(lower, over))
            if min(same, turned) <= MAX_OFFSET * radius:
                away[i, k], right[i, k] = min(same, turned) / radius, same < turned
    found = [Found(crossing.probability, None, False) for crossing in crossings]
    # no true crossing is found twice
    for i, k in zip(*linear_sum_assignment(away), strict=True):
        if away[i, k] < FAR:
            found[i] = Found(crossings[i].probability, int(k), bool(right[i, k]))
    return found


def _places_beside(
    chains: Sequence[strand.Chain], at: tuple[int, float], radius: float, finer: int = 1
) -> Array:
    """Return (N, 2) places of a strand in the plan around a crossing; finer ones reach farther."""
    chain, s = chains[at[0]], at[1]
    places = BESIDE if finer == 1 else np.linspace(1.5 * BESIDE[0], 1.5 * BESIDE[-1], 25 * finer)
    return np.asarray(chain.at(s + radius * places)[:, :2])


def _mean_distance(places: Array, line: Array) -> float:
    """Return the mean distance of places from a line's places."""
    return float(np.linalg.norm(places[:, None] - line, axis=2).min(axis=1).mean())


def judge_scene(synthetic: SyntheticScene) -> dict[str, Any]:
    """Reconstruct a scene, and compare its crossings with the true ones.

    Returns
    -------
    dict
        `scene`, `noise` over the radius, `right` (the topology), `true` (number of true crossings), and
        `crossings` with the fields of `Found`.
    """
    chains: Sequence[strand.Chain] = ()
    found: list[Found] = []
    try:
        model = strand.reconstruct(synthetic.views, synthetic.radius, synthetic.bounds)
    except strand.StrandError:
        pass
    else:
        chains = model.chains
        found = compare_crossings(chains, model.crossings(), synthetic.truth, synthetic.radius)
    measure = measure_chains([chain.points for chain in chains], synthetic.truth, synthetic.radius)
    return {
        "scene": synthetic.name,
        "noise": synthetic.noise / synthetic.radius,
        "right": measure.right,
        "true": len(find_true_crossings(synthetic.truth, synthetic.radius)[1]),
        "crossings": [asdict(one) for one in found],
    }


def group_by_probability(records: Iterable[dict[str, Any]]) -> list[tuple[float, float, int, float, float]]:
    """Return rows: probability from and to, number of crossings, mean probability, share right."""
    every = [(one["probability"], one["right"]) for record in records for one in record["crossings"]]
    said, right = (np.array(column, dtype=float) for column in zip(*every, strict=True))
    rows = []
    for low, high in pairwise(PROBABILITIES):
        some = (said >= low) & (said < high)
        if some.any():
            rows.append(
                (low, min(high, 1.0), int(some.sum()), float(said[some].mean()), float(right[some].mean()))
            )
    return rows


def group_by_noise(records: Sequence[dict[str, Any]]) -> list[tuple[str, int, int, int, int, int]]:
    """Return rows: noise, scenes, those with the right topology, their crossings, right ones, reversed ones.

    strand did not find the other crossings.
    """
    rows = []
    for low, high in [(0.0, np.inf), *pairwise(NOISES)]:
        group = [record for record in records if low <= record["noise"] < high]
        if group:
            good = [record for record in group if record["right"]]
            right = sum(len({one["true"] for one in record["crossings"] if one["right"]}) for record in good)
            turned = sum(
                one["true"] is not None and not one["right"] for record in good for one in record["crossings"]
            )
            true = sum(record["true"] for record in good)
            name = "all" if high - low == np.inf else f"{low:.1f}-{high:.1f}"
            rows.append((name, len(group), len(good), true, right, turned))
    return rows


def plot_probabilities(rows: Sequence[tuple[float, float, int, float, float]], path: Path) -> None:
    """Draw the share of right orders over the reported probability, both on logarithmic axes."""
    figure = Figure(figsize=(4.2, 3.6), layout="constrained")
    axis = figure.subplots()
    said = np.array([row[3] for row in rows])
    # with one more crossing of each outcome, so that few crossings give no share of 0
    wrong = np.array([(row[2] * (1 - row[4]) + 1) / (row[2] + 2) for row in rows])
    sd = np.sqrt(wrong * (1 - wrong) / np.array([row[2] + 3 for row in rows]))
    axis.plot([1e-3, 0.5], [1e-3, 0.5], color="#999999", linewidth=1)
    axis.errorbar(1 - said, wrong, np.minimum(sd, 0.9 * wrong), fmt="o", color="#4c78a8", capsize=2)
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xlim(1, 5e-4)
    axis.set_ylim(1, 5e-4)
    ticks = [0.5, 0.1, 0.01, 0.001]
    names = ["50", "90", "99", "99.9"]
    for one in (axis.xaxis, axis.yaxis):
        one.set_ticks(ticks, names)
        one.set_tick_params(which="minor", length=0)
    axis.set_xlabel("reported probability, %")
    axis.set_ylabel("order right, % of crossings")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def judge_fresh(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Judge random scenes, but for those that have their line."""
    asked = [arguments.noise, *arguments.relative]
    lines = arguments.out / "order.jsonl" if arguments.out else None
    done = {}
    if lines is not None and lines.exists():
        known = map(json.loads, lines.read_text().splitlines())
        done = {record["seed"]: record for record in known if record["asked"] == asked}
    records = []
    for seed in range(arguments.first, arguments.first + arguments.scenes):
        if seed not in done:
            synthetic, drawn = draw_scene(seed, arguments.noise, tuple(arguments.relative))
            done[seed] = {"seed": seed, "asked": asked, **judge_scene(synthetic), "noise": drawn["relative"]}
            if lines is not None:
                lines.parent.mkdir(parents=True, exist_ok=True)
                with lines.open("a") as file:
                    file.write(json.dumps(done[seed]) + "\n")
        records.append(done[seed])
    return records


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", type=int, default=500, metavar="N", help="how many (default: 500)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write order.jsonl and order.png here")
    parser.add_argument("--noise", choices=("both", "small", *KINDS), default="both", help="of the scenes")
    parser.add_argument(
        "--relative",
        type=float,
        nargs=2,
        default=RELATIVE,
        metavar=("LOW", "HIGH"),
        help="range of the noise, radii (default: 0.05 1)",
    )
    parser.add_argument("--collection", action="store_true", help="take scenes of the collection")
    collection.add_arguments(parser)
    arguments = parser.parse_args()
    if arguments.collection:
        records = []
        print_head("scene", "topology", "true crossings", "found", "order right", "least probability")
        for synthetic in collection.choose_scenes(arguments):
            records.append(judge_scene(synthetic))
            found = records[-1]["crossings"]
            print_row(
                records[-1]["scene"],
                "right" if records[-1]["right"] else "wrong",
                records[-1]["true"],
                len(found),
                sum(one["right"] for one in found),
                f"{min((one['probability'] for one in found), default=float('nan')):.4f}",
            )
        print()
    else:
        records = judge_fresh(arguments)
    print_head("noise / r", "scenes", "topology right", "their crossings", "order right", "reversed")
    for counts in group_by_noise(records):
        print_row(*counts)
    print()
    rows = group_by_probability(records)
    print_head("probability", "crossings", "reported %", "right %")
    for low, high, count, said, right in rows:
        print_row(f"{low:g}-{high:g}", count, f"{100 * said:.2f}", f"{100 * right:.2f}")
    if arguments.out:
        plot_probabilities(rows, arguments.out / "order.png")
    return 0


if __name__ == "__main__":
    run_bench(main)
