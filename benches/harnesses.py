"""Graphs of random harnesses: what comes out right, by kind, views and noise.

python benches/harnesses.py
python benches/harnesses.py --give nothing
python benches/harnesses.py --first 1000 --scenes 50 --pictures out/harnesses
"""

from __future__ import annotations

from pathlib import Path

from lib.harness_judging import GIVEN, KINDS, draw_set, judge_harness, print_summary, reconstruct_harness
from lib.pictures import draw_graph, draw_scene
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.synthetic import harness


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", type=int, default=52, metavar="N", help="how many (default: 52)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument("--kind", choices=sorted(set(KINDS)), help="scenes of one kind")
    parser.add_argument("--give", choices=GIVEN, default="radii", help="what is given (default: radii)")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="draw the wrong answers here")
    parser.add_argument("--example", type=Path, metavar="PNG", help="only draw a harness for the docs here")
    arguments = parser.parse_args()
    if arguments.example is not None:
        made = harness("tree", seed=2, views=3)
        draw_graph(made, reconstruct_harness(made, sorted(set(made.radii)), None)[0], arguments.example)
        return 0
    kinds = KINDS if arguments.kind is None else (arguments.kind,)
    results = []
    print_head("scene", "noise", "graph", "junctions", "edges", "confidence", "CPU s", "no answer")
    for scene in draw_set(arguments.first, arguments.scenes, kinds):
        judged, found = judge_harness(scene, reconstruct_harness, arguments.give)
        results.append(judged)
        print_row(
            judged.scene,
            judged.noise,
            "right" if judged.right else "wrong",
            f"{judged.both} of {judged.true_junctions}, {judged.found_junctions} found",
            f"{judged.edges} of {judged.true_edges}",
            f"{judged.confidence:.2f}",
            f"{judged.seconds:.2f}",
            judged.error[:60],
        )
        if arguments.pictures is not None and not judged.right:
            chains = [edge.chain.points for edge in found.edges] if found else []
            draw_scene(scene, chains, arguments.pictures / f"{judged.scene}.png")
    print()
    print_summary(results)
    return 0


if __name__ == "__main__":
    run_bench(main)
