"""Reconstruct a rope among other things on a table from the views alone, and count how often it is found.

python benches/cluttered.py [--scenes N] [--first SEED] [--without N] [--points] [--pictures DIR]

The scenes are those of `strand.synthetic.cluttered_scene`, with one view and three by turns. Then come scenes
without a rope, which strand must refuse. The caller gives no radius, bounds, masks or number of ropes. The
rope must be the first of the chains and right by the usual measure. Its own confidence counts, and the
confidence of other chains must be below 0.5.
"""

from __future__ import annotations

import statistics
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import strand
from lib.measure import measure_chains
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.synthetic import SyntheticScene, cluttered_scene

SURE = 0.5  # confidence from which on a chain counts as found


@dataclass(frozen=True)
class Found:
    """A scene's answer: is the first chain the rope, and the confidence of this chain and of the others."""

    views: int
    right: bool
    confidence: float
    others: float
    radius_error: float
    seconds: float


def judge_scene(synthetic: SyntheticScene, views: list[strand.View], pictures: Path | None) -> Found:
    """Reconstruct a scene, and draw it into a folder if the answer is wrong."""
    start = time.perf_counter()
    try:
        model = strand.reconstruct(views)
    except strand.StrandError as error:
        print(f"{synthetic.name}: {error}", file=sys.stderr)
        return Found(len(views), False, 0.0, 0.0, 0.0, time.perf_counter() - start)
    seconds = time.perf_counter() - start
    first, *others = model.chains
    right = bool(synthetic.truth) and measure_chains([first.points], synthetic.truth, synthetic.radius).right
    if pictures is not None and not right:
        draw_chains(synthetic, model, pictures / f"{synthetic.name}.png")
    surest = max((chain.confidence for chain in (others if right else model.chains)), default=0.0)
    error = first.radius / synthetic.radius - 1.0
    return Found(len(views), right, first.confidence, surest, error, seconds)


def draw_chains(synthetic: SyntheticScene, model: strand.Model, path: Path) -> None:
    """Draw the chains over the first depth image."""
    figure, axes = plt.subplots(figsize=(9, 7), layout="constrained")
    axes.imshow(synthetic.depth[0], cmap="gray")
    for chain in model.chains:
        pose = model.poses[0]
        x, y, z = ((chain.points - pose[:3, 3]) @ pose[:3, :3]).T
        focal, centre = np.diag(synthetic.intrinsics)[:2], synthetic.intrinsics[:2, 2]
        axes.plot(focal[0] * x / z + centre[0], focal[1] * y / z + centre[1], linewidth=1.0)
    axes.set_title(f"{synthetic.name}: confidence {model.confidence:.2f}")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
    plt.close(figure)


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", type=int, default=40, metavar="N", help="with a rope (default: 40)")
    parser.add_argument("--without", type=int, default=20, metavar="N", help="without one (default: 20)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument("--points", action="store_true", help="give points instead of depth images")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="draw the scenes that are not right")
    arguments = parser.parse_args()
    results: list[tuple[str, Found]] = []
    for count, rope in ((arguments.scenes, True), (arguments.without, False)):
        for seed in range(arguments.first, arguments.first + count):
            synthetic = cluttered_scene(seed, rope=rope)
            views = list(synthetic.views)
            if arguments.points:
                views = [strand.View(view.points, view.pose) for view in views]
            result = judge_scene(synthetic, views, arguments.pictures)
            print(f"{synthetic.name}: {result}", file=sys.stderr, flush=True)
            results.append(("a rope" if rope else "no rope", result))
    print_head(
        *("scenes", "views", "number", "rope found", f"and its confidence ≥ {SURE}"),
        *(f"something else ≥ {SURE}", "refused", "radius error %, median", "s, median", "max"),
    )
    for what in ("a rope", "no rope"):
        for views in (1, 3):
            some = [result for kind, result in results if kind == what and result.views == views]
            if some:
                right = [result for result in some if result.right]
                errors = [100.0 * abs(result.radius_error) for result in right]
                times = [result.seconds for result in some]
                print_row(
                    *(what, views, len(some), len(right)),
                    sum(result.confidence >= SURE for result in right),
                    sum(result.others >= SURE for result in some),
                    sum(result.confidence == 0.0 and not result.right for result in some),
                    f"{statistics.median(errors):.1f}" if errors else "",
                    *(f"{statistics.median(times):.2f}", f"{max(times):.2f}"),
                )
    return 0


if __name__ == "__main__":
    run_bench(main)
