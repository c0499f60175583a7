"""Check whether covariances match the errors, for independent noise and for noise that neighbours share.

python benches/deviations.py [--seeds N]

Each row has the shapes of `SHAPES`, with N seeds from 50 on. Depths have normal errors: independent ones, or
errors smoothed with a Gaussian and scaled to the same standard deviation. The normalised error of a chain is
the root of the mean of e' C^-1 e / 2 over its nodes. Here e is a node's error across the rope, and C the
covariance there. It is near 1 where covariances match. Only scenes with the right topology count.

The second table has the same shapes through each of `strand.synthetic.CAMERAS`, with masks up to a pixel too
wide or too narrow. The radius and the number of ropes are given. These answers come from images.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

import strand
from lib.calibration import Truth, compute_calibration
from lib.imitated_scenes import make_imitated
from lib.measure import measure_chains
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand import synthetic
from strand.synthetic import SyntheticScene

SHAPES = ("s", "arc", "overhand", "paper")
# noise, metres, and its correlation, pixels
CASES = ((0.3e-3, 0.0), (0.7e-3, 0.0), (1.5e-3, 0.0), (0.7e-3, 1.0), (0.7e-3, 1.5), (0.7e-3, 2.5))
VIEWS = (1, 3, 7)  # of plain noise
CAMERA_VIEWS = (1, 3)  # of imitated cameras
FIRST_SEED = 50  # of each shape


def smooth_noise(shape: tuple[int, int], correlation: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return (H, W) normal errors of standard deviation 1, smoothed over `correlation` pixels."""
    margin = math.ceil(4.0 * correlation)
    height, width = shape
    smooth = gaussian_filter(rng.normal(size=(height + 2 * margin, width + 2 * margin)), correlation)
    impulse = np.zeros((2 * margin + 1, 2 * margin + 1))
    impulse[margin, margin] = 1.0
    scale = np.sqrt((gaussian_filter(impulse, correlation, mode="constant") ** 2).sum())
    return np.asarray(smooth[margin : margin + height, margin : margin + width] / scale)


def make_scene(shape: str, seed: int, noise: float, correlation: float, views: int) -> SyntheticScene:
    """Return a shape whose depths have errors that are correlated over `correlation` pixels."""
    if correlation == 0.0:
        return synthetic.scene(shape, seed=seed, noise=synthetic.Noise(depth=noise), views=views)
    exact = synthetic.scene(shape, seed=seed, noise=synthetic.Noise(depth=0.0), views=views)
    rng = np.random.default_rng(seed)
    units = [
        np.where(image > 0, np.rint(image + noise / exact.depth_scale * smooth), 0).astype(np.uint16)
        for image in exact.depth
        for smooth in [smooth_noise(image.shape, correlation, rng)]
    ]
    return dataclasses.replace(exact, depth=np.stack(units), noise=noise)


def format_cells(scenes: Iterable[SyntheticScene], ropes: int | None) -> tuple[str, ...]:
    """Return the last cells of a row: normalised errors, errors, and how many scenes count."""
    found, count = [], 0
    for drawn in scenes:
        count += 1
        try:
            model = strand.reconstruct(drawn.views, drawn.radius, drawn.bounds, ropes=ropes)
        except strand.StrandError:
            continue
        error = measure_chains([chain.points for chain in model.chains], drawn.truth, drawn.radius)
        if error.right:
            sd, square = compute_calibration(model.chains, Truth.of(drawn.truth, drawn.radius))
            found.append((math.sqrt(square), error.rms * 1e3, sd * 1e3))
    low, middle, high = np.percentile([each[0] for each in found], [10, 50, 90])
    rms, sd = np.median(found, axis=0)[1:]
    return (
        f"{middle:.2f}",
        f"{low:.2f} to {high:.2f}",
        f"{rms:.3f}",
        f"{sd:.3f}",
        f"{len(found)} of {count}",
    )


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--seeds", type=int, default=4, metavar="N", help="of each shape (default: 4)")
    arguments = parser.parse_args()
    chosen = list(product(SHAPES, range(FIRST_SEED, FIRST_SEED + arguments.seeds)))
    titles = ("views", "normalised error", "10 to 90 %", "RMS mm", "reported sd mm", "right")
    print_head("noise mm", "correlation px", *titles)
    for noise, correlation in CASES:
        for views in VIEWS:
            cells = format_cells(
                (make_scene(shape, seed, noise, correlation, views) for shape, seed in chosen), None
            )
            print_row(f"{noise * 1e3:.1f}", f"{correlation:g}", views, *cells)
    print()
    print_head("camera", *titles)
    for camera, views in product(synthetic.CAMERAS, CAMERA_VIEWS):
        cells = format_cells((make_imitated(shape, shape, camera, views, seed) for shape, seed in chosen), 1)
        print_row(camera, views, *cells)
    return 0


if __name__ == "__main__":
    run_bench(main)
