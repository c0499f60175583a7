"""Time the stages of a reconstruction, and print a table of medians in milliseconds.

python benches/stages.py SCENE.npz [SCENE.npz ...] [--runs N]
"""

from __future__ import annotations

import argparse
import statistics
import sys
from pathlib import Path

import strand

METHODS = {"default": strand.Config(), "published": strand.Config.published()}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", type=Path, nargs="+")
    parser.add_argument("--runs", type=int, default=15)
    arguments = parser.parse_args()
    print("| scene | method | total | stages |")
    print("|---|---|---|---|")
    for path in arguments.scenes:
        scene = strand.load_scene(path)
        for name, config in METHODS.items():
            runs = [
                strand.reconstruct(scene.views, scene.radius, scene.bounds, config=config).timings
                for _ in range(arguments.runs)
            ]
            stages = {stage: statistics.median(run[stage] for run in runs) * 1e3 for stage in runs[0]}
            total = statistics.median(sum(run.values()) for run in runs) * 1e3
            parts = ", ".join(f"{stage} {ms:.1f}" for stage, ms in stages.items())
            print(f"| {path.stem} | {name} | {total:.0f} | {parts} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
