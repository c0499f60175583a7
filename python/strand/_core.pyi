"""The kernels in Rust. Their documentation is in the docstrings of the compiled module."""

from collections.abc import Sequence
from typing import Any, Literal, SupportsIndex, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "IcpResult",
    "NotEnoughDataError",
    "Sight",
    "StrandError",
    "__version__",
    "arc_lengths",
    "bending",
    "bridge",
    "centerline",
    "copy_depth",
    "count_neighbors",
    "count_neighbors_each",
    "crop",
    "crop_images",
    "crowded",
    "end_direction",
    "estimate_normals",
    "estimate_normals_each",
    "fit_tubes",
    "hides",
    "icp",
    "join_cost",
    "num_threads",
    "occupied_cubes",
    "path_length",
    "radius_outlier_mask",
    "register_in_turn",
    "set_num_threads",
    "spline_places",
    "spline_through",
    "straighten",
    "string_parts",
    "strip_radii",
    "trace_chains",
    "trace_tubes",
    "unproject",
    "usual_neighbors",
]

__version__: str

class StrandError(Exception): ...
class NotEnoughDataError(StrandError): ...

@final
class Sight:
    def __new__(
        cls,
        saw: Sequence[ArrayLike | tuple[ArrayLike, tuple[float, float], tuple[float, float]]],
        about: Sequence[ArrayLike],
        poses: Sequence[ArrayLike],
    ) -> Sight: ...
    def states(self, places: ArrayLike, radius: float) -> NDArray[np.int64]: ...
    def empty(self, places: ArrayLike, radius: float) -> NDArray[np.bool_]: ...
    def hidden(self, places: ArrayLike, radius: float) -> NDArray[np.bool_]: ...
    def seen_through(self, places: ArrayLike, direction: ArrayLike, radius: float) -> NDArray[np.bool_]: ...

@final
class IcpResult:
    def __new__(
        cls,
        transformation: ArrayLike,
        fitness: float,
        inlier_rmse: float,
        iterations: int,
        converged: bool,
        stop: str,
    ) -> IcpResult: ...
    def __getnewargs__(self) -> tuple[NDArray[np.float64], float, float, int, bool, str]: ...
    @property
    def transformation(self) -> NDArray[np.float64]: ...
    @property
    def fitness(self) -> float: ...
    @property
    def inlier_rmse(self) -> float: ...
    @property
    def iterations(self) -> int: ...
    @property
    def converged(self) -> bool: ...
    @property
    def stop(self) -> Literal["tolerance", "iterations", "too few correspondences", "degenerate"]: ...

def crop(
    points: ArrayLike, pose: ArrayLike, low: ArrayLike, high: ArrayLike, colors: ArrayLike | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]: ...
