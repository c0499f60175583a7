"""How far from the limit: scenes' Cramér-Rao bounds beside the reconstructions' errors and covariances.

python benches/limits.py [DIR] [--only TEXT]

Without DIR the scenes are those of benches/lib/collection.py. The bound is that of any unbiased estimate of
the centreline from the pixels that see it, given the radius and the depths' noise, with control points as far
apart as the reconstruction's and with poses that are unknown but for the prior of `Config.poses`. It knows
which pixel sees which place of which rope; it has no smoothness prior, so the reconstruction may be better
where pixels are few. Pixels seen under a cosine of incidence below 0.1 are left out.

Errors and standard deviations count the two directions across the rope: root mean squares over the nodes of
their length. The normalised squared error e' C^-1 e / 2 is near 1 where the covariances tell the truth. Only
scenes whose topology is right are counted.
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
from lib.measure import measure_chains
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.synthetic import SyntheticScene, render_depth

Array = NDArray[np.float64]

STEP = 1e-4  # metres between the places of the true curves that pixels are matched with
LEAST_COSINE = 0.1
OUTLIER = 5.0  # standard deviations of the depth: pixels farther off fly or see something else
RIDGE = 10.0  # radii: standard deviation of a control point that nothing sees
DIGITS = (3, 3, 2, 3, 2)  # of the last columns


@dataclass(frozen=True, eq=False)
class Truth:
    """True centrelines, densely.

    Attributes
    ----------
    points, tangents : (M, 3) ndarray
        Metres; unit vectors.
    frames : (M, 2, 3) ndarray
        Two unit vectors across each tangent.
    rope : (M,) ndarray of int64
        Which rope each place is of.
    along : (M,) ndarray
        Arc length over the rope's length.
    lengths : list of float
        Metres.
    """

    points: Array
    tangents: Array
    frames: Array
    rope: NDArray[np.int64]
    along: Array
    lengths: list[float]

    @classmethod
    def of(cls, ropes: tuple[Array, ...], radius: float) -> Truth:
        """Sample ropes."""
        points, tangents, along, lengths = [], [], [], []
        for nodes in ropes:
            chain = strand.Chain(nodes, radius)
            s = np.linspace(0.0, chain.length, round(chain.length / STEP) + 1)
            places = chain.at(s)
            slope = np.gradient(places, axis=0)
            points.append(places)
            tangents.append(slope / np.linalg.norm(slope, axis=1, keepdims=True))
            along.append(s / chain.length)
            lengths.append(chain.length)
        tangent = np.concatenate(tangents)
        return cls(
            np.concatenate(points),
            tangent,
            make_frames(tangent),
            np.repeat(np.arange(len(points)), [len(places) for places in points]),
            np.concatenate(along),
            lengths,
        )


@dataclass(frozen=True, eq=False)
class Pixels:
    """What the pixels of all views see of the true ropes.

    Attributes
    ----------
    surface, normal : (N, 3) ndarray
        Where their rays meet the surface, metres, and the outward unit normal there.
    precision : (N,) ndarray
        Inverse standard deviation of the distance from the surface that they tell of, 1/m.
    view, place : (N,) ndarray of int64
        Which view they are of, and which place of the truth they see.
    """

    surface: Array
    normal: Array
    precision: Array
    view: NDArray[np.int64]
    place: NDArray[np.int64]


def make_frames(tangents: Array) -> Array:
    """(M, 2, 3) Two unit vectors at right angles to each tangent and to each other."""
    least = np.eye(3)[np.abs(tangents).argmin(axis=1)]
    first = np.cross(tangents, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(tangents, first)], axis=1)


def find_seen_pixels(scene: SyntheticScene, truth: Truth) -> Pixels:
    """Cast the rays of all pixels that took part, from the true poses, to the true ropes."""
    camera, (low, high) = scene.intrinsics, scene.bounds
    tree = cKDTree(truth.points)
    rows: list[tuple[Array, ...]] = []
    views = zip(scene.depth * scene.depth_scale, scene.poses, scene.poses_true, strict=True)
    for number, (image, pose, pose_true) in enumerate(views):
        exact = render_depth(scene.truth, scene.radius, camera, pose_true, image.shape[::-1], table=False)
        v, u = np.nonzero((exact > 0) & (image > 0) & (np.abs(image - exact) < OUTLIER * scene.noise))
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
        kept = ((extracted >= low) & (extracted <= high)).all(axis=1) & beside & (cosine > LEAST_COSINE)
        # noise along the optical axis, on the ray, and from there at right angles to the surface
        precision = 1.0 / (scene.noise * slant * cosine)
        rows.append((surface[kept], normal[kept], precision[kept], np.full(kept.sum(), number), place[kept]))
    surface, normal, precision, view, place = (np.concatenate(column) for column in zip(*rows, strict=True))
    return Pixels(surface, normal, precision, view.astype(np.int64), place.astype(np.int64))


def compute_bound(pixels: Pixels, truth: Truth, views: int, radius: float, config: strand.Config) -> Array:
    """(M,) Least standard deviation across the rope of unbiased estimates of the places of the truth.

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

    thinned = np.flatnonzero(np.arange(len(truth.points)) % round(1e-3 / STEP) == 0)
    place = np.einsum("mc,cdj,mej->mecd", weights[thinned], control_frames, truth.frames[thinned])
    place = place.reshape(len(thinned), 2, unknowns)
    return np.asarray(np.sqrt(np.einsum("meu,uw,mew->m", place, covariance, place, optimize=True)))


def compute_calibration(chains: tuple[strand.Chain, ...], truth: Truth) -> tuple[float, float]:
    """Root mean square of the reported standard deviation, metres, and normalised squared error."""
    tree = cKDTree(truth.points)
    variances, squares = [], []
    for chain in chains:
        if chain.covariance is None:
            continue
        _, place = tree.query(chain.points)
        error = chain.points - truth.points[place]
        frame = truth.frames[place]
        covariance = np.einsum("mai,mij,mbj->mab", frame, chain.covariance, frame)
        error = np.einsum("mai,mi->ma", frame, error)
        inside = (truth.along[place] > 0.0) & (truth.along[place] < 1.0)
        variances.append(np.trace(covariance, axis1=1, axis2=2)[inside])
        solved = np.linalg.solve(covariance, error[..., None])[..., 0]
        squares.append(((error * solved).sum(axis=1) / 2)[inside])
    return float(np.sqrt(np.concatenate(variances).mean())), float(np.concatenate(squares).mean())


def compute_rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))


def format_values(values: Sequence[float]) -> list[str]:
    """The last columns of a row."""
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
