"""Measure the poses and the curve after ICP and after the joint fit.

python benches/registration.py [DIR] [--only TEXT] [--seeds N]

Views of various numbers and distances see simulated ropes. Their poses are wrong, as those read off a stage.
A pose's error is the displacement of the rope's true points (root mean square), across and along the rope.

The bench also splits the error into directions of the pose. The joint fit's covariance of a pose's six
corrections, each over the reported standard deviation, has principal directions. The data fix a direction if
its standard deviation is below 0.71: then the data say more than the report. In fixed directions the error is
a displacement and an angle, beside the angle that the covariance predicts. In open directions, such as along
a straight rope and about it, it is a displacement, of the views that have open directions. The middle view is
exact and does not count. Figures are medians over the other views. The curve's error is the distance of the
longest chain's nodes from the truth (root mean square), median over scenes.

"reported" holds the poses as read off the stage, "ICP" is `Config.published()`, "joint" the default. The last
table has the same by depth noise, for the scenes of DIR or of benches/lib/collection.py.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import strand
from lib import collection
from lib.results import make_parser, run_bench
from lib.tables import format_head, print_row
from strand.config import Poses
from strand.synthetic import SyntheticScene, camera_pose, render_depth, sense

Array = NDArray[np.float64]

SHAPES = ("straight", "arc", "s", "paper")
NOISE = 0.7e-3  # metres
TURN_SD = np.radians(0.5)  # radians: error of the reported poses about the table's normal
SHIFT_SD = 1.5e-3  # metres: error of the reported poses in the table's plane
MAX_FIXED = 0.5**0.5  # standard deviation of a fixed direction, over the reported one
ALL_FIXED = 5.5  # trace of the projector from which on no direction is open
SPREADS = {
    "two views, 30° apart": (-15, 15),
    "two views, 60° apart": (-30, 30),
    "two views, 90° apart": (-45, 45),
    "two views, 180° apart": (-90, 90),
    "three views, 45° apart": (-45, 0, 45),
    "three views, 90° apart": (-90, 0, 90),
    "seven views over 180°": (-90, -60, -30, 0, 30, 60, 90),
    "one view": (0,),
}
METHODS = {
    # deviations so small that the reported poses do not move
    "reported": strand.Config(poses=Poses(rotation_sd=1e-7, translation_sd=1e-9)),
    "ICP": strand.Config.published(),
    "joint": strand.Config(),
}


@dataclass(frozen=True, eq=False)
class Directions:
    """Corrections of the poses that the data fix.

    Attributes
    ----------
    centre : (3,) ndarray
        The centre of rotations, metres.
    fixed : (V, 6, 6) ndarray
        Each view's projector on the fixed directions, for corrections over the reported deviations.
    expected : (V,) ndarray
        The angle that the covariance predicts in fixed directions, radians.
    """

    centre: Array
    fixed: Array
    expected: Array

    @classmethod
    def of(cls, model: strand.Model) -> Directions:
        """Return the directions of a joint fit."""
        sd = _make_reported_sd()
        centre = np.mean([points.mean(axis=0) for points in model.stages["filtered"]], axis=0)
        fixed, expected = [], []
        for covariance in model.stages["fit"].pose_covariance:
            variance, basis = np.linalg.eigh(covariance / sd / sd[:, None])
            kept = basis[:, variance < MAX_FIXED**2]
            fixed.append(kept @ kept.T)
            turn = sd[:3, None] * (fixed[-1] @ (covariance / sd / sd[:, None]) @ fixed[-1])[:3, :3] * sd[:3]
            expected.append(np.sqrt(np.trace(turn)))
        return cls(centre, np.array(fixed), np.array(expected))


@dataclass(frozen=True, eq=False)
class Outcome:
    """Errors of one method in one scene.

    Attributes
    ----------
    poses : (V - 1, 6) ndarray
        For each free view, the displacement across and along the rope, metres; the displacement, metres,
        the rotation and the expected rotation, radians, in fixed directions; the displacement in open ones,
        metres, NaN if there are none.
    curve : float
        Metres; NaN where there is no answer.
    """

    poses: Array
    curve: float


def simulate(name: str, azimuths: Sequence[float], seed: int) -> SyntheticScene:
    """Return a shape seen from some azimuths, degrees, with noise and wrong poses."""
    laid = strand.synthetic.scene(name, seed=seed, noise=strand.synthetic.Noise(depth=NOISE))
    distance = float(np.linalg.norm(laid.poses_true[0, :3, 3]))
    # the same errors of the poses for each distance between the views
    stage, sensor = (np.random.default_rng([seed, SHAPES.index(name), part]) for part in range(2))
    poses_true = np.stack([camera_pose(np.radians(azimuth), distance) for azimuth in azimuths])
    depth, poses = [], []
    for number, pose in enumerate(poses_true):
        exact = render_depth(laid.truth, laid.radius, laid.intrinsics, pose, laid.depth.shape[:0:-1])
        depth.append(
            sense(exact, noise=NOISE, flying=0.05, step=laid.radius, depth_scale=laid.depth_scale, rng=sensor)
        )
        turn, dx, dy = stage.normal(size=3) * (TURN_SD, SHIFT_SD, SHIFT_SD)
        if number != len(azimuths) // 2:
            pose = strand.pose_from_angles(0.0, 0.0, turn, [dx, dy, 0.0]) @ pose
        poses.append(pose)
    return replace(laid, depth=np.stack(depth), poses=np.stack(poses), poses_true=poses_true)


def _make_reported_sd() -> Array:
    """Return (6,) the standard deviations of a reported pose."""
    poses = strand.Config().poses
    return np.repeat([poses.rotation_sd, poses.translation_sd], 3)


def compute_pose_errors(
    found: Iterable[Array], true: Sequence[Array], truth: Sequence[Array], directions: Directions
) -> Array:
    """Return (V - 1, 6) the errors of all but the middle view, as in `Outcome`."""
    points = np.concatenate(truth)
    tangents = np.concatenate([np.gradient(nodes, axis=0) for nodes in truth])
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    rows = []
    for number, (pose, pose_true) in enumerate(zip(found, true, strict=True)):
        if number == len(true) // 2:
            continue
        error = pose @ np.linalg.inv(pose_true)
        moved = points @ error[:3, :3].T + error[:3, 3] - points
        along = (moved * tangents).sum(axis=1)
        across = np.linalg.norm(moved - along[:, None] * tangents, axis=1)
        turn = Rotation.from_matrix(error[:3, :3]).as_rotvec()
        shift = error[:3, :3] @ directions.centre + error[:3, 3] - directions.centre
        sd = _make_reported_sd()
        correction = np.concatenate([turn, shift]) / sd
        fixed = sd * (directions.fixed[number] @ correction)
        parts = (fixed, sd * correction - fixed)
        displaced = [np.cross(part[:3], points - directions.centre) + part[3:] for part in parts]
        sizes = [compute_rms(part) for part in (across, along, *displaced)]
        if np.trace(directions.fixed[number]) > ALL_FIXED:
            sizes[3] = np.nan
        angle = float(np.linalg.norm(fixed[:3]))
        rows.append((*sizes[:3], angle, directions.expected[number], sizes[3]))
    return np.array(rows).reshape(-1, 6)


def compute_rms(values: Array) -> float:
    """Return the root mean square of numbers, or of the lengths of vectors."""
    return float(np.sqrt((values**2).sum() / len(values)))


def measure_methods(scene: SyntheticScene) -> dict[str, Outcome]:
    """Reconstruct by every method and measure."""
    views = scene.views
    models: dict[str, strand.Model | None] = {}
    for method, config in METHODS.items():
        try:
            models[method] = strand.reconstruct(
                views, scene.radius, scene.bounds, config=config, keep_stages=method == "joint"
            )
        except strand.StrandError:
            models[method] = None
    joint = models["joint"]
    directions = None if joint is None else Directions.of(joint)
    return {method: measure_answer(scene, model, directions) for method, model in models.items()}


def measure_answer(
    scene: SyntheticScene, model: strand.Model | None, directions: Directions | None
) -> Outcome:
    """Measure one method's answer."""
    if model is None or directions is None:
        return Outcome(np.full((len(scene.poses) - 1, 6), np.nan), np.nan)
    truth = np.concatenate(
        [strand.Chain(nodes, scene.radius).at(_list_places(nodes)) for nodes in scene.truth]
    )
    distance, _ = cKDTree(truth).query(model.chains[0].points)
    return Outcome(
        compute_pose_errors(list(model.poses), list(scene.poses_true), scene.truth, directions),
        float(np.sqrt((distance**2).mean())),
    )