def radius_outlier_mask(
    points: ArrayLike,
    radius: float,
    min_neighbors: SupportsIndex,
    *,
    nonfinite: Literal["raise", "drop"] = "raise",
) -> NDArray[np.bool_]: ...
def count_neighbors(
    points: ArrayLike, radius: float, *, nonfinite: Literal["raise", "drop"] = "raise"
) -> NDArray[np.int64]: ...
@overload
def estimate_normals(
    points: ArrayLike,
    k: SupportsIndex | None = None,
    radius: float | None = None,
    viewpoint: ArrayLike | None = None,
    *,
    variation: Literal[False] = False,
    nonfinite: Literal["raise", "drop"] = "raise",
) -> NDArray[np.float64]: ...
@overload
def estimate_normals(
    points: ArrayLike,
    k: SupportsIndex | None = None,
    radius: float | None = None,
    viewpoint: ArrayLike | None = None,
    *,
    variation: Literal[True],
    nonfinite: Literal["raise", "drop"] = "raise",
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
@overload
def estimate_normals(
    points: ArrayLike,
    k: SupportsIndex | None = None,
    radius: float | None = None,
    viewpoint: ArrayLike | None = None,
    *,
    variation: bool,
    nonfinite: Literal["raise", "drop"] = "raise",
) -> NDArray[np.float64] | tuple[NDArray[np.float64], NDArray[np.float64]]: ...
def icp(
    source: ArrayLike,
    target: ArrayLike,
    max_correspondence_distance: float,
    *,
    start: ArrayLike | None = None,
    target_normals: ArrayLike | None = None,
    max_iterations: SupportsIndex = 30,
    tolerance: float = 1e-6,
    nonfinite: Literal["raise", "drop"] = "raise",
) -> IcpResult: ...
def centerline(
    points: ArrayLike,
    normals: ArrayLike,
    radius: float,
    min_neighbors: SupportsIndex,
    *,
    nonfinite: Literal["raise", "drop"] = "raise",
) -> tuple[NDArray[np.float64], NDArray[np.int64]]: ...
def trace_chains(
    points: ArrayLike,
    near: float,
    far: float,
    *,
    start: SupportsIndex | None = None,
    nonfinite: Literal["raise", "drop"] = "raise",
) -> list[NDArray[np.int64]]: ...
def set_num_threads(threads: SupportsIndex) -> None: ...
def num_threads() -> int: ...
def trace_tubes(
    points: ArrayLike,
    viewpoint: ArrayLike,
    radius: float,
    *,
    min_nodes: SupportsIndex = 4,
    nonfinite: Literal["raise", "drop"] = "raise",
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]: ...
def fit_tubes(
    points: Sequence[ArrayLike],
    viewpoints: ArrayLike,
    curves: Sequence[ArrayLike],
    ropes: Sequence[int] | NDArray[np.int64],
    motions: Sequence[ArrayLike] | NDArray[np.float64],
    radii: Sequence[float] | NDArray[np.float64],
    *,
    fit_curves: bool = True,
    radius_prior: Sequence[Sequence[float]] | NDArray[np.float64] | None = None,
    reference: int | None,
    pose_sd: Sequence[float] | NDArray[np.float64],
    along_ray: bool = False,
    band: Sequence[float] | NDArray[np.float64] = (0.6, 0.4),
    iterations: int = 12,
    tolerance: float = 0.1,
    min_bend: float = 1.5,
    noise: float | None = None,
    bounds: Sequence[Sequence[float]] | tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
    ends: Sequence[tuple[int, int, NDArray[np.float64], NDArray[np.float64], float]],
    feet: tuple[NDArray[np.int64], NDArray[np.float64]] | None = None,
    uncertainty: bool = True,
) -> dict[str, Any]: ...
def strip_radii(
    points: ArrayLike, viewpoint: Sequence[float], largest: float, seeds: int
) -> NDArray[np.float64]: ...
def spline_through(nodes: ArrayLike, spacing: float, extension: float) -> NDArray[np.float64]: ...
def spline_places(
    control: ArrayLike, parameters: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]: ...
def arc_lengths(control: ArrayLike, start: float, stop: float) -> NDArray[np.float64]: ...
def string_parts(
    curves: Sequence[ArrayLike],
    ropes: Sequence[int],
    radii: Sequence[float],
    counted: NDArray[np.bool_],
    curve: NDArray[np.int64],
    parameter: NDArray[np.float64],
    points: ArrayLike,
    to_camera: ArrayLike,
    slack: Sequence[float] | None,
) -> list[tuple[float, float] | None]: ...
def path_length(nodes: ArrayLike) -> NDArray[np.float64]: ...
def end_direction(nodes: ArrayLike, skip: float, span: float) -> NDArray[np.float64]: ...
def bridge(
    before: ArrayLike, after: ArrayLike, span: float, spacing: float, reach: tuple[float, float]
) -> NDArray[np.float64]: ...
def bending(nodes: ArrayLike) -> float: ...
def join_cost(p: ArrayLike, leave: ArrayLike, q: ArrayLike, arrive: ArrayLike, radius: float) -> float: ...
def hides(others: ArrayLike, stretch: ArrayLike, camera: ArrayLike, distance: float) -> bool: ...
def crowded(
    places: ArrayLike, strands: NDArray[np.int64], lengths: NDArray[np.float64], contact: float, own: float
) -> NDArray[np.bool_]: ...
def usual_neighbors(points: ArrayLike, radius: float) -> int: ...
def occupied_cubes(points: Sequence[ArrayLike], side: float) -> int: ...
def copy_depth(depth: ArrayLike, farthest: float) -> tuple[NDArray[np.float64], int]: ...
def unproject(
    depth: ArrayLike, focal: tuple[float, float], center: tuple[float, float]
) -> NDArray[np.float64]: ...
def crop_images(
    depths: Sequence[ArrayLike],
    cameras: Sequence[tuple[tuple[float, float], tuple[float, float]]],
    poses: Sequence[ArrayLike],
    low: ArrayLike,
    high: ArrayLike,
) -> list[NDArray[np.float64]]: ...
def register_in_turn(
    clouds: Sequence[ArrayLike], max_correspondence_distance: float, max_iterations: int, tolerance: float
) -> list[IcpResult]: ...
def count_neighbors_each(clouds: Sequence[ArrayLike], radius: float) -> list[NDArray[np.int64]]: ...
def estimate_normals_each(clouds: Sequence[ArrayLike], radius: float) -> list[NDArray[np.float64]]: ...
def straighten(nodes: ArrayLike, radius: float, span: float) -> NDArray[np.float64]: ...
