"""Estimate the radius, and print tables for simulated scenes, ropes of many sizes, and real frames.

python benches/radius.py [DIR] [--only TEXT]

Without DIR the first table's scenes are those of benches/lib/collection.py. The second has simulated ropes of
2 to 10 mm radius at 0.7 mm of depth noise, with the seeds 0, 1 and 2. The third has the real frames of
benches/lib/frames.py.
"""

from __future__ import annotations

from collections import defaultdict

import numpy as np

import strand
from lib import collection, frames
from lib.results import make_parser, run_bench
from lib.tables import format_head, print_head, print_row

SIZES = (0.002, 0.003, 0.004, 0.006, 0.008, 0.010)  # metres
SEEDS = 3  # scenes of each size


def find_worst_error(model: strand.Model, radius: float) -> float:
    """Return the greatest error of a chain's radius, percent."""
    return max((abs(chain.radius / radius - 1.0) for chain in model.chains), default=np.inf) * 100.0


def main() -> int:
    parser = make_parser(__doc__)
    collection.add_arguments(parser)
    arguments = parser.parse_args()
    by_noise = defaultdict(list)
    for scene in collection.choose_scenes(arguments):
        model = strand.reconstruct(scene.views, None, scene.bounds)
        by_noise[scene.noise].append((find_worst_error(model, scene.radius), scene.name))
    print_head("depth noise mm", "scenes", "error %, median", "worst")
    for noise, errors in sorted(by_noise.items()):
        largest, name = max(errors)
        middle = np.median([error for error, _ in errors])
        print_row(f"{noise * 1e3:.1f}", len(errors), f"{middle:.2f}", f"{largest:.2f} ({name})")
    print(f"\n{format_head('radius mm', f'error %, median of {SEEDS}', 'worst')}")
    for size in SIZES:
        errors = []
        for seed in range(SEEDS):
            scene = strand.synthetic.scene("paper", seed=seed, radius=size)
            errors.append(find_worst_error(strand.reconstruct(scene.views, None, scene.bounds), size))
        print_row(f"{size * 1e3:.0f}", f"{np.median(errors):.2f}", f"{max(errors):.2f}")
    print(f"\n{format_head('frame', 'radius mm', 'standard deviation mm', 'residual RMS mm')}")
    for frame in frames.list_frames():
        model = strand.reconstruct([frames.load_view(frame)], ropes=1, keep_stages=True)
        chain, fit = model.chains[0], model.stages.get("fit")
        # answers from images have no fit of tubes
        residual = "" if fit is None else f"{1e3 * np.sqrt((fit.residual[fit.inlier] ** 2).mean()):.2f}"
        print_row(frame, *(f"{1e3 * value:.2f}" for value in (chain.radius, chain.radius_sd)), residual)
    return 0


if __name__ == "__main__":
    run_bench(main)
