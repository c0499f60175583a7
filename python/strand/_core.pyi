"""The kernels in Rust. Their documentation is in the docstrings of the compiled module."""

from collections.abc import Sequence
from typing import ClassVar, Literal, SupportsIndex, TypedDict, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Unpack

__all__ = [
    "EndObservation",
    "IcpResult",
    "ImageFit",
    "NotEnoughDataError",
    "RopeImages",
    "StrandError",
    "TubeFit",
    "TubeQueries",
    "Visibility",
    "__version__",
    "apparent_radii",
    "arc_lengths",
    "bending",
    "blob_numbers",
    "bridge",
    "centerline",
    "constant_copy",
    "convolved",
    "copy_depth",
    "cores",
    "count_neighbors",
    "count_neighbors_each",
    "crop_images",
    "crop_points",
    "crossed_segments",
    "depth_bends",
    "edge_distances",
    "end_direction",
    "estimate_normals",
    "estimate_normals_each",
    "fit_tubes",
    "icp",
    "join_cost",
    "knot",
    "knot_diagram",
    "largest_blob",
    "linking_number",
    "num_threads",
    "occludes",
    "occupied_voxels",
    "order_probability",
    "overlapping",
    "path_length",
    "radius_outlier_mask",
    "register_in_turn",
    "rope_extents",
    "seen_behind",
    "set_num_threads",
    "short_outlines",
    "shown_radius",
    "spline_places",
    "spline_through",
    "squared_distances",
    "straighten",
    "trace_chains",
    "trace_tubes",
    "typical_neighbors",
    "unproject",
    "variances_around",
]

__version__: str

class StrandError(Exception): ...
class NotEnoughDataError(StrandError): ...

@final
class Visibility:
    UNKNOWN: ClassVar[int]
    OCCLUDED: ClassVar[int]
    OCCUPIED: ClassVar[int]
    FREE: ClassVar[int]
    def __new__(
        cls,
        observed: Sequence[ArrayLike | tuple[ArrayLike, tuple[float, float], tuple[float, float]]],
        about: Sequence[ArrayLike],
        poses: Sequence[ArrayLike],
    ) -> Visibility: ...
    def states(self, places: ArrayLike, radius: float) -> NDArray[np.int64]: ...
    def free(self, places: ArrayLike, radius: float) -> NDArray[np.bool_]: ...
    def occluded(self, places: ArrayLike, radius: float) -> NDArray[np.bool_]: ...
    def seen_through(self, places: ArrayLike, direction: ArrayLike, radius: float) -> NDArray[np.bool_]: ...

@final
class TubeQueries:
    def __new__(
        cls, nodes: Sequence[ArrayLike], arc_lengths: Sequence[ArrayLike], radii: Sequence[float]
    ) -> TubeQueries: ...
    def __getnewargs__(
        self,
    ) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]], list[float]]: ...
    def signed_distances(self, points: ArrayLike) -> NDArray[np.float64]: ...
    def nearest(
        self, points: ArrayLike
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]: ...
    def ray_hits(
        self, origins: ArrayLike, directions: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]: ...
    def swept_spheres(
        self, starts: ArrayLike, ends: ArrayLike, radius: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]: ...
    def swept_boxes(
        self, starts: ArrayLike, ends: ArrayLike, half_sizes: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]: ...

@final
class EndObservation:
    def __new__(
        cls, view: SupportsIndex, end: SupportsIndex, place: ArrayLike, outward: ArrayLike, sd: float
    ) -> EndObservation: ...
    def __getnewargs__(self) -> tuple[int, int, list[float], list[float], float]: ...
    @property
    def view(self) -> int: ...
    @property
    def end(self) -> int: ...
    @property
    def place(self) -> NDArray[np.float64]: ...
    @property
    def outward(self) -> NDArray[np.float64]: ...
    @property
    def sd(self) -> float: ...

class _TubeFitFields(TypedDict, total=False):
    curves: list[NDArray[np.float64]]
    motions: NDArray[np.float64]
    radius_classes: NDArray[np.int64]
    radii: NDArray[np.float64]
    radii_sd: NDArray[np.float64]
    sigma: float
    bands: NDArray[np.float64]
    points: NDArray[np.float64]
    to_camera: NDArray[np.float64]
    view: NDArray[np.int64]
    curve: NDArray[np.int64]
    parameter: NDArray[np.float64]
    residual: NDArray[np.float64]
    facing: NDArray[np.float64]
    weight: NDArray[np.float64]
    explained: NDArray[np.bool_]
    inlier: NDArray[np.bool_]
    pose_covariance: NDArray[np.float64]
    covariances: list[NDArray[np.float64]]

