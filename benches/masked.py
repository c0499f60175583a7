"""Time reconstructions from images with masks, and print a table in milliseconds.

python benches/masked.py [--runs N] [--only TEXT]

The scenes are shapes and random ropes, through the cameras of `strand.synthetic.CAMERAS` in turn: in one view
of 640 x 480 pixels, in one of 1280 x 720, and in three of 640 x 480. The radius and the number of ropes are
given. A scene's time is the median of its runs, from the images and masks to the model. The table has the
median, least and greatest time of the scenes, and each stage's median. "views" makes the views, "rest" is all
time outside of stages.
"""

from __future__ import annotations

import math
import statistics
import sys
import time
from collections.abc import Iterator

import strand
from lib.collection import SHAPES
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.synthetic import CAMERAS, Camera, Layout, Noise, Segmentation, SyntheticScene, random_ropes, scene
from strand.synthetic.camera import FOCAL_LENGTH

SMALL = (640, 480)  # pixels
LARGE = (1280, 720)  # pixels
# title, views, size
FIGURES = (("one 640 x 480", 1, SMALL), ("one 1280 x 720", 1, LARGE), ("three 640 x 480", 3, SMALL))
RANDOM = (1, 3, 5)  # crossings of the random ropes
RADIUS = 4.5e-3  # metres: the ropes'
PIXELS = 4.5  # the ropes' radius in an image 640 wide


def draw_scenes(views: int, size: tuple[int, int], only: str = "") -> Iterator[SyntheticScene]:
    """Yield the scenes whose name holds a text."""
    for seed, what in enumerate((*SHAPES, *RANDOM)):
        name = what if isinstance(what, str) else f"random{what}"
        if only in name:
            yield scene(
                name,
                chains=None if isinstance(what, str) else random_ropes(what, 1, RADIUS, seed),
                radius=RADIUS,
                seed=seed,
                views=views,
                camera=Camera(tuple(CAMERAS)[seed % len(CAMERAS)], size=size),
                layout=Layout(
                    distance=FOCAL_LENGTH * SMALL[0] * RADIUS / PIXELS, elevation=math.radians(60.0)
                ),
                mask=Segmentation(grow=seed % 3 - 1),
                noise=Noise(turn=math.radians(0.4)),
            )


def time_stages(synthetic: SyntheticScene) -> dict[str, float]:
    """Reconstruct once, and return the seconds of each stage."""
    depths, masks = synthetic.depth * synthetic.depth_scale, synthetic.mask
    assert masks is not None
    start = time.perf_counter()
    views = [
        strand.View.from_depth(depth, synthetic.intrinsics, pose, mask=mask)
        for depth, pose, mask in zip(depths, synthetic.poses, masks, strict=True)
    ]
    made = time.perf_counter()
    model = strand.reconstruct(views, synthetic.radius, ropes=len(synthetic.truth))
    total = time.perf_counter() - start
    stages = {"views": made - start, **model.timings}
    return {**stages, "rest": total - sum(stages.values())}


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--runs", type=int, default=7, metavar="N", help="of each scene (default: 7)")
    parser.add_argument("--only", metavar="TEXT", default="", help="scenes whose name holds this text")
    arguments = parser.parse_args()
    print_head("views", "scenes", "median", "least", "greatest", "stages")
    for name, views, size in FIGURES:
        totals: list[float] = []
        scenes: list[dict[str, float]] = []
        for synthetic in draw_scenes(views, size, arguments.only):
            runs = [time_stages(synthetic) for _ in range(arguments.runs)]
            totals.append(1e3 * statistics.median(sum(run.values()) for run in runs))
            scenes.append({k: 1e3 * statistics.median(run.get(k, 0.0) for run in runs) for k in runs[0]})
        if not totals:
            sys.exit(f"no scene whose name holds {arguments.only!r}")
        stages = {k: statistics.median(one.get(k, 0.0) for one in scenes) for one in scenes for k in one}
        parts = ", ".join(f"{stage} {ms:.1f}" for stage, ms in stages.items() if ms >= 0.05)
        middle = f"{statistics.median(totals):.0f}"
        print_row(name, len(totals), middle, f"{min(totals):.0f}", f"{max(totals):.0f}", parts)
    return 0


if __name__ == "__main__":
    run_bench(main)
