"""Imitated depth cameras, with the wide, correlated errors of stereo and time-of-flight cameras.

This is a statistical model of the errors, not a stereo matcher. A stereo camera measures disparity over a
window: it smooths steps, displaces edges, and gives neighbouring pixels correlated errors. A time-of-flight
camera measures depth, and mixes it at edges with the depth of the background.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.support.checks import (
    Array,
    check_finite_array,
    check_instance,
    check_intrinsics,
    check_nonnegative,
    check_positive,
    check_sequence,
    check_text,
)
from strand.synthetic.fields import check_pixels, dilate, draw_field

_MIN_BEND = 1e-6  # relative change of the inverse depth's slope at a pixel: above it, not a plane
_MIN_STEP = 3e-3  # relative change of the inverse depth's slope at a pixel: above it, a step in depth
_BATCH_SIZE = 1 << 21  # window pixels that are averaged at once: bounds the memory
_WINDOW_REACH = 2.0  # standard deviations of a window: it is zero beyond this
_SAMPLE_STEP = 2.0  # pixels of a window's standard deviation per pixel between its samples
_EDGE_SMOOTHNESS = 2.0  # pixels: smoothness of the edges' displacement
_SIZE_SMOOTHNESS = 6.0  # pixels: smoothness of the error's size


@dataclass(frozen=True)
class DepthCamera:
    """The errors of a depth camera.

    With a `baseline`, it is a stereo camera with errors in pixels of disparity, which is the focal length
    times the baseline over the depth. Without a `baseline`, it measures the time of flight, with errors in
    metres. This is the unit of `sd`, `limit`, `period`, `amplitude` and `step`. The other lengths are in
    pixels of the image.

    Attributes
    ----------
    name : str
    baseline : float or None
        Distance between the two cameras of a stereo pair, metres; None for time of flight.
    sd : float
        Standard deviation of the error on a surface.
    grain : tuple of (float, float)
        The error is a sum of normal fields. Each pair holds a field's smoothness, which is the standard
        deviation of a Gaussian in pixels (0: independent pixels), and its share of the variance. strand
        normalizes the shares to a sum of 1.
    uneven : float
        Standard deviation of the logarithm of the error's size, which varies over the image.
    window : float
        Standard deviation of the Gaussian window over which the camera averages; 0 for no average.
    limit : float
        Standard deviation of a Gaussian weight of the difference to the pixel's own value. In a window with a
        larger step, one side dominates.
    background : float
        Weight of values beyond the middle of the window's range of depths, relative to nearer ones.
    lateral : float
        Standard deviation of the edges' displacement.
    period, amplitude : float
        A periodic error, which attracts disparities to multiples of the period and makes depths oscillate. An
        amplitude of `period` / 2 pi makes steps.
    step : float
        Step to which the results are rounded; 0 for no rounding.
    missing, missing_edge : float
        Fraction of the pixels without depth, from 0 to 1, on surfaces and next to steps.
    patch : float
        Standard deviation of the Gaussian that shapes the patches without depth; 0 for independent pixels.

    Raises
    ------
    TypeError
        If a value is not a number.
    ValueError
        If a number is negative, not finite or out of its range, or no field of `grain` has a share.
    """

    name: str
    baseline: float | None
    sd: float
    grain: tuple[tuple[float, float], ...] = ((1.0, 1.0),)
    uneven: float = 0.0
    window: float = 0.0
    limit: float = 1e3
    background: float = 1.0
    lateral: float = 0.0
    period: float = 1.0
    amplitude: float = 0.0
    step: float = 0.0
    missing: float = 0.0
    missing_edge: float = 0.0
    patch: float = 1.5

    def __post_init__(self) -> None:
        check_text("name", self.name)
        if self.baseline is not None:
            check_positive("baseline", self.baseline)
        for name in ("sd", "uneven", "background", "amplitude", "step"):
            check_nonnegative(name, getattr(self, name))
        for name in ("limit", "period"):
            check_positive(name, getattr(self, name))
        for name in ("window", "lateral", "patch"):
            check_pixels(name, getattr(self, name))
        for name in ("missing", "missing_edge"):
            if check_nonnegative(name, getattr(self, name)) > 1:
                raise ValueError(f"{name}: expected a fraction from 0 to 1, got {getattr(self, name)}")
        for i, part in enumerate(check_sequence("grain", self.grain, "pairs")):
            pair = check_sequence(f"grain[{i}]", part, "a smoothness and a share")
            if len(pair) != 2:
                raise ValueError(f"grain[{i}]: expected a smoothness and a share, got {len(pair)} entries")
            check_pixels(f"grain[{i}][0]", pair[0])
            check_nonnegative(f"grain[{i}][1]", pair[1])
        if not sum(share for _, share in self.grain) > 0:
            raise ValueError("grain: expected at least one field with a share above 0")

    @property
    def correlation_length(self) -> float:
        """Distance at which the errors of two pixels on a surface have a correlation of 1/e, pixels."""
        total = sum(share for _, share in self.grain)

        def is_correlated(distance: float) -> bool:
            # the autocorrelation of a smoothed field is a Gaussian of twice the variance
            parts = [
                share * math.exp(-0.25 * (distance / smoothness) ** 2)
                for smoothness, share in self.grain
                if smoothness > 0
            ]
            return sum(parts) > total / math.e

        low, high = 0.0, 4.0 * max(smoothness for smoothness, _ in self.grain)
        for _ in range(50):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if is_correlated(middle) else (low, middle)
        return low

    def with_noise(self, noise: float, focal_length: float, distance: float) -> DepthCamera:
        """Return this camera with another standard deviation of the error.

        Parameters
        ----------
        noise : float
            Standard deviation of the error along the camera's z axis, metres.
        focal_length : float
            Focal length of the image, pixels.
        distance : float
            Depth at which the error has this size, metres.

        Returns
        -------
        DepthCamera

        Raises
        ------
        TypeError
            If an argument is not a number.
        ValueError
            If `noise` is negative, or another argument is not positive.
        """
        noise = check_nonnegative("noise", noise)
        to_disparity = (
            check_positive("focal_length", focal_length) / check_positive("distance", distance) ** 2
        )
        # the disparity is f b / z
        return replace(self, sd=noise if self.baseline is None else noise * to_disparity * self.baseline)

    def sense(
        self, depth: ArrayLike, intrinsics: ArrayLike, *, depth_scale: float, rng: np.random.Generator
    ) -> NDArray[np.uint16]:
        """Return the depth image that the camera measures, from an exact one.

        Parameters
        ----------
        depth : (H, W) array_like
            Exact depths along the camera's z axis, metres; 0 for no return.
        intrinsics : (3, 3) array_like
            The pinhole matrix, pixels.
        depth_scale : float
            Metres per unit of the result.
        rng : numpy.random.Generator
            The random number generator.

        Returns
        -------
        (H, W) ndarray of uint16
            Depths in units of `depth_scale`, rounded; 0 for no depth and for depths beyond uint16.

        Raises
        ------
        TypeError
            If an array does not hold numbers, or `rng` is not a generator.
        ValueError
            If `depth` is not two-dimensional, finite and not negative, the intrinsics are not a pinhole's, or
            `depth_scale` is not positive.
        """
        exact = check_finite_array("depth", depth, ("H", "W"))
        if (exact < 0).any():
            raise ValueError(f"depth: expected depths >= 0, got {exact.min()}")
        focal_length = float(check_intrinsics("intrinsics", intrinsics)[0, 0])
        depth_scale = check_positive("depth_scale", depth_scale)
        check_instance("rng", rng, np.random.Generator)
        returned = exact > 0
        inverse = np.divide(1.0, exact, out=np.zeros_like(exact), where=returned)
        bend = _compute_bend(inverse)
        bent, steps = bend > _MIN_BEND * inverse, bend > _MIN_STEP * inverse
        # a plane's disparity is linear in the image, so its mean over a window is the pixel's own value
        near_bend = dilate(bent, math.ceil(_WINDOW_REACH * self.window)) & returned
        to_disparity = None if self.baseline is None else focal_length * self.baseline
        measured = exact if to_disparity is None else to_disparity * inverse
        # the draws do not depend on the parameters: with another error, the same pixels lack depth
        measured = self._displace(measured, near_bend, returned, rng)
        with np.errstate(under="ignore"):  # weights across a large step
            measured = self._average(measured, near_bend, returned)
        error, total = np.zeros_like(exact), sum(share for _, share in self.grain)
        for smoothness, share in self.grain:
            error += math.sqrt(share / total) * draw_field(exact.shape, smoothness, rng)
        error *= np.exp(self.uneven * draw_field(exact.shape, _SIZE_SMOOTHNESS, rng))
        measured = measured + self.sd * error
        measured -= self.amplitude * np.sin(2.0 * np.pi / self.period * measured)
        if self.step > 0:
            measured = np.rint(measured / self.step) * self.step
        holes = draw_field(exact.shape, self.patch, rng)
        returned &= holes > np.where(
            dilate(steps, 1), _find_quantile(self.missing_edge), _find_quantile(self.missing)
        )
        returned &= measured > 0
        if to_disparity is not None:
            measured = np.divide(to_disparity, measured, out=np.zeros_like(exact), where=returned)
        units = np.rint(np.where(returned, measured, 0.0) / depth_scale)
        units[units > np.iinfo(np.uint16).max] = 0
        return units.astype(np.uint16)

    def _displace(
        self, measured: Array, where: NDArray[np.bool_], returned: NDArray[np.bool_], rng: np.random.Generator
    ) -> Array:
        """Return the (H, W) image with the value of a nearby pixel at each chosen pixel."""
        down, right = (draw_field(measured.shape, _EDGE_SMOOTHNESS, rng) for _ in range(2))
        v, u = np.nonzero(where)
        from_v = np.clip(v + np.rint(self.lateral * down[v, u]).astype(np.int64), 0, measured.shape[0] - 1)
        from_u = np.clip(u + np.rint(self.lateral * right[v, u]).astype(np.int64), 0, measured.shape[1] - 1)
        kept = ~returned[from_v, from_u]
        from_v[kept], from_u[kept] = v[kept], u[kept]
        displaced = measured.copy()
        displaced[v, u] = measured[from_v, from_u]
        return displaced

    def _average(self, measured: Array, where: NDArray[np.bool_], returned: NDArray[np.bool_]) -> Array:
        """Return the (H, W) image with the weighted mean of a window at each chosen pixel."""
        reach = math.ceil(_WINDOW_REACH * self.window)
        if reach == 0:
            return measured
        stride = max(1, math.floor(self.window / _SAMPLE_STEP))
        lines = np.arange(-(reach // stride), reach // stride + 1) * stride
        down, right = (side.ravel() for side in np.meshgrid(lines, lines, indexing="ij"))
        inside = np.hypot(down, right) <= _WINDOW_REACH * self.window + 0.1
        down, right = down[inside], right[inside]
        weights = np.exp(-0.5 * (down**2 + right**2) / self.window**2)
        width = measured.shape[1] + 2 * reach
        around, known = np.pad(measured, reach, mode="edge").ravel(), np.pad(returned, reach).ravel()
        v, u = np.nonzero(where)
        middle, taps = (v + reach) * width + u + reach, down * width + right
        means = np.empty(len(middle))
        batch = max(1, _BATCH_SIZE // len(taps))
        for first in range(0, len(middle), batch):
            part = slice(first, first + batch)
            at = middle[part, None] + taps
            values, weight = around[at], weights * known[at]
            weight *= np.exp(-0.5 * ((values - around[middle[part], None]) / self.limit) ** 2)
            if self.background != 1.0:
                low = np.where(known[at], values, np.inf).min(axis=1, keepdims=True)
                high = np.where(known[at], values, -np.inf).max(axis=1, keepdims=True)
                # farther values are smaller disparities, but greater depths
                sign = 1.0 if self.baseline is None else -1.0
                weight *= np.where(sign * (values - 0.5 * (low + high)) > 0, self.background, 1.0)
            means[part] = (weight * values).sum(axis=1) / weight.sum(axis=1)
        result = measured.copy()
        result[v, u] = means
        return result


def _compute_bend(inverse: Array) -> Array:
    """Return the (H, W) second difference of the inverse depth, the larger one of row and column."""
    around = np.pad(inverse, 1, mode="edge")
    across = np.abs(around[1:-1, 2:] + around[1:-1, :-2] - 2.0 * inverse)
    return np.maximum(across, np.abs(around[2:, 1:-1] + around[:-2, 1:-1] - 2.0 * inverse))


def _find_quantile(fraction: float) -> float:
    """Return the number below which this fraction of normal numbers lies."""
    if 0 < fraction < 1:
        return NormalDist().inv_cdf(fraction)
    return math.copysign(math.inf, fraction - 0.5)


CAMERAS = {
    camera.name: camera
    for camera in (
        DepthCamera(
            "d435",
            baseline=0.05,
            sd=0.067,
            grain=((0.75, 0.5), (3.0, 0.5)),
            uneven=0.25,
            window=2.6,
            limit=1.0,
            lateral=0.7,
            period=1.0 / 3.0,
            amplitude=0.014,
            missing_edge=0.006,
        ),
        DepthCamera(
            "d405",
            baseline=0.018,
            sd=0.1,
            grain=((0.8, 0.45), (3.5, 0.55)),
            uneven=0.4,
            window=4.8,
            limit=2.5,
            background=0.7,
            lateral=0.7,
            period=1.0 / 1.5,
            amplitude=0.05,
            missing=0.004,
            missing_edge=0.006,
        ),
        DepthCamera(
            "zed",
            baseline=0.12,
            sd=0.135,
            grain=((0.75, 0.55), (2.6, 0.45)),
            uneven=0.4,
            window=3.0,
            limit=2.5,
            background=0.7,
            lateral=0.4,
            amplitude=0.03,
            missing=0.006,
            missing_edge=0.03,
        ),
        DepthCamera(
            "sgbm",
            baseline=0.12,
            sd=0.135,
            grain=((1.2, 0.45), (4.0, 0.55)),
            uneven=0.2,
            window=4.0,
            limit=2.5,
            background=0.7,
            lateral=0.4,
            amplitude=0.07,
            step=1.0 / 16.0,
        ),
        DepthCamera(
            "tof",
            baseline=None,
            sd=0.0009,
            grain=((0.0, 0.4), (0.7, 0.5), (2.5, 0.1)),
            window=0.7,
            background=3.0,
            period=0.185,
            amplitude=0.0007,
        ),
    )
}
"""Imitated cameras by name: RealSense D435 and D405, ZED, a plain semi-global matcher on a pair with a
baseline of 120 mm, and a time-of-flight camera."""
