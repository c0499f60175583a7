"""Check whether knots get the right names, and how long that takes.

python benches/knots.py [--count N] [--nodes N] [--seed N] [--runs N] [--scenes N]

Each chain is a knot of up to seven crossings: a closed braid of KnotInfo (knotinfo.org) or a sum of two. It
is mirrored by chance, cut open at a random place without up to 1 % of it, resampled, moved by smooth noise,
stretched and turned. A name counts as right with its chirality. Times are processor time of `strand.knot` on
one thread, with the knotted core: the least of --runs calls.

With --scenes the bench reconstructs N simulated scenes of each shape from depth, and names their ropes and
true centrelines.
"""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

import strand
from lib.braids import Array, make_knots
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.ropes.knots import Knot

LIMIT = 5  # milliseconds: the share of quicker calls is printed


def print_scenes(count: int) -> None:
    """Print the names of true centrelines and of reconstructed ropes."""
    print_head("shape", "true centreline", "from depth")
    for shape in strand.synthetic.SHAPES:
        truth, found = Counter[str](), Counter[str]()
        for seed in range(count):
            scene = strand.synthetic.scene(shape, seed=seed)
            truth[format_name(strand.knot(scene.truth[0]))] += 1
            model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
            found[" and ".join(format_name(chain.knot()) for chain in model.chains)] += 1
        print_row(shape, *(", ".join(f"{name}: {n}" for name, n in of.items()) for of in (truth, found)))


def format_name(knot: Knot) -> str:
    """Return a knot's name, with its chirality if it has one."""
    return f"{knot.name} {knot.chirality}" if knot.chirality else knot.name


def time_knot(chain: Array) -> float:
    """Return the processor time of one call, milliseconds."""
    begun = time.process_time()
    strand.knot(chain)
    return (time.process_time() - begun) * 1e3


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--count", type=int, default=500, metavar="N", help="how many chains (default: 500)")
    parser.add_argument("--nodes", type=int, default=400, metavar="N", help="nodes of each (default: 400)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the random numbers (default: 0)")
    parser.add_argument("--runs", type=int, default=5, metavar="N", help="timed calls for each (default: 5)")
    parser.add_argument(
        "--scenes", type=int, default=0, metavar="N", help="name N scenes of each shape instead"
    )
    options = parser.parse_args()
    if options.scenes:
        print_scenes(options.scenes)
        return 0
    strand.set_num_threads(1)
    total: Counter[str] = Counter()
    right: Counter[str] = Counter()
    times: dict[str, list[float]] = {}
    wrong = []
    for name, hand, chain in make_knots(options.count, options.nodes, options.seed):
        knot = strand.knot(chain)
        times.setdefault(name, []).append(min(time_knot(chain) for _ in range(options.runs)))
        total[name] += 1
        if (knot.name, knot.chirality) == (name, hand):
            right[name] += 1
        else:
            wrong.append(f"{name} {hand}: {knot}")
    print_head("knot", "right", "time, ms: median", "longest")
    for name, taken in times.items():
        print_row(name, f"{right[name]} of {total[name]}", f"{np.median(taken):.2f}", f"{max(taken):.2f}")
    everything = np.concatenate(list(times.values()))
    print(f"\nRight: {right.total()} of {total.total()}; median {np.median(everything):.2f} ms,", end=" ")
    print(f"95 % within {np.percentile(everything, 95):.2f} ms, longest {everything.max():.2f} ms,", end=" ")
    print(f"{np.mean(everything < LIMIT):.1%} under {LIMIT} ms.")
    print("\n".join(wrong))
    return 0


if __name__ == "__main__":
    run_bench(main)
