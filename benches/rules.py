"""Join the same arcs by the paper's rule, by one matching and by the decision, and print where each fails.

python benches/rules.py [DIR] [--only TEXT]

Without DIR the scenes are those of benches/lib/collection.py. The arcs are those that the default method
traces and fits. The paper's rule groups their ends by four, nearest first, and joins the pairs whose
directions agree best (section V-B). The matching joins all ends at once at least cost. The decision fits
several ways to split and join the arcs, and compares them. All three are fitted to the points in the same
way.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand
from lib import collection
from lib.measure import measure_chains
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.config import Config, Reconnection
from strand.geometry.polyline import path_length
from strand.reconstruction.courses import Chains
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.outliers import drop_outliers
from strand.reconstruction.published.reconnection import reconnect
from strand.reconstruction.published.splitting import Split
from strand.reconstruction.radius import Radii
from strand.reconstruction.stages import Run
from strand.reconstruction.tubes.chaining import chain_arcs
from strand.reconstruction.tubes.clouds import Arcs, Clouds
from strand.reconstruction.tubes.join_costs import price_joins
from strand.reconstruction.tubes.matching import match_ends
from strand.reconstruction.tubes.pixels import Cameras
from strand.reconstruction.tubes.tube_ends import find_extents
from strand.reconstruction.tubes.whole_ropes import fit_ropes
from strand.synthetic import SyntheticScene
from strand.views.view import cropped


def join_by_paper(arcs: Sequence[np.ndarray], radius: float) -> Chains:
    """Join arcs by the paper's rule."""
    joins = reconnect(Split((), (), tuple(arcs), ()), radius, None, Reconnection()).joins
    return chain_arcs(arcs, joins, JoinEvidence(radius, Config().linking))


def join_by_matching(arcs: Sequence[np.ndarray], radius: float) -> Chains:
    """Join arcs by one matching of all ends."""
    evidence = JoinEvidence(radius, Config().linking)
    joins, _ = match_ends(price_joins(arcs, evidence), evidence.config.free_end)
    return chain_arcs(arcs, joins, evidence)


def fit_chains(scene: SyntheticScene, model: strand.Model, chains: Chains) -> list[np.ndarray]:
    """Return the nodes of ropes after the last fit, with the corrected poses of the model."""
    config = Config()
    least = config.linking.min_length * scene.radius
    kept = [(nodes, closed) for nodes, closed in chains if path_length(nodes)[-1] > least]
    ropes = Arcs([nodes for nodes, _ in kept], [0] * len(kept))
    viewpoints = np.array([view.viewpoint for view in scene.views])
    box = strand.Box(*scene.bounds)
    clouds = Clouds(list(model.stages["filtered"]), viewpoints, len(viewpoints) // 2, box)
    closed = [ring for _, ring in kept]
    seen = drop_outliers(cropped(scene.views, box), scene.radius, config.filter, published=False)
    cameras = Cameras(seen, scene.views)
    radii, run = Radii.from_caller(scene.radius), Run(None)
    fit, _, _ = fit_ropes(clouds, cameras, ropes, closed, model.stages["fit"], radii, None, config, run)
    parts = [part for part in find_extents(fit, exclusive=True) if part is not None]
    return [part.at(part.spaced(0.25 * scene.radius))[0] for part in parts]


def main() -> int:
    parser = make_parser(__doc__)
    collection.add_arguments(parser)
    arguments = parser.parse_args()
    print_head("scene", "ropes", "arcs", "paper's rule", "matching", "decision")
    right, total = np.zeros(3, dtype=int), 0
    for scene in collection.choose_scenes(arguments):
        model = strand.reconstruct(scene.views, scene.radius, scene.bounds, keep_stages=True)
        arcs = model.stages["arcs"]
        answers = [
            fit_chains(scene, model, join_by_paper(arcs, scene.radius)),
            fit_chains(scene, model, join_by_matching(arcs, scene.radius)),
            [chain.points for chain in model.chains],
        ]
        found = [measure_chains(answer, scene.truth, scene.radius) for answer in answers]
        said = ["right" if each.right else f"wrong, {each.chains} ropes" for each in found]
        print_row(scene.name, len(scene.truth), len(arcs), *said)
        right, total = right + [each.right for each in found], total + 1
    print(f"\nTopology right on {right[0]}, {right[1]} and {right[2]} of {total} scenes.")
    return 0


if __name__ == "__main__":
    run_bench(main)