@final
class TubeFit:
    def __new__(
        cls,
        *,
        curves: list[NDArray[np.float64]],
        motions: NDArray[np.float64],
        radius_classes: NDArray[np.int64],
        radii: NDArray[np.float64],
        radii_sd: NDArray[np.float64],
        sigma: float,
        bands: NDArray[np.float64],
        points: NDArray[np.float64],
        to_camera: NDArray[np.float64],
        view: NDArray[np.int64],
        curve: NDArray[np.int64],
        parameter: NDArray[np.float64],
        residual: NDArray[np.float64],
        facing: NDArray[np.float64],
        weight: NDArray[np.float64],
        explained: NDArray[np.bool_],
        inlier: NDArray[np.bool_],
        pose_covariance: NDArray[np.float64],
        covariances: list[NDArray[np.float64]],
    ) -> TubeFit: ...
    def __getnewargs_ex__(self) -> tuple[tuple[()], _TubeFitFields]: ...
    def replace(self, **changes: Unpack[_TubeFitFields]) -> TubeFit: ...
    @property
    def curves(self) -> list[NDArray[np.float64]]: ...
    @property
    def motions(self) -> NDArray[np.float64]: ...
    @property
    def radius_classes(self) -> NDArray[np.int64]: ...
    @property
    def radii(self) -> NDArray[np.float64]: ...
    @property
    def radii_sd(self) -> NDArray[np.float64]: ...
    @property
    def sigma(self) -> float: ...
    @property
    def bands(self) -> NDArray[np.float64]: ...
    @property
    def points(self) -> NDArray[np.float64]: ...
    @property
    def to_camera(self) -> NDArray[np.float64]: ...
    @property
    def view(self) -> NDArray[np.int64]: ...
    @property
    def curve(self) -> NDArray[np.int64]: ...
    @property
    def parameter(self) -> NDArray[np.float64]: ...
    @property
    def residual(self) -> NDArray[np.float64]: ...
    @property
    def facing(self) -> NDArray[np.float64]: ...
    @property
    def weight(self) -> NDArray[np.float64]: ...
    @property
    def explained(self) -> NDArray[np.bool_]: ...
    @property
    def inlier(self) -> NDArray[np.bool_]: ...
    @property
    def pose_covariance(self) -> NDArray[np.float64]: ...
    @property
    def covariances(self) -> list[NDArray[np.float64]]: ...
    @property
    def pose_sd(self) -> NDArray[np.float64]: ...
    def radius(self, curve: SupportsIndex) -> float: ...
    def band(self, curve: SupportsIndex) -> float: ...

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

@final
class ImageFit:
    @property
    def controls(self) -> list[NDArray[np.float64]]: ...
    @property
    def nodes(self) -> list[NDArray[np.float64]]: ...
    @property
    def covariances(self) -> list[NDArray[np.float64]]: ...
    @property
    def corrections(self) -> NDArray[np.float64]: ...
    @property
    def reference(self) -> int: ...
    @property
    def noise(self) -> float: ...
    @property
    def scatter(self) -> tuple[float, float] | None: ...
    @property
    def lateral(self) -> float | None: ...
    @property
    def biases(self) -> NDArray[np.float64]: ...
    @property
    def misfit(self) -> list[float]: ...
    @property
    def crossings(self) -> list[tuple[list[float], float]]: ...

@final
class RopeImages:
    def __new__(
        cls,
        depths: Sequence[ArrayLike],
        masks: Sequence[NDArray[np.bool_]],
        cameras: Sequence[tuple[tuple[float, float], tuple[float, float]]],
        poses: Sequence[ArrayLike],
        radius: float,
    ) -> RopeImages: ...
    @property
    def radii(self) -> NDArray[np.float64]: ...
    def readings(
        self, ropes: SupportsIndex | None, most: SupportsIndex, views: Sequence[int]
    ) -> list[tuple[float, int, list[NDArray[np.float64]], int]]: ...
    def reading_cost(self, view: SupportsIndex, chains: Sequence[NDArray[np.float64]]) -> float: ...
    def fit(
        self,
        hypotheses: Sequence[tuple[int, Sequence[NDArray[np.float64]]]],
        plane: tuple[ArrayLike, float] | None,
        held: SupportsIndex,
        pose_sd: tuple[float, float],
        errors: tuple[float | None, float, float, float],
        iterations: SupportsIndex,
        uncertainty: bool,
    ) -> list[ImageFit | None]: ...
    def refit(
        self,
        before: ImageFit,
        plane: tuple[ArrayLike, float] | None,
        held: SupportsIndex,
        pose_sd: tuple[float, float],
        errors: tuple[float | None, float, float, float],
        iterations: SupportsIndex,
    ) -> ImageFit | None: ...
    def through(self, before: ImageFit, nodes: Sequence[ArrayLike]) -> ImageFit: ...
    def depth_gains(
        self,
        hypotheses: Sequence[tuple[Sequence[ArrayLike], ArrayLike]],
        plane: tuple[ArrayLike, float],
        noise: float,
    ) -> list[float]: ...
    def end_gains(
        self,
        chains: Sequence[ArrayLike],
        ends: Sequence[ArrayLike],
        corrections: ArrayLike,
        plane: tuple[ArrayLike, float],
        noise: float,
    ) -> list[float]: ...
    def support(self, fit: ImageFit) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]: ...

