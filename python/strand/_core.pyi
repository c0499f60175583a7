"""The kernels in Rust. Their documentation is in the docstrings of the compiled module."""

from collections.abc import Sequence
from typing import ClassVar, Literal, SupportsIndex, TypeAlias, TypedDict, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Unpack

# fmt: off
__all__ = [
    "EndObservation", "IcpResult", "ImageFit", "NotEnoughDataError", "RopeImages", "RopeMask", "StrandError",
    "TubeFit", "TubeQueries", "Visibility", "__version__", "average_residuals", "bridge", "centerline",
    "convert_to_lab", "convolved", "copy_constant", "copy_depth", "count_cores", "count_disc_pairs",
    "count_mask_parts", "count_neighbors", "count_neighbors_each", "count_odd_pixels", "count_seen",
    "count_typical_neighbors", "count_voxels", "crop_images", "crop_points", "draw_knot", "draw_ropes",
    "end_direction", "estimate_normals", "estimate_normals_each", "estimate_radii", "evaluate_spline",
    "find_arc_lengths", "find_centroids", "find_color_pieces", "find_contacts", "find_crossed_segments",
    "find_extents", "find_linking_number", "find_median", "find_nearest", "find_order_probability",
    "find_overlaps", "find_parameters", "find_pieces_beside", "find_plane", "find_runs", "find_seen_ends",
    "find_short_outlines", "find_squared_distances", "find_standing", "find_strip_middles", "find_tabletop",
    "find_values_near", "fit_spline", "fit_tubes", "icp", "identify_knot", "interpolate", "measure_behind",
    "measure_bending", "measure_depth_bends", "measure_edge_distances", "measure_heights",
    "measure_linear_scatter", "measure_plane_errors", "measure_shift", "measure_variances", "num_threads",
    "number_blobs", "occludes", "path_length", "price_join", "propagate_covariances", "radius_outlier_mask",
    "register_in_turn", "select_beside", "set_num_threads", "straighten", "tabulate_arc_length",
    "trace_chains", "trace_skeleton", "trace_tubes", "track_frame", "unproject",
]
# fmt: on

_Floats: TypeAlias = NDArray[np.float64]
_Ints: TypeAlias = NDArray[np.int64]
_Bools: TypeAlias = NDArray[np.bool_]
_Camera: TypeAlias = tuple[tuple[float, float], tuple[float, float]]
_NonFinite: TypeAlias = Literal["raise", "drop"]
_Plane: TypeAlias = tuple[ArrayLike, float]
_Optional: TypeAlias = float | None
_TrackedCamera: TypeAlias = tuple[_Floats, _Bools, _Bools | None, _Camera, ArrayLike, float, float]
_Hold: TypeAlias = tuple[float, tuple[float, float, float], float]
_TrackedRope: TypeAlias = tuple[
    _Floats, _Floats, _Floats, _Floats, tuple[float, float], _Optional, Sequence[_Optional], Sequence[_Hold]
]
_FoundRope: TypeAlias = tuple[
    _Floats,
    _Floats,
    _Floats,
    _Floats,
    _Optional,
    list[_Optional],
    _Floats,
    _Floats,
    _Bools,
    float,
    _Optional,
]
_Codes: TypeAlias = tuple[list[int], list[int], list[list[int]], list[int]]

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
    def states(self, places: ArrayLike, radius: float) -> _Ints: ...
    def free(self, places: ArrayLike, radius: float) -> _Bools: ...
    def occluded(self, places: ArrayLike, radius: float) -> _Bools: ...
    def seen_through(self, places: ArrayLike, direction: ArrayLike, radius: float) -> _Bools: ...

@final
class TubeQueries:
    def __new__(
        cls, nodes: Sequence[ArrayLike], arc_lengths: Sequence[ArrayLike], radii: Sequence[float]
    ) -> TubeQueries: ...
    def __getnewargs__(self) -> tuple[list[_Floats], list[_Floats], list[float]]: ...
    def signed_distances(self, points: ArrayLike) -> _Floats: ...
    def nearest(self, points: ArrayLike) -> tuple[_Ints, _Floats, _Floats, _Floats]: ...
    def ray_hits(
        self, origins: ArrayLike, directions: ArrayLike
    ) -> tuple[_Floats, _Ints, _Floats, _Floats]: ...
    def swept_spheres(
        self, starts: ArrayLike, ends: ArrayLike, radius: ArrayLike
    ) -> tuple[_Floats, _Floats, _Ints, _Floats]: ...
    def swept_boxes(
        self, starts: ArrayLike, ends: ArrayLike, half_sizes: ArrayLike
    ) -> tuple[_Floats, _Floats, _Ints, _Floats]: ...

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
    def place(self) -> _Floats: ...
    @property
    def outward(self) -> _Floats: ...
    @property
    def sd(self) -> float: ...

