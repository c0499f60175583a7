"""Join the same pieces by the paper's rule and by the global decision, and say where each fails.

python benches/rules.py DIR [--only TEXT]

DIR holds .npz scenes with truth; the measure is score.py in the folder above it. The pieces are the arcs
that the default method traces and fits. The paper's rule groups their ends by four, nearest first, and
joins the pairs whose directions agree best (section V-B); the matching joins all ends at once, at least
cost; the decision compares several ways to part and join them by fitting each. What is joined is fitted
to the points in the same way.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scenes import load_measure

import strand
from strand.config import Config, Reconnection
from strand.ends import string_parts
from strand.linking import Links, link
from strand.radius import Radii
from strand.topology import Split, path_length, reconnect
from strand.tubes import Arcs, Clouds, fit_strings


def by_the_papers_rule(arcs: Sequence[np.ndarray], radius: float) -> list[tuple[np.ndarray, bool]]:
    joins = reconnect(Split((), (), tuple(arcs), ()), radius, None, Reconnection()).joins
    return Links(tuple(arcs), {}).joined(joins, radius, Config().linking, None)


def fitted(
    scene: strand.Scene, model: strand.Model, chains: list[tuple[np.ndarray, bool]]
) -> list[np.ndarray]:
    """Nodes of strings after the last fit, from the corrected poses of the model."""
    config = Config()
    least = config.linking.min_length * scene.radius
    kept = [(nodes, closed) for nodes, closed in chains if path_length(nodes)[-1] > least]
    strings = Arcs([nodes for nodes, _ in kept], [0] * len(kept))
    viewpoints = np.array([view.viewpoint for view in scene.views])
    clouds = Clouds(list(model.stages["filtered"]), viewpoints, len(viewpoints) // 2, scene.bounds)
    closed = [ring for _, ring in kept]
    fit = fit_strings(clouds, strings, closed, model.stages["fit"], Radii.given(scene.radius), config)
    parts = [part for part in string_parts(fit, exclusive=True) if part is not None]
    return [part.at(part.nodes(0.25 * scene.radius))[0] for part in parts]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="", help="scenes whose name holds this text")
    arguments = parser.parse_args()
    measure = load_measure(arguments.folder.resolve().parent / "score.py")
    print("| scene | strings | pieces | paper's rule | matching | decision |")
    print("|---|---|---|---|---|---|")
    right, total = np.zeros(3, dtype=int), 0
    for path in sorted(arguments.folder.glob("*.npz")):
        if arguments.only not in path.stem:
            continue
        scene = strand.load_scene(path)
        model = strand.reconstruct(scene.views, scene.radius, scene.bounds, keep_stages=True)
        arcs = model.stages["arcs"]
        answers = [
            fitted(scene, model, by_the_papers_rule(arcs, scene.radius)),
            fitted(scene, model, link(arcs, scene.radius, Config().linking)),
            [chain.points for chain in model.chains],
        ]
        scores = [measure.score(answer, scene.truth, scene.radius) for answer in answers]
        said = ["right" if s["topology_ok"] else f"wrong, {s['n_chains']} strings" for s in scores]
        print(f"| {path.stem} | {len(scene.truth)} | {len(arcs)} | {' | '.join(said)} |", flush=True)
        right, total = right + [s["topology_ok"] for s in scores], total + 1
    print(f"\nTopology right on {right[0]}, {right[1]} and {right[2]} of {total} scenes.")
    return 0 if total else 1


if __name__ == "__main__":
    sys.exit(main())
