"""Compare reconstructions' errors and covariances with the Cramér-Rao bound of their scenes.

python benches/limits.py [DIR] [--only TEXT]

Without DIR the scenes are those of benches/lib/collection.py. The bound holds for any unbiased estimate of
the centreline from the pixels that see it. It assumes the true radius and noise, control points as far apart
as the reconstruction's, and unknown poses with the prior of `Config.poses`. It knows which pixel sees which
place of which rope. It has no smoothness prior, so the reconstruction may be better where pixels are few.
Pixels whose angle of incidence has a cosine below 0.1 are skipped.

Errors and standard deviations are root mean squares of the two directions across the rope, over all nodes.
The normalised squared error e' C^-1 e / 2 is near 1 where covariances match. Only scenes with the right
topology count.
"""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.spatial import cKDTree

import strand
from lib import collection
from lib.calibration import STEP, Array, Truth, compute_calibration
from lib.measure import measure_chains
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.synthetic import SyntheticScene, render_depth

MIN_COSINE = 0.1  # of the angle of incidence
MAX_ERROR = 5.0  # standard deviations of the depth: farther pixels fly or see something else
RIDGE = 10.0  # radii: standard deviation of an unseen control point
DIGITS = (3, 3, 2, 3, 2)  # after the point, in the last columns
THINNING = 1e-3  # metres between places at which the bound is compared


@dataclass(frozen=True, eq=False)
class Pixels:
    """Places of the true ropes that the pixels of all views see.

    Attributes
    ----------
    surface, normal : (N, 3) ndarray
        The places on the surface, metres, and the outward unit normals there.
    precision : (N,) ndarray
        Inverse standard deviation of the distance from the surface, 1/m.
    view, place : (N,) ndarray of int64
        The view of each pixel, and its place of the truth.
    """

    surface: Array
    normal: Array
    precision: Array
    view: NDArray[np.int64]
    place: NDArray[np.int64]


def find_seen_pixels(scene: SyntheticScene, truth: Truth) -> Pixels:
    """Cast the rays of all used pixels from the true poses to the true ropes."""
    camera, (low, high) = scene.intrinsics, scene.bounds
    tree = cKDTree(truth.points)
    rows: list[tuple[Array, ...]] = []
    views = zip(scene.depth * scene.depth_scale, scene.poses, scene.poses_true, strict=True)
    for number, (image, pose, pose_true) in enumerate(views):
        exact = render_depth(scene.truth, scene.radius, camera, pose_true, image.shape[::-1], table=False)
        v, u = np.nonzero((exact > 0) & (image > 0) & (np.abs(image - exact) < MAX_ERROR * scene.noise))
        ray = np.stack(
            [(u - camera[0, 2]) / camera[0, 0], (v - camera[1, 2]) / camera[1, 1], np.ones(len(u))], axis=1
        )
        extracted = (ray * image[v, u, None]) @ pose[:3, :3].T + pose[:3, 3]
        surface = (ray * exact[v, u, None]) @ pose_true[:3, :3].T + pose_true[:3, 3]
        slant = np.linalg.norm(ray, axis=1)
        distance, place = tree.query(surface)
        normal = (surface - truth.points[place]) / distance[:, None]
        cosine = -(normal * (ray @ pose_true[:3, :3].T)).sum(axis=1) / slant
        beside = np.abs((normal * truth.tangents[place]).sum(axis=1)) < 0.1  # not on the flat ends
        kept = ((extracted >= low) & (extracted <= high)).all(axis=1) & beside & (cosine > MIN_COSINE)
        # noise along the optical axis, on the ray, and from there at right angles to the surface
        precision = 1.0 / (scene.noise * slant * cosine)
        rows.append((surface[kept], normal[kept], precision[kept], np.full(kept.sum(), number), place[kept]))
    surface, normal, precision, view, place = (np.concatenate(column) for column in zip(*rows, strict=True))
    return Pixels(surface, normal, precision, view.astype(np.int64), place.astype(np.int64))


