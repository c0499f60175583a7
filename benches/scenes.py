"""Reconstruct every scene of a folder and print a table: topology, RMS, length, crossings, time.

python benches/scenes.py DIR [--published] [--ropes N] [--only TEXT]

DIR holds .npz scenes with truth; the measure is score.py in the folder above it. Times are medians of
five runs.
"""

from __future__ import annotations

import argparse
import importlib.util
import statistics
import sys
import time
from pathlib import Path
from types import ModuleType

import strand


def load_measure(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("score", path)
    if spec is None or spec.loader is None:
        raise FileNotFoundError(path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--published", action="store_true", help="use Config.published()")
    parser.add_argument("--ropes", type=int, help="tell the number of ropes")
    parser.add_argument("--only", default="", help="scenes whose name holds this text")
    arguments = parser.parse_args()
    measure = load_measure(arguments.folder.resolve().parent / "score.py")
    config = strand.Config.published() if arguments.published else None
    print("| scene | topology | chains | Fréchet / r | RMS mm | length % | crossings | ms |")
    print("|---|---|---|---|---|---|---|---|")
    right = total = 0
    for path in sorted(arguments.folder.glob("*.npz")):
        if arguments.only not in path.stem:
            continue
        scene = strand.load_scene(path)
        times = []
        try:
            for _ in range(5):
                start = time.perf_counter()
                model = strand.reconstruct(
                    scene.views, scene.radius, scene.bounds, ropes=arguments.ropes, config=config
                )
                times.append((time.perf_counter() - start) * 1e3)
            s = measure.score([chain.points for chain in model.chains], scene.truth, scene.radius)
        except strand.StrandError as error:
            print(f"| {path.stem} | no answer: {error} | | | | | | |", flush=True)
            total += 1
            continue
        found, true, correct = s["crossings"]
        print(
            f"| {path.stem} | {'right' if s['topology_ok'] else 'wrong'} | {s['n_chains']} of {s['n_true']} "
            f"| {s['frechet']:.2f} | {s['rms'] * 1e3:.2f} | {s['length_err'] * 100:.2f} "
            f"| {correct} of {true}, {max(found - correct, 0)} false | {statistics.median(times):.0f} |",
            flush=True,
        )
        right, total = right + s["topology_ok"], total + 1
    print(f"\ntopology right on {right} of {total} scenes")
    return 0 if total else 1


if __name__ == "__main__":
    sys.exit(main())
