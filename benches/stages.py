"""Time the stages of a reconstruction from depth images, and print a table in milliseconds.

python benches/stages.py SCENE.npz [SCENE.npz ...] [--runs N]

"views" is the un-projection of the images, "rest" what belongs to no stage; the total, from the images to
the model, is the median of all runs, then the quickest: on a busy machine it says more. Stages are medians.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from pathlib import Path

import numpy as np

import strand

METHODS = {"default": strand.Config(), "published": strand.Config.published()}


def timed(scene: strand.scene.Scene, path: Path, config: strand.Config) -> dict[str, float]:
    """Seconds of each stage of one run."""
    with np.load(path) as arrays:
        images = arrays["depth"] * float(arrays["depth_scale"])
        intrinsics, poses = arrays["K"], arrays["poses"]
    start = time.perf_counter()
    views = [
        strand.View.from_depth(image, intrinsics, pose) for image, pose in zip(images, poses, strict=True)
    ]
    unprojected = time.perf_counter()
    model = strand.reconstruct(views, scene.radius, scene.bounds, config=config)
    total = time.perf_counter() - start
    stages = {"views": unprojected - start, **model.timings}
    return {**stages, "rest": total - sum(stages.values())}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", type=Path, nargs="+")
    parser.add_argument("--runs", type=int, default=15)
    arguments = parser.parse_args()
    print("| scene | method | total | quickest | stages |")
    print("|---|---|---|---|---|")
    for path in arguments.scenes:
        scene = strand.load_scene(path)
        for name, config in METHODS.items():
            runs = [timed(scene, path, config) for _ in range(arguments.runs)]
            totals = [sum(run.values()) * 1e3 for run in runs]
            stages = {stage: statistics.median(run[stage] for run in runs) * 1e3 for stage in runs[0]}
            parts = ", ".join(f"{stage} {ms:.1f}" for stage, ms in stages.items())
            row = [path.stem, name, f"{statistics.median(totals):.0f}", f"{min(totals):.0f}", parts]
            print("|", " | ".join(row), "|", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