class _TubeFitFields(TypedDict, total=False):
    curves: list[_Floats]
    motions: _Floats
    radius_classes: _Ints
    radii: _Floats
    radii_sd: _Floats
    sigma: float
    bands: _Floats
    points: _Floats
    to_camera: _Floats
    view: _Ints
    curve: _Ints
    parameter: _Floats
    residual: _Floats
    facing: _Floats
    weight: _Floats
    explained: _Bools
    inlier: _Bools
    pose_covariance: _Floats
    covariances: list[_Floats]

@final
class TubeFit:
    def __new__(
        cls,
        *,
        curves: list[_Floats],
        motions: _Floats,
        radius_classes: _Ints,
        radii: _Floats,
        radii_sd: _Floats,
        sigma: float,
        bands: _Floats,
        points: _Floats,
        to_camera: _Floats,
        view: _Ints,
        curve: _Ints,
        parameter: _Floats,
        residual: _Floats,
        facing: _Floats,
        weight: _Floats,
        explained: _Bools,
        inlier: _Bools,
        pose_covariance: _Floats,
        covariances: list[_Floats],
    ) -> TubeFit: ...
    def __getnewargs_ex__(self) -> tuple[tuple[()], _TubeFitFields]: ...
    def replace(self, **changes: Unpack[_TubeFitFields]) -> TubeFit: ...
    @property
    def curves(self) -> list[_Floats]: ...
    @property
    def motions(self) -> _Floats: ...
    @property
    def radius_classes(self) -> _Ints: ...
    @property
    def radii(self) -> _Floats: ...
    @property
    def radii_sd(self) -> _Floats: ...
    @property
    def sigma(self) -> float: ...
    @property
    def bands(self) -> _Floats: ...
    @property
    def points(self) -> _Floats: ...
    @property
    def to_camera(self) -> _Floats: ...
    @property
    def view(self) -> _Ints: ...
    @property
    def curve(self) -> _Ints: ...
    @property
    def parameter(self) -> _Floats: ...
    @property
    def residual(self) -> _Floats: ...
    @property
    def facing(self) -> _Floats: ...
    @property
    def weight(self) -> _Floats: ...
    @property
    def explained(self) -> _Bools: ...
    @property
    def inlier(self) -> _Bools: ...
    @property
    def pose_covariance(self) -> _Floats: ...
    @property
    def covariances(self) -> list[_Floats]: ...
    @property
    def pose_sd(self) -> _Floats: ...
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
    def __getnewargs__(self) -> tuple[_Floats, float, float, int, bool, str]: ...
    @property
    def transformation(self) -> _Floats: ...
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
    def controls(self) -> list[_Floats]: ...
    @property
    def nodes(self) -> list[_Floats]: ...
    @property
    def covariances(self) -> list[_Floats]: ...
    @property
    def corrections(self) -> _Floats: ...
    @property
    def reference(self) -> int: ...
    @property
    def noise(self) -> float: ...
    @property
    def scatter(self) -> tuple[float, float] | None: ...
    @property
    def lateral(self) -> float | None: ...
    @property
    def biases(self) -> _Floats: ...
    @property
    def misfit(self) -> list[float]: ...
    @property
    def areas(self) -> _Floats: ...
    @property
    def crossings(self) -> list[tuple[list[float], float]]: ...

@final
class RopeMask:
    def __new__(cls, mask: _Bools) -> RopeMask: ...
    def estimate_radius(self) -> float | None: ...
    def measure_strands(self, radius_px: float) -> tuple[float, list[_Floats]] | None: ...

