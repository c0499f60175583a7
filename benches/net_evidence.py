"""A netlist as evidence: graphs that are right without one, with the right one, and with a wrong one.

python benches/net_evidence.py
python benches/net_evidence.py --first 1000 --scenes 40
"""

from __future__ import annotations

import numpy as np
import rustworkx as rx

import strand
from lib.harness_judging import Judged, draw_set, judge_harness
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.ropes.harness import Harness
from strand.synthetic.harness_scenes import HarnessScene

KINDS = ("cross", "near", "tree", "cross", "near", "equal", "cycle", "near")
GIVEN = ("none", "right", "one branch 10 % longer", "one branch missing", "one branch too many")
SURE = 0.9  # confidence of answers that may be acted on


def make_net(scene: HarnessScene, given: str, rng: np.random.Generator) -> strand.Netlist:
    """Return the netlist of a scene's largest part, right or wrong in one branch."""
    graph: rx.PyGraph[int, None] = rx.PyGraph()
    graph.add_nodes_from(range(len(scene.nodes)))
    graph.add_edges_from_no_data(list(scene.edges))
    part = max(rx.connected_components(graph), key=len)
    edges = [
        (str(start), str(stop), float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()))
        for (start, stop), line in zip(scene.edges, scene.truth, strict=True)
        if start in part
    ]
    degrees = {name: sum(name in edge[:2] for edge in edges) for edge in edges for name in edge[:2]}
    number = int(rng.integers(len(edges)))
    if given == "one branch 10 % longer":
        edges[number] = (*edges[number][:2], 1.1 * edges[number][2])
    elif given == "one branch too many":
        edges.append((max(degrees, key=lambda name: degrees[name]), "new", 0.1))
    elif given == "one branch missing" and len(edges) > 1:
        leaves = [k for k, edge in enumerate(edges) if min(degrees[name] for name in edge[:2]) == 1]
        if leaves:
            edges.pop(leaves[number % len(leaves)])
    return strand.Netlist(edges=edges)


def judge(scene: HarnessScene, given: str) -> Judged:
    """Return how right the graph of a scene is."""
    rng = np.random.default_rng(len(scene.name))
    net: bool | strand.Netlist = True if given == "none" else make_net(scene, given, rng)

    def answer(scene: HarnessScene, radii: list[float] | None, wire: float | None) -> tuple[Harness, float]:
        model = strand.reconstruct(scene.views, radii, scene.bounds, branches=net, wire=wire)
        assert model.harness is not None
        return model.harness, model.confidence

    return judge_harness(scene, answer, "radii")[0]


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", type=int, default=40, metavar="N", help="how many (default: 40)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    arguments = parser.parse_args()
    scenes = list(draw_set(arguments.first, arguments.scenes, KINDS))
    print_head(
        "netlist", "scenes", "right", "confidence in the median", "of the wrong", f"{SURE} or more, wrong"
    )
    for given in GIVEN:
        judged = [judge(scene, given) for scene in scenes]
        sure = [[one.confidence for one in judged if one.right is right] for right in (True, False)]
        print_row(
            given,
            len(judged),
            len(sure[0]),
            *(f"{np.median(own):.2f}" if own else "–" for own in sure),
            sum(one >= SURE for one in sure[1]),
        )
    return 0


if __name__ == "__main__":
    run_bench(main)
