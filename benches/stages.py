"""Time the stages of a reconstruction from depth images, and print a table in milliseconds.

python benches/stages.py [SCENE ...] [--runs N]

A SCENE is a name of benches/lib/collection.py or an .npz file. "views" un-projects the images, "rest" is all
time outside of stages. The total, from the images to the model, is the median of all runs. The quickest run
comes second: on a busy machine it means more. Stages are medians.
"""

from __future__ import annotations

import statistics
import time

import strand
from lib import collection
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.synthetic import SyntheticScene

SCENES = ("paper_0.7mm", "paper_fine")
METHODS = {"default": strand.Config(), "published": strand.Config.published()}


def time_stages(scene: SyntheticScene, config: strand.Config) -> dict[str, float]:
    """Reconstruct once, and return the seconds of each stage."""
    images = zip(scene.depth * scene.depth_scale, scene.poses, strict=True)
    start = time.perf_counter()
    views = [strand.View.from_depth(image, scene.intrinsics, pose) for image, pose in images]
    unprojected = time.perf_counter()
    model = strand.reconstruct(views, scene.radius, scene.bounds, config=config)
    total = time.perf_counter() - start
    stages = {"views": unprojected - start, **model.timings}
    return {**stages, "rest": total - sum(stages.values())}


def main() -> int:
    parser = make_parser(__doc__)
    scenes = f"names or .npz files (default: {' '.join(SCENES)})"
    parser.add_argument("scenes", metavar="SCENE", nargs="*", default=SCENES, help=scenes)
    parser.add_argument("--runs", type=int, default=15, metavar="N", help="of each (default: 15)")
    arguments = parser.parse_args()
    print_head("scene", "method", "total", "quickest", "stages")
    for scene in map(collection.make_scene, arguments.scenes):
        for name, config in METHODS.items():
            runs = [time_stages(scene, config) for _ in range(arguments.runs)]
            totals = [sum(run.values()) * 1e3 for run in runs]
            stages = {stage: statistics.median(run[stage] for run in runs) * 1e3 for stage in runs[0]}
            parts = ", ".join(f"{stage} {ms:.1f}" for stage, ms in stages.items())
            median, least = f"{statistics.median(totals):.0f}", f"{min(totals):.0f}"
            print_row(scene.name, name, median, least, parts)
    return 0


if __name__ == "__main__":
    run_bench(main)
