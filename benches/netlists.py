"""Netlists against measured graphs with a branch missing, too many or too long: what is named right.

python benches/netlists.py
"""

from __future__ import annotations

import statistics
import time

import numpy as np

from lib.netlists import draw_netlist, measure
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.ropes.net_matching import OPEN, match_netlist

TOLERANCE = 0.03  # relative standard deviation that the match is told
CHANGES = ("none", "missing", "too many", "longer")


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--graphs", type=int, default=200, metavar="N", help="of each change (default: 200)")
    parser.add_argument("--junctions", type=int, nargs=2, default=(1, 8), metavar=("LOW", "HIGH"))
    arguments = parser.parse_args()
    print_head(
        "change",
        "graphs",
        "nodes right",
        "change named",
        f"margin ≥ {OPEN:g}",
        "of these right",
        "CPU ms",
        "slowest",
    )
    for number, change in enumerate(CHANGES):
        right, named, sure, sure_right, times = 0, 0, 0, 0, []
        for seed in range(arguments.graphs):
            rng = np.random.default_rng([number, seed])
            low, high = arguments.junctions
            net = draw_netlist(rng, int(rng.integers(low, high + 1)))
            found, nodes, changed = measure(rng, net, change)
            begun = time.process_time()
            match = match_netlist(net, found, TOLERANCE)
            times.append(time.process_time() - begun)
            is_right = match.nodes == nodes
            if change == "missing":
                is_named = match.missing == (changed,) and not match.extra
            elif change == "too many":
                is_named = match.extra == (changed,) and not match.missing
            else:
                off = [edge for edge in match.edges if abs(edge.difference) > 0.06 * edge.expected]
                expected = [] if changed is None else [set(changed[:2])]
                is_named = (
                    not match.missing and not match.extra and [set(edge.names) for edge in off] == expected
                )
            right, named = right + is_right, named + is_named
            sure, sure_right = sure + (match.margin >= OPEN), sure_right + (match.margin >= OPEN and is_right)
        print_row(
            change,
            arguments.graphs,
            right,
            named,
            sure,
            sure_right,
            f"{1e3 * statistics.median(times):.1f}",
            f"{1e3 * max(times):.0f}",
        )
    return 0


if __name__ == "__main__":
    run_bench(main)