def _list_places(nodes: Array) -> Array:
    """Return arc lengths 0.05 mm apart."""
    length = np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum()
    return np.linspace(0.0, length, int(length / 5e-5) + 2)


def print_table(title: str, groups: dict[str, list[dict[str, Outcome]]]) -> None:
    """Print a row for each group of scenes: the medians of every method, side by side."""
    columns = ("across mm", "along mm", "fixed mm", "fixed ° (expected)", "open mm", "curve mm", "no answer")
    print(f"\n{format_head(title, *columns)}")
    for name, scenes in groups.items():
        cells = []
        for column, scale in ((0, 1e3), (1, 1e3), (2, 1e3), (3, np.degrees(1.0)), (5, 1e3)):
            cell = " / ".join(_format_median(scenes, method, column, scale) for method in METHODS)
            if column == 3:
                cell += f" ({_format_median(scenes, 'joint', 4, scale)})"
            cells.append(cell)
        curves = {method: [scene[method].curve for scene in scenes] for method in METHODS}
        cells.append(" / ".join(f"{np.nanmedian(curve) * 1e3:.2f}" for curve in curves.values()))
        cells.append(" / ".join(str(int(np.isnan(curve).sum())) for curve in curves.values()))
        print_row(name, *cells)


def _format_median(scenes: list[dict[str, Outcome]], method: str, column: int, scale: float) -> str:
    errors = np.concatenate([scene[method].poses[:, column] for scene in scenes]) * scale
    return f"{np.nanmedian(errors):.2f}" if np.isfinite(errors).any() else "–"


def main() -> int:
    parser = make_parser(__doc__)
    collection.add_arguments(parser)
    seeds = "scenes of each shape and spread (default: 6)"
    parser.add_argument("--seeds", type=int, default=6, metavar="N", help=seeds)
    arguments = parser.parse_args()
    print(f"every cell: {' / '.join(METHODS)}")
    by_spread: dict[str, list[dict[str, Outcome]]] = defaultdict(list)
    by_shape: dict[str, list[dict[str, Outcome]]] = defaultdict(list)
    for spread, azimuths in SPREADS.items():
        for name in SHAPES:
            for seed in range(arguments.seeds):
                measured = measure_methods(simulate(name, azimuths, seed))
                by_spread[spread].append(measured)
                if len(azimuths) > 1:
                    by_shape[name].append(measured)
    print_table("views", by_spread)
    print_table("shape, two views or more", by_shape)
    by_noise: dict[float, list[dict[str, Outcome]]] = defaultdict(list)
    for scene in collection.choose_scenes(arguments):
        by_noise[scene.noise].append(measure_methods(scene))
    print_table("depth noise", {f"{noise * 1e3:.1f} mm": by_noise[noise] for noise in sorted(by_noise)})
    return 0


if __name__ == "__main__":
    run_bench(main)