@final
class RopeImages:
    def __new__(
        cls,
        depths: Sequence[ArrayLike],
        masks: Sequence[_Bools],
        cameras: Sequence[_Camera],
        poses: Sequence[ArrayLike],
        radius: float,
        mask_radii: Sequence[float | None] | None = None,
    ) -> RopeImages: ...
    @property
    def shown(self) -> _Floats: ...
    @property
    def radii(self) -> _Floats: ...
    def find_readings(
        self, ropes: SupportsIndex | None, most: SupportsIndex, views: Sequence[int]
    ) -> list[tuple[float, int, list[_Floats], int]]: ...
    def price_reading(self, view: SupportsIndex, chains: Sequence[_Floats]) -> float: ...
    def fit(
        self,
        hypotheses: Sequence[tuple[int, Sequence[_Floats]]],
        plane: _Plane | None,
        held: SupportsIndex,
        pose_sd: tuple[float, float],
        errors: tuple[float | None, float, float, float],
        iterations: SupportsIndex,
        uncertainty: bool,
        among: Sequence[int] | None = None,
    ) -> list[ImageFit | None]: ...
    def refit(
        self,
        before: ImageFit,
        plane: _Plane | None,
        held: SupportsIndex,
        pose_sd: tuple[float, float],
        errors: tuple[float | None, float, float, float],
        iterations: SupportsIndex,
    ) -> ImageFit | None: ...
    def replace_nodes(self, before: ImageFit, nodes: Sequence[ArrayLike]) -> ImageFit: ...
    def measure_depth_gains(
        self, hypotheses: Sequence[tuple[Sequence[ArrayLike], ArrayLike]], plane: _Plane, noise: float
    ) -> list[float]: ...
    def measure_end_gains(
        self,
        chains: Sequence[ArrayLike],
        ends: Sequence[ArrayLike],
        corrections: ArrayLike,
        plane: _Plane,
        noise: float,
    ) -> list[float]: ...
    def count_support(self, fit: ImageFit) -> list[tuple[_Ints, _Ints]]: ...

