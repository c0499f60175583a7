"""Reconstruct simulated scenes and print topology, errors, crossings, confidence and time.

python benches/scenes.py [DIR] [--only TEXT] [--published] [--estimate-radius] [--ropes N] [--views I ...]
    [--runs N]

Without DIR the scenes are those of benches/lib/collection.py. Topology, Fréchet distance, RMS, length and
crossings are those of benches/lib/measure.py. The time is the median of the runs. Below the table are the RMS
by depth noise, and a digest of all chains' nodes, bit for bit. On one machine the digest stays the same if a
change of the code changes no answer.
"""

from __future__ import annotations

import argparse
import hashlib
import math
import statistics
import sys
import time
from collections import defaultdict
from collections.abc import Iterable

import numpy as np

import strand
from lib import collection
from lib.measure import Measure, measure_chains
from lib.results import make_parser, run_bench
from lib.tables import format_head, format_row, print_head, print_row
from strand.synthetic import SyntheticScene


def reconstruct(scene: SyntheticScene, arguments: argparse.Namespace) -> tuple[strand.Model, float]:
    """Return the model of a scene, and the median of the runs' times, milliseconds."""
    config = strand.Config.published() if arguments.published else strand.Config()
    views = scene.views if arguments.views is None else [scene.views[i] for i in arguments.views]
    radius = None if arguments.estimate_radius else scene.radius
    times = []
    for _ in range(arguments.runs):
        start = time.perf_counter()
        model = strand.reconstruct(views, radius, scene.bounds, ropes=arguments.ropes, config=config)
        times.append((time.perf_counter() - start) * 1e3)
    return model, statistics.median(times)


def format_scene(name: str, found: Measure, confidence: float, milliseconds: float) -> str:
    """Return a row of the table."""
    crossings = found.crossings
    return format_row(
        name,
        "right" if found.right else "wrong",
        f"{found.chains} of {found.ropes}",
        f"{found.frechet:.2f}",
        f"{found.rms * 1e3:.2f}",
        f"{found.length_error * 100:.2f}",
        f"{crossings.right} of {crossings.true}, {max(crossings.found - crossings.right, 0)} false",
        "–" if math.isnan(confidence) else f"{confidence:.2f}",
        f"{milliseconds:.0f}",
    )


def digest_nodes(answers: Iterable[tuple[str, list[np.ndarray]]]) -> str:
    """Return the SHA-256 of scenes' names and their chains' nodes, bit for bit."""
    whole = hashlib.sha256()
    for name, chains in answers:
        whole.update(f"{name} {[len(nodes) for nodes in chains]}".encode())
        for nodes in chains:
            whole.update(np.ascontiguousarray(nodes, dtype="<f8").tobytes())
    return whole.hexdigest()


def main() -> int:
    parser = make_parser(__doc__)
    collection.add_arguments(parser)
    parser.add_argument("--published", action="store_true", help="use Config.published()")
    parser.add_argument("--estimate-radius", action="store_true", help="do not give the radius")
    parser.add_argument("--ropes", type=int, metavar="N", help="give the number of ropes")
    parser.add_argument("--views", type=int, nargs="+", metavar="I", help="use only these views, from 0 on")
    parser.add_argument("--runs", type=int, default=5, metavar="N", help="of each scene (default: 5)")
    arguments = parser.parse_args()
    if arguments.published and arguments.estimate_radius:
        parser.error("--estimate-radius: the published method needs the radius")
    if arguments.runs < 1:
        parser.error("--runs: expected at least 1")
    print_head(
        *("scene", "topology", "chains", "Fréchet / r", "RMS mm", "length %", "crossings", "confidence", "ms")
    )
    answers, measures = [], []
    by_noise: dict[float, list[float]] = defaultdict(list)
    sure_and_wrong = 0.0
    for scene in collection.choose_scenes(arguments):
        try:
            model, milliseconds = reconstruct(scene, arguments)
        except strand.StrandError as error:
            chains, confidence, milliseconds = [], 0.0, math.nan
            print(f"{scene.name}: {error}", file=sys.stderr)
        else:
            chains, confidence = [chain.points for chain in model.chains], model.confidence
        answers.append((scene.name, chains))
        found = measure_chains(chains, scene.truth, scene.radius)
        measures.append(found)
        by_noise[scene.noise].append(found.rms * 1e3)
        if not found.right:
            sure_and_wrong = max(sure_and_wrong, confidence)
        print(format_scene(scene.name, found, confidence, milliseconds), flush=True)
    right = sum(found.right for found in measures)
    over, crossings = (sum(getattr(found.crossings, key) for found in measures) for key in ("right", "true"))
    print(f"\nTopology right on {right} of {len(measures)} scenes, ", end="")
    print(f"over and under at {over} of {crossings} crossings.")
    if right < len(measures) and not arguments.published:
        print(f"The highest confidence of a wrong answer is {sure_and_wrong:.2f}.")
    print(f"\n{format_head('depth noise mm', 'scenes', 'RMS mm, median', 'worst')}")
    for noise, errors in sorted(by_noise.items()):
        print_row(f"{noise * 1e3:.1f}", len(errors), f"{statistics.median(errors):.3f}", f"{max(errors):.3f}")
    print(f"\nSHA-256 of the nodes: {digest_nodes(answers)}")
    return 0


if __name__ == "__main__":
    run_bench(main)
