"""Measure how the time of a reconstruction grows with its work: views, pixels, crossings, ropes.

python benches/work.py [QUANTITY ...] [--seeds N] [--calls N]

The scenes are simulated, with masks and the radius. Views show the paper's shape, pixels one view of a figure
eight. Crossings and ropes are those of one view from above: random ropes, side by side where there are more
than one draw has. Their images and the place on the table have one size, so that only the work differs.

A time is the processor time of a call, the least of some calls, and the median of the seeds. The exponent b
of t = a n^b compares a row with the one above it; it shows where the time bends.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import strand
from lib.measure import measure_chains
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.synthetic import Camera, Layout, Noise, Segmentation, SyntheticScene, random_ropes, scene

RADIUS = 4.2e-3  # metres
FROM_ABOVE = Layout(distance=1.4, elevation=math.radians(80.0))
LARGE = (1920, 1440)  # pixels
GAP = 8.0  # radii between ropes side by side
COLUMNS = 4  # ropes side by side before the next line
MOST = 5  # crossings of one draw


def draw_views(count: int, seed: int) -> SyntheticScene:
    return scene("paper", seed=seed, views=count, mask=Segmentation())


def draw_pixels(count: int, seed: int) -> SyntheticScene:
    """Return a view of about so many pixels, four to three."""
    height = 4 * round(math.sqrt(count * 3.0 / 4.0) / 4.0)
    camera = Camera(size=(height * 4 // 3, height))
    return scene("figure8", seed=seed, views=1, camera=camera, mask=Segmentation())


def draw_crossings(count: int, seed: int) -> SyntheticScene:
    draws = math.ceil(count / MOST)
    shares = [count // draws + (number < count % draws) for number in range(draws)]
    return lay_side_by_side([make_rope(share, 100 * seed + n) for n, share in enumerate(shares)], seed)


def draw_ropes(count: int, seed: int) -> SyntheticScene:
    return lay_side_by_side([make_rope(1, 100 * seed + number) for number in range(count)], seed)


def make_rope(crossings: int, seed: int) -> NDArray[np.float64]:
    """Return a rope that crosses itself; some seeds have no such rope."""
    while True:
        try:
            (rope,) = random_ropes(crossings, 1, RADIUS, seed)
        except ValueError:
            seed += 1_000_000
        else:
            return rope


def lay_side_by_side(ropes: list[NDArray[np.float64]], seed: int) -> SyntheticScene:
    """Return a view from above of ropes in lines, centred on the origin."""
    cell = max(np.ptp(rope[:, :2], axis=0).max() for rope in ropes) + GAP * RADIUS
    laid = []
    for number, rope in enumerate(ropes):
        place = cell * np.array([number % COLUMNS, number // COLUMNS])
        laid.append(rope + np.append(place - 0.5 * (rope.min(axis=0) + rope.max(axis=0))[:2], 0.0))
    together = np.concatenate(laid)
    middle = 0.5 * (together.min(axis=0) + together.max(axis=0)) * (1.0, 1.0, 0.0)
    return scene(
        "side by side",
        chains=[rope - middle for rope in laid],
        radius=RADIUS,
        seed=seed,
        views=1,
        camera=Camera(size=LARGE),
        noise=Noise(),
        mask=Segmentation(),
        layout=FROM_ABOVE,
    )


QUANTITIES: dict[str, tuple[Callable[[int, int], SyntheticScene], tuple[int, ...]]] = {
    "views": (draw_views, (1, 3, 7, 15, 25, 50)),
    "pixels": (draw_pixels, (100_000, 300_000, 1_000_000, 4_000_000, 16_000_000)),
    "crossings": (draw_crossings, (1, 5, 10, 20, 40, 60)),
    "ropes": (draw_ropes, (1, 2, 4, 8, 12)),
}


def time_scene(drawn: SyntheticScene, calls: int) -> tuple[float, bool]:
    """Return the least processor time of some calls, seconds, and whether the topology is right."""
    views, times, model = drawn.views, [], None
    for _ in range(calls):
        begun = time.process_time()
        model = strand.reconstruct(views, radius=drawn.radius, ropes=len(drawn.truth))
        times.append(time.process_time() - begun)
    assert model is not None
    measured = measure_chains([chain.points for chain in model.chains], drawn.truth, RADIUS)
    return min(times), measured.right


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument("quantities", metavar="QUANTITY", nargs="*", help=f"of {', '.join(QUANTITIES)}")
    parser.add_argument("--seeds", type=int, default=3, metavar="N", help="of each number (default: 3)")
    parser.add_argument("--calls", type=int, default=2, metavar="N", help="of each scene (default: 2)")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.quantities if name not in QUANTITIES]
    if unknown:
        parser.error(f"QUANTITY: expected some of {', '.join(QUANTITIES)}; got {', '.join(unknown)}")
    print_head("quantity", "number", "right", "processor time, ms", "exponent")
    for name in arguments.quantities or QUANTITIES:
        draw, numbers = QUANTITIES[name]
        before: tuple[int, float] | None = None
        for number in numbers:
            found = [time_scene(draw(number, seed), arguments.calls) for seed in range(arguments.seeds)]
            taken = statistics.median(seconds for seconds, _ in found)
            right = sum(is_right for _, is_right in found)
            bend = "" if before is None else f"{math.log(taken / before[1], number / before[0]):.2f}"
            print_row(name, number, f"{right} of {len(found)}", f"{1e3 * taken:.0f}", bend)
            before = number, taken


if __name__ == "__main__":
    run_bench(main)