def crop_points(
    points: ArrayLike, pose: ArrayLike, low: ArrayLike, high: ArrayLike, colors: ArrayLike | None = None
) -> tuple[_Floats, _Floats | None]: ...
def radius_outlier_mask(
    points: ArrayLike, radius: float, min_neighbors: SupportsIndex, *, nonfinite: _NonFinite = "raise"
) -> _Bools: ...
def count_neighbors(points: ArrayLike, radius: float, *, nonfinite: _NonFinite = "raise") -> _Ints: ...
@overload
def estimate_normals(
    points: ArrayLike,
    k: SupportsIndex | None = None,
    radius: float | None = None,
    viewpoint: ArrayLike | None = None,
    *,
    variation: Literal[False] = False,
    nonfinite: _NonFinite = "raise",
) -> _Floats: ...
@overload
def estimate_normals(
    points: ArrayLike,
    k: SupportsIndex | None = None,
    radius: float | None = None,
    viewpoint: ArrayLike | None = None,
    *,
    variation: Literal[True],
    nonfinite: _NonFinite = "raise",
) -> tuple[_Floats, _Floats]: ...
@overload
def estimate_normals(
    points: ArrayLike,
    k: SupportsIndex | None = None,
    radius: float | None = None,
    viewpoint: ArrayLike | None = None,
    *,
    variation: bool,
    nonfinite: _NonFinite = "raise",
) -> _Floats | tuple[_Floats, _Floats]: ...
def icp(
    source: ArrayLike,
    target: ArrayLike,
    max_correspondence_distance: float,
    *,
    start: ArrayLike | None = None,
    target_normals: ArrayLike | None = None,
    max_iterations: SupportsIndex = 30,
    tolerance: float = 1e-6,
    nonfinite: _NonFinite = "raise",
) -> IcpResult: ...
def centerline(
    points: ArrayLike,
    normals: ArrayLike,
    radius: float,
    min_neighbors: SupportsIndex,
    *,
    nonfinite: _NonFinite = "raise",
) -> tuple[_Floats, _Ints]: ...
def trace_chains(
    points: ArrayLike,
    near: float,
    far: float,
    *,
    start: SupportsIndex | None = None,
    nonfinite: _NonFinite = "raise",
) -> list[_Ints]: ...
def convolved(image: NDArray[np.float32], kernel: Sequence[float]) -> NDArray[np.float32]: ...
def convert_to_lab(colors: NDArray[np.uint8]) -> NDArray[np.float32]: ...
def find_color_pieces(
    planes: NDArray[np.float32],
    lab: NDArray[np.float32] | None,
    chosen: _Bools | None,
    *,
    max_width: float,
    min_contrast: float,
    noise: float,
    aside: float,
    signed: bool,
) -> list[tuple[int, float, NDArray[np.int32], _Floats]]: ...
def measure_heights(
    depth: _Floats,
    camera: _Camera,
    pose: ArrayLike,
    plane: _Plane,
    within: tuple[ArrayLike, ArrayLike, ArrayLike] | None,
    height: float,
) -> tuple[_Floats, _Bools, float | None]: ...
def find_standing(
    above: _Floats,
    counts: _Bools,
    range: tuple[float, float],
    kernel: Sequence[float],
    edge: float,
    share: float,
) -> _Bools: ...
def find_plane(
    points: ArrayLike,
    compared: ArrayLike,
    corners: ArrayLike,
    width: float,
    least: tuple[float, float],
    share: float,
    rounds: SupportsIndex,
    fewest: SupportsIndex,
    adaptive: tuple[float, float] | None,
) -> tuple[_Floats, float, float] | None: ...
def measure_plane_errors(depth: _Floats, near: float) -> _Floats: ...
def count_disc_pairs(reach: float) -> _Floats: ...
def find_median(values: ArrayLike) -> float: ...
def find_values_near(values: ArrayLike, at: float, count: SupportsIndex) -> _Floats: ...
def measure_linear_scatter(places: ArrayLike, values: ArrayLike, scales: ArrayLike) -> float: ...
def find_tabletop(
    depth: _Floats, camera: _Camera, pose: ArrayLike, plane: _Plane, distance: float
) -> tuple[_Floats, _Bools]: ...
def draw_ropes(
    lab: NDArray[np.float32],
    rough: _Bools,
    away: NDArray[np.float32],
    ropes: Sequence[tuple[int, ArrayLike]],
    half_width: float,
) -> tuple[NDArray[np.int32], NDArray[np.float32]]: ...
def count_mask_parts(mask: _Bools, piece: float, hole: float) -> tuple[int, int, int]: ...
def number_blobs(mask: _Bools) -> _Ints: ...
def count_odd_pixels(mask: _Bools) -> tuple[int, int]: ...
def select_beside(
    mask: _Bools, depth: ArrayLike, reach: SupportsIndex, margin: SupportsIndex, count: float
) -> tuple[_Ints, _Ints, _Floats]: ...
def find_pieces_beside(
    chosen: _Bools,
    mask: _Bools,
    reach: float,
    unit: float,
    limits: tuple[float, float],
    margin: SupportsIndex,
) -> list[tuple[tuple[int, int], _Bools]]: ...
def find_strip_middles(mask: _Bools, least: float) -> tuple[_Ints, NDArray[np.float32], _Ints]: ...
def measure_edge_distances(mask: _Bools, most: SupportsIndex) -> NDArray[np.float32]: ...
def find_short_outlines(
    evidence: NDArray[np.float32], weights: Sequence[float], steps: SupportsIndex
) -> list[_Bools]: ...
def trace_skeleton(mask: _Bools) -> tuple[_Floats, list[tuple[_Ints, tuple[int, int]]]]: ...
def track_frame(
    cameras: Sequence[_TrackedCamera],
    ropes: Sequence[_TrackedRope],
    table: tuple[tuple[float, float, float], float] | None,
    elapsed: float,
    *,
    steps: SupportsIndex,
    bias_gain: float,
    free: bool = False,
) -> tuple[list[_FoundRope], list[float], list[float], float, int]: ...
def set_num_threads(threads: SupportsIndex) -> None: ...
def count_cores() -> int: ...
def num_threads() -> int: ...
def trace_tubes(
    points: ArrayLike,
    viewpoint: ArrayLike,
    radius: float,
    *,
    min_nodes: SupportsIndex = 4,
    nonfinite: _NonFinite = "raise",
) -> list[tuple[_Floats, _Floats]]: ...
def find_seen_ends(
    inwards: ArrayLike,
    weights: ArrayLike,
    starts: Sequence[int],
    inside: tuple[float, float],
    most: float,
    fewest: int,
) -> list[tuple[float, int, float] | None]: ...
def fit_tubes(
    points: Sequence[ArrayLike],
    viewpoints: ArrayLike,
    curves: Sequence[ArrayLike],
    motions: Sequence[ArrayLike] | _Floats,
    radius: ArrayLike,
    *,
    radius_classes: Sequence[int] | _Ints | None = None,
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
def find_extents(
    fit: TubeFit, surface_tolerance: Sequence[float] | None = None
) -> list[tuple[float, float] | None]: ...
def average_residuals(fit: TubeFit, length: float) -> tuple[_Ints, _Floats, _Floats]: ...
def estimate_radii(points: ArrayLike, viewpoint: ArrayLike, largest: float, seeds: int) -> _Floats: ...
def fit_spline(nodes: ArrayLike, spacing: float, extension: float) -> _Floats: ...
def evaluate_spline(control: ArrayLike, parameters: ArrayLike) -> tuple[_Floats, _Floats, _Floats]: ...
def interpolate(places: ArrayLike, known: ArrayLike, values: ArrayLike) -> _Floats: ...
def tabulate_arc_length(control: ArrayLike, start: float, stop: float) -> _Floats: ...
def find_parameters(table: ArrayLike, start: float, stop: float, arc_lengths: ArrayLike) -> _Floats: ...
def find_arc_lengths(table: ArrayLike, start: float, stop: float, parameters: ArrayLike) -> _Floats: ...
def propagate_covariances(covariances: ArrayLike, parameters: ArrayLike) -> _Floats: ...
def find_contacts(
    polylines: Sequence[ArrayLike], distance: float, apart: float
) -> list[tuple[int, int, int]]: ...
def find_runs(marked: _Bools) -> _Ints: ...
def path_length(nodes: ArrayLike) -> _Floats: ...
def end_direction(nodes: ArrayLike, skip: float, span: float) -> _Floats: ...
def bridge(
    before: ArrayLike, after: ArrayLike, span: float, spacing: float, reach: Sequence[float] = ...
) -> _Floats: ...
def measure_bending(nodes: ArrayLike) -> float: ...
def price_join(p: ArrayLike, leave: ArrayLike, q: ArrayLike, arrive: ArrayLike, radius: float) -> float: ...
def occludes(others: ArrayLike, stretch: ArrayLike, camera: ArrayLike, distance: float) -> bool: ...
def find_overlaps(
    places: ArrayLike, curve: _Ints, arc_length: _Floats, distance: float, apart: float
) -> _Bools: ...
def find_crossed_segments(
    nodes: _Floats, segments: _Ints, most: int | None = None
) -> tuple[_Ints, _Floats, NDArray[np.int8]]: ...
def count_typical_neighbors(points: ArrayLike, radius: float) -> int: ...
def count_seen(arc_lengths: _Floats, views: _Ints, nodes: ArrayLike) -> tuple[_Ints, _Ints]: ...
def count_voxels(points: Sequence[ArrayLike], side: float) -> int: ...
def measure_variances(points: ArrayLike, places: ArrayLike, reach: float, fewest: int) -> _Floats: ...
def measure_depth_bends(
    depths: Sequence[ArrayLike],
    cameras: Sequence[Sequence[Sequence[float]]],
    points: Sequence[ArrayLike],
    every: int,
) -> list[tuple[float, float]]: ...
def measure_behind(
    depth: ArrayLike, camera: Sequence[Sequence[float]], pose: ArrayLike, points: ArrayLike, nearest: float
) -> _Floats: ...
def find_nearest(points: ArrayLike, others: ArrayLike) -> _Ints: ...
def find_squared_distances(points: ArrayLike, others: ArrayLike) -> _Floats: ...
def copy_constant(points: ArrayLike) -> _Floats: ...
def find_centroids(clouds: Sequence[ArrayLike]) -> _Floats: ...
def measure_shift(clouds: Sequence[ArrayLike], before: ArrayLike, after: ArrayLike) -> float: ...
def copy_depth(depth: ArrayLike, farthest: float, scale: float | None = None) -> tuple[_Floats, int]: ...
def unproject(
    depth: ArrayLike,
    focal: tuple[float, float],
    center: tuple[float, float],
    mask: _Bools | None = None,
) -> _Floats: ...
def crop_images(
    depths: Sequence[ArrayLike],
    cameras: Sequence[_Camera],
    poses: Sequence[ArrayLike],
    low: ArrayLike,
    high: ArrayLike,
) -> list[_Floats]: ...
def register_in_turn(
    clouds: Sequence[ArrayLike], max_correspondence_distance: float, max_iterations: int, tolerance: float
) -> list[IcpResult]: ...
def count_neighbors_each(clouds: Sequence[ArrayLike], radius: float) -> list[_Ints]: ...
def estimate_normals_each(clouds: Sequence[ArrayLike], radius: float) -> list[_Floats]: ...
def straighten(nodes: ArrayLike, radius: float, span: float) -> _Floats: ...
def identify_knot(
    points: ArrayLike, closed: bool
) -> tuple[
    list[tuple[str | None, Literal["right", "left"] | None, float]],
    list[int] | None,
    str | None,
    list[int] | None,
    tuple[int, list[int]] | None,
    _Codes,
]: ...
def draw_knot(points: ArrayLike, closed: bool, direction: ArrayLike) -> _Codes: ...
def find_order_probability(
    points: ArrayLike, closed: bool, direction: ArrayLike, crossings: ArrayLike, strict: bool
) -> float: ...
def find_linking_number(a: ArrayLike, b: ArrayLike, closed: Sequence[bool]) -> float: ...