def compute_bound(pixels: Pixels, truth: Truth, views: int, radius: float, config: strand.Config) -> Array:
    """Return (M,) the least standard deviation across the rope of unbiased estimates, metres.

    The unknowns are two for each control point, across the rope, and six for each view but the middle one.
    """
    spans = [max(round(length / (config.tubes.spacing * radius)), 1) for length in truth.lengths]
    counts = np.array(spans) + 3
    starts = np.concatenate([[0], np.cumsum(counts)])
    # control point i has its greatest weight at the parameter i - 1
    control_frames = np.concatenate(
        [
            truth.frames[np.flatnonzero(truth.rope == number)][
                np.rint(
                    np.clip((np.arange(count + 3) - 1) / count, 0, 1) * ((truth.rope == number).sum() - 1)
                ).astype(np.int64)
            ]
            for number, count in enumerate(spans)
        ]
    )
    parameter = truth.along * np.array(spans)[truth.rope]
    weights = np.zeros((len(truth.points), starts[-1]))
    for number, count in enumerate(counts):
        mine, knots = truth.rope == number, np.arange(-3.0, count + 1)
        cubic = BSpline.design_matrix(parameter[mine], knots, 3).toarray()
        weights[mine, starts[number] : starts[number + 1]] = cubic

    unknowns = 2 * starts[-1]
    slopes = np.zeros((len(pixels.view), unknowns + 6 * (views - 1)))
    turned = np.einsum("pj,cdj->pcd", pixels.normal, control_frames)
    slopes[:, :unknowns] = (weights[pixels.place][:, :, None] * turned).reshape(len(turned), unknowns)
    arm = pixels.surface - pixels.surface.mean(axis=0)
    motion = np.concatenate([np.cross(arm, pixels.normal), pixels.normal], axis=1)
    free = [number for number in range(views) if number != views // 2]
    for i, number in enumerate(free):
        mine = pixels.view == number
        slopes[mine, unknowns + 6 * i : unknowns + 6 * i + 6] = -motion[mine]
    slopes *= pixels.precision[:, None]
    pose_sd = np.repeat([config.poses.rotation_sd, config.poses.translation_sd], 3)
    prior = np.concatenate([np.full(unknowns, (RIDGE * radius) ** -2), np.tile(pose_sd**-2, views - 1)])
    covariance = np.linalg.inv(slopes.T @ slopes + np.diag(prior))[:unknowns, :unknowns]

    thinned = np.flatnonzero(np.arange(len(truth.points)) % round(THINNING / STEP) == 0)
    place = np.einsum("mc,cdj,mej->mecd", weights[thinned], control_frames, truth.frames[thinned])
    place = place.reshape(len(thinned), 2, unknowns)
    return np.asarray(np.sqrt(np.einsum("meu,uw,mew->m", place, covariance, place, optimize=True)))


def compute_rms(values: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt((values**2).mean()))


def format_values(values: Sequence[float]) -> list[str]:
    """Return the last cells of a row."""
    return [f"{value:.{digits}f}" for value, digits in zip(values, DIGITS, strict=True)]


def main() -> int:
    parser = make_parser(__doc__)
    collection.add_arguments(parser)
    arguments = parser.parse_args()
    config = strand.Config()
    errors = ("bound mm", "RMS mm", "RMS / bound", "reported sd mm", "e' C^-1 e / 2")
    print_head("scene", "noise mm", "points", *errors)
    by_noise: dict[float, list[tuple[float, ...]]] = defaultdict(list)
    for scene in collection.choose_scenes(arguments):
        name, noise = scene.name, f"{scene.noise * 1e3:.1f}"
        try:
            model = strand.reconstruct(scene.views, scene.radius, scene.bounds, config=config)
        except strand.StrandError as error:
            print_row(name, noise, f"no answer: {error}", *[""] * len(errors))
            continue
        found = measure_chains([chain.points for chain in model.chains], scene.truth, scene.radius)
        if not found.right:
            print_row(name, noise, "wrong topology", *[""] * len(errors))
            continue
        truth = Truth.of(scene.truth, scene.radius)
        pixels = find_seen_pixels(scene, truth)
        least = compute_rms(compute_bound(pixels, truth, len(scene.views), scene.radius, config))
        sd, normalised = compute_calibration(model.chains, truth)
        values = (least * 1e3, found.rms * 1e3, found.rms / least, sd * 1e3, normalised)
        by_noise[scene.noise].append(values)
        print_row(name, noise, len(pixels.view), *format_values(values))
    for level, rows in sorted(by_noise.items()):
        medians = [statistics.median(column) for column in zip(*rows, strict=True)]
        print_row(f"median of {len(rows)}", f"{level * 1e3:.1f}", "", *format_values(medians))
    return 0 if by_noise else 1


if __name__ == "__main__":
    run_bench(main)
