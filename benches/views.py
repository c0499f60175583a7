"""Measure how the time of a reconstruction grows with the number of its views.

python benches/views.py [--counts N ...] [--seed N] [--masks]

The scenes are those of `strand.synthetic.scene`. Times are processor times of one run each. The exponent is
the slope of their logarithms.
"""

from __future__ import annotations

import time

import numpy as np

import strand
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row

COUNTS = (25, 50, 100, 200)


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS, help="numbers of views")
    parser.add_argument("--seed", type=int, default=3, help="of the scenes")
    parser.add_argument("--masks", action="store_true", help="give masks and images instead of points")
    arguments = parser.parse_args()
    columns = ("views", "processor time, s", "chains", "confidence")
    print_head(*columns)
    times = []
    for count in arguments.counts:
        scene = strand.synthetic.scene(seed=arguments.seed, views=count)
        views = scene.views
        if arguments.masks:
            scene = strand.synthetic.scene(
                seed=arguments.seed, views=count, mask=strand.synthetic.Segmentation()
            )
            views = [
                strand.View.from_depth(
                    depth, scene.intrinsics, pose, depth_scale=scene.depth_scale, mask=mask
                )
                for depth, pose, mask in zip(scene.depth, scene.poses, scene.mask, strict=True)
            ]
        begun = time.process_time()
        model = strand.reconstruct(views, radius=scene.radius)
        times.append(time.process_time() - begun)
        print_row(count, f"{times[-1]:.2f}", len(model.chains), f"{model.confidence:.2f}")
    slope = np.polyfit(np.log(arguments.counts), np.log(times), 1)[0]
    print(f"\ntime grows with views to the {slope:.2f}")


if __name__ == "__main__":
    run_bench(main)
