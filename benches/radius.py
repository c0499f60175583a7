"""Estimate radii that are not given, and print tables: simulated scenes, ropes of many sizes, real frames.

python benches/radius.py FOLDER [--real FOLDER]

FOLDER holds .npz scenes with their radius and noise. Ropes of 2 to 10 mm radius are simulated at 0.7 mm of
depth noise, each with three seeds. The real FOLDER holds what benches/real.py reads.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
from real import load_view

import strand

SIZES = (0.002, 0.003, 0.004, 0.006, 0.008, 0.010)  # metres
SEEDS = 3


def worst(model: strand.Model, radius: float) -> float:
    """Largest error of a chain's radius, percent."""
    return max((abs(chain.radius / radius - 1.0) for chain in model.chains), default=np.inf) * 100.0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--real", type=Path, help="folder of real frames")
    arguments = parser.parse_args()
    by_noise = defaultdict(list)
    for path in sorted(arguments.folder.glob("*.npz")):
        scene = strand.load_scene(path)
        noise = float(np.load(path)["noise"])
        model = strand.reconstruct(scene.views, None, scene.bounds)
        by_noise[noise].append((worst(model, scene.radius), path.stem))
    print("| depth noise mm | scenes | error %, median | worst |")
    print("|---|---|---|---|")
    for noise, errors in sorted(by_noise.items()):
        largest, name = max(errors)
        middle = np.median([error for error, _ in errors])
        print(f"| {noise * 1e3:.1f} | {len(errors)} | {middle:.2f} | {largest:.2f} ({name}) |")
    print("\n| radius mm | error %, median of " + f"{SEEDS} | worst |")
    print("|---|---|---|")
    for size in SIZES:
        errors = []
        for seed in range(SEEDS):
            scene = strand.synthetic.scene("paper", seed=seed, radius=size)
            errors.append(worst(strand.reconstruct(scene.views, None, scene.bounds), size))
        print(f"| {size * 1e3:.0f} | {np.median(errors):.2f} | {max(errors):.2f} |", flush=True)
    if arguments.real:
        print("\n| frame | radius mm | standard deviation mm | residual RMS mm |")
        print("|---|---|---|---|")
        for path in sorted(arguments.real.glob("depth_*.png")):
            frame = path.stem.removeprefix("depth_")
            model = strand.reconstruct([load_view(arguments.real, frame)], ropes=1, keep_stages=True)
            chain, fit = model.chains[0], model.stages["fit"]
            residual = np.sqrt((fit.residual[fit.inlier] ** 2).mean())
            print(
                f"| {frame} | {chain.radius * 1e3:.2f} | {chain.radius_sd * 1e3:.2f} | {residual * 1e3:.2f} |"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