def crop_points(
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
def convolved(image: NDArray[np.float32], kernel: Sequence[float]) -> NDArray[np.float32]: ...
def largest_blob(mask: NDArray[np.bool_]) -> int: ...
def blob_numbers(mask: NDArray[np.bool_]) -> NDArray[np.int64]: ...
def edge_distances(mask: NDArray[np.bool_], most: SupportsIndex) -> NDArray[np.float32]: ...
def short_outlines(
    evidence: NDArray[np.float32], weights: Sequence[float], steps: SupportsIndex
) -> list[NDArray[np.bool_]]: ...
def shown_radius(mask: NDArray[np.bool_]) -> float | None: ...
def set_num_threads(threads: SupportsIndex) -> None: ...
def cores() -> int: ...
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
    motions: Sequence[ArrayLike] | NDArray[np.float64],
    radius: ArrayLike,
    *,
    radius_classes: Sequence[int] | NDArray[np.int64] | None = None,
    pose_sd: ArrayLike,
    reference: SupportsIndex | None,
    fit_curves: bool = True,
    radius_prior: ArrayLike | None = None,
    along_ray: bool = False,
    band: ArrayLike = (0.6, 0.4),
    iterations: SupportsIndex = 12,
    tolerance: float = 0.1,
    min_bend: float = 1.5,
    noise: float | None = None,
    shared: ArrayLike = (1.0, 1.0),
    bounds: ArrayLike | tuple[ArrayLike, ArrayLike] | None = None,
    end_observations: Sequence[EndObservation] = (),
    previous: TubeFit | None = None,
    uncertainty: bool = True,
) -> TubeFit: ...
def rope_extents(
    fit: TubeFit, surface_tolerance: Sequence[float] | None = None
) -> list[tuple[float, float] | None]: ...
def apparent_radii(
    points: ArrayLike, viewpoint: ArrayLike, largest: float, seeds: int
) -> NDArray[np.float64]: ...
def spline_through(nodes: ArrayLike, spacing: float, extension: float) -> NDArray[np.float64]: ...
def spline_places(
    control: ArrayLike, parameters: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]: ...
def arc_lengths(control: ArrayLike, start: float, stop: float) -> NDArray[np.float64]: ...
def path_length(nodes: ArrayLike) -> NDArray[np.float64]: ...
def end_direction(nodes: ArrayLike, skip: float, span: float) -> NDArray[np.float64]: ...
def bridge(
    before: ArrayLike, after: ArrayLike, span: float, spacing: float, reach: Sequence[float] = ...
) -> NDArray[np.float64]: ...
def bending(nodes: ArrayLike) -> float: ...
def join_cost(p: ArrayLike, leave: ArrayLike, q: ArrayLike, arrive: ArrayLike, radius: float) -> float: ...
def occludes(others: ArrayLike, stretch: ArrayLike, camera: ArrayLike, distance: float) -> bool: ...
def overlapping(
    places: ArrayLike,
    curve: NDArray[np.int64],
    arc_length: NDArray[np.float64],
    distance: float,
    apart: float,
) -> NDArray[np.bool_]: ...
def crossed_segments(
    nodes: NDArray[np.float64], segments: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int8]]: ...
def typical_neighbors(points: ArrayLike, radius: float) -> int: ...
def occupied_voxels(points: Sequence[ArrayLike], side: float) -> int: ...
def variances_around(
    points: ArrayLike, places: ArrayLike, reach: float, fewest: int
) -> NDArray[np.float64]: ...
def depth_bends(
    depths: Sequence[ArrayLike],
    cameras: Sequence[Sequence[Sequence[float]]],
    points: Sequence[ArrayLike],
    every: int,
) -> list[tuple[float, float]]: ...
def seen_behind(
    depth: ArrayLike,
    camera: Sequence[Sequence[float]],
    pose: ArrayLike,
    points: ArrayLike,
    nearest: float,
) -> NDArray[np.float64]: ...
def squared_distances(points: ArrayLike, others: ArrayLike) -> NDArray[np.float64]: ...
def constant_copy(points: ArrayLike) -> NDArray[np.float64]: ...
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
def knot(
    points: ArrayLike, closed: bool
) -> tuple[
    list[tuple[str | None, Literal["right", "left"] | None, float]],
    list[int] | None,
    str | None,
    list[int] | None,
    tuple[int, list[int]] | None,
    tuple[list[int], list[int], list[list[int]], list[int]],
]: ...
def knot_diagram(
    points: ArrayLike, closed: bool, direction: ArrayLike
) -> tuple[list[int], list[int], list[list[int]], list[int]]: ...
def order_probability(
    points: ArrayLike, closed: bool, direction: ArrayLike, crossings: ArrayLike, strict: bool
) -> float: ...
def linking_number(a: ArrayLike, b: ArrayLike, closed: Sequence[bool]) -> float: ...
