"""Imitated depth cameras: wide, correlated errors as stereo and time-of-flight cameras make them.

A statistical model, not a matcher: an exact depth image goes in, what the camera would say comes out. A
stereo camera measures disparity over a window, so that steps are smoothed, edges pulled to both sides and
the errors of neighbours alike; a time-of-flight camera measures depth, mixed at edges with what lies behind.
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
    check_intrinsics,
    check_nonnegative,
    check_positive,
)
from strand.synthetic.fields import field, pixels, spread

_BENT, _STEP = 1e-6, 3e-3  # change of the inverse depth's slope at a pixel, over it: not a plane; a step
_LOT = 1 << 21  # pixels of windows at a time: bounds the memory
_REACH = 2.0  # standard deviations of a window at which it is cut off
_COARSE = 2.0  # standard deviations of a window that take one more pixel between its samples
_RAGGED = 2.0  # pixels, smoothness of edges' displacement
_PLACES = 6.0  # pixels, smoothness of the error's size


@dataclass(frozen=True)
class DepthCamera:
    """What a depth camera does to depths.

    With a `baseline` it is a stereo camera, whose errors are in pixels of disparity (focal length times
    baseline over depth). Without one it measures time of flight, with errors in metres. The unit of `sd`,
    `limit`, `period`, `amplitude` and `step` is the one or the other; other lengths are in pixels of the
    image.

    Attributes
    ----------
    name : str
        What to call it.
    baseline : float or None
        Distance between the two cameras of a stereo pair, metres; None for time of flight.
    sd : float
        Standard deviation of the error on a surface.
    grain : tuple of (float, float)
        The error is a sum of normal fields. Each is as smooth as a Gaussian of the first number's standard
        deviation makes it (0: every pixel on its own), and its share of the variance is the second; shares
        are made to sum to 1.
    uneven : float
        Standard deviation of the logarithm of the error's size, which is more in some places than in others.
    window : float
        Standard deviation of the Gaussian window over which depth is taken; 0: each pixel's own depth.
    limit : float
        Standard deviation of a Gaussian weight by the difference to the pixel's own depth: a window that
        holds a larger step takes one side.
    background : float
        Weight of what lies farther than halfway through the window's depths; nearer things weigh 1.
    lateral : float
        Standard deviation of how far edges are displaced, raggedly.
    period, amplitude : float
        A periodic error: disparities are drawn towards multiples of the period, depths wiggle with it. An
        amplitude of `period` / 2 pi makes steps.
    step : float
        What results are rounded to; 0: not rounded.
    missing, missing_edge : float
        Part, from 0 to 1, of the pixels without depth, on surfaces and next to steps.
    patch : float
        Standard deviation of the Gaussian that makes patches of pixels without depth; 0: every one on its
        own.

    Raises
    ------
    TypeError
        If a number is none.
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
        if self.baseline is not None:
            check_positive("baseline", self.baseline)
        for name in ("sd", "uneven", "background", "amplitude", "step"):
            check_nonnegative(name, getattr(self, name))
        for name in ("limit", "period"):
            check_positive(name, getattr(self, name))
        for name in ("window", "lateral", "patch"):
            pixels(name, getattr(self, name))
        for name in ("missing", "missing_edge"):
            if check_nonnegative(name, getattr(self, name)) > 1:
                raise ValueError(f"{name}: expected a part from 0 to 1, got {getattr(self, name)}")
        for i, part in enumerate(self.grain):
            if len(part) != 2:
                raise ValueError(f"grain[{i}]: expected a smoothness and a share, got {part!r}")
            pixels(f"grain[{i}][0]", part[0])
            check_nonnegative(f"grain[{i}][1]", part[1])
        if not sum(share for _, share in self.grain) > 0:
            raise ValueError("grain: expected at least one field with a share above 0")

    @property
    def correlation_length(self) -> float:
        """Distance at which the errors of two pixels of a surface have a correlation of 1/e, pixels."""
        total = sum(share for _, share in self.grain)

        def above(distance: float) -> bool:
            # a field smoothed with a Gaussian is correlated as one of twice its variance
            parts = [
                share * math.exp(-0.25 * (distance / smoothness) ** 2)
                for smoothness, share in self.grain
                if smoothness > 0
            ]
            return sum(parts) > total / math.e

        low, high = 0.0, 4.0 * max(smoothness for smoothness, _ in self.grain)
        for _ in range(50):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if above(middle) else (low, middle)
        return low

    def with_noise(self, noise: float, focal_length: float, distance: float) -> DepthCamera:
        """Return this camera with so large an error at a distance, all else as it is.

        Parameters
        ----------
        noise : float
            Standard deviation of the error along the camera's z axis, metres.
        focal_length : float
            Of the image, pixels.
        distance : float
            Depth at which the error is so large, metres.

        Returns
        -------
        DepthCamera

        Raises
        ------
        TypeError
            If an argument is not a number.
        ValueError
            If `noise` is negative, or another one not positive.
        """
        noise = check_nonnegative("noise", noise)
        to_disparity = (
            check_positive("focal_length", focal_length) / check_positive("distance", distance) ** 2
        )
        # disparity is f b / z
        return replace(self, sd=noise if self.baseline is None else noise * to_disparity * self.baseline)

    def sense(
        self, depth: ArrayLike, intrinsics: ArrayLike, *, depth_scale: float, rng: np.random.Generator
    ) -> NDArray[np.uint16]:
        """Return what the camera makes of an exact depth image.

        Parameters
        ----------
        depth : (H, W) array_like
            Exact depths along the camera's z axis, metres; 0 for no return.
        intrinsics : (3, 3) array_like
            The pinhole matrix, pixels.
        depth_scale : float
            Metres for each unit of the result.
        rng : numpy.random.Generator
            The source of chance.

        Returns
        -------
        (H, W) ndarray of uint16
            Depths in units of `depth_scale`, rounded; 0 for no depth and for depths that no uint16 holds.

        Raises
        ------
        TypeError
            If an array does not hold numbers, or `rng` is no generator.
        ValueError
            If `depth` is not two-dimensional, finite and not negative, the intrinsics are not a pinhole's, or
            `depth_scale` is not positive.
        """
        exact = check_finite_array("depth", depth, ("H", "W"))
        if (exact < 0).any():
            raise ValueError(f"depth: expected depths >= 0, got {exact.min()}")
        focal_length = float(check_intrinsics("intrinsics", intrinsics)[0, 0])
        depth_scale = check_positive("depth_scale", depth_scale)
        if not isinstance(rng, np.random.Generator):
            raise TypeError(f"rng: expected a numpy.random.Generator, got {type(rng).__name__}")
        returned = exact > 0
        inverse = np.divide(1.0, exact, out=np.zeros_like(exact), where=returned)
        turn = _turn(inverse)
        bent, steps = turn > _BENT * inverse, turn > _STEP * inverse
        # a plane's disparity is linear in the image, and its mean over a window is the pixel's own
        near_bend = spread(bent, math.ceil(_REACH * self.window)) & returned
        to_disparity = None if self.baseline is None else focal_length * self.baseline
        measured = exact if to_disparity is None else to_disparity * inverse
        # all is drawn whatever the numbers are: another error leaves the same pixels without depth
        measured = self._displaced(measured, near_bend, returned, rng)
        measured = self._windowed(measured, near_bend, returned)
        error, total = np.zeros_like(exact), sum(share for _, share in self.grain)
        for smoothness, share in self.grain:
            error += math.sqrt(share / total) * field(exact.shape, smoothness, rng)
        error *= np.exp(self.uneven * field(exact.shape, _PLACES, rng))
        measured = measured + self.sd * error
        measured -= self.amplitude * np.sin(2.0 * np.pi / self.period * measured)
        if self.step > 0:
            measured = np.rint(measured / self.step) * self.step
        holes = field(exact.shape, self.patch, rng)
        returned &= holes > np.where(spread(steps, 1), _quantile(self.missing_edge), _quantile(self.missing))
        returned &= measured > 0
        if to_disparity is not None:
            measured = np.divide(to_disparity, measured, out=np.zeros_like(exact), where=returned)
        units = np.rint(np.where(returned, measured, 0.0) / depth_scale)
        units[units > np.iinfo(np.uint16).max] = 0
        return units.astype(np.uint16)

    def _displaced(
        self, measured: Array, where: NDArray[np.bool_], returned: NDArray[np.bool_], rng: np.random.Generator
    ) -> Array:
        """(H, W) The image, with every chosen pixel's value from nearby."""
        down, right = (field(measured.shape, _RAGGED, rng) for _ in range(2))
        v, u = np.nonzero(where)
        from_v = np.clip(v + np.rint(self.lateral * down[v, u]).astype(np.int64), 0, measured.shape[0] - 1)
        from_u = np.clip(u + np.rint(self.lateral * right[v, u]).astype(np.int64), 0, measured.shape[1] - 1)
        kept = ~returned[from_v, from_u]
        from_v[kept], from_u[kept] = v[kept], u[kept]
        displaced = measured.copy()
        displaced[v, u] = measured[from_v, from_u]
        return displaced

    def _windowed(self, measured: Array, where: NDArray[np.bool_], returned: NDArray[np.bool_]) -> Array:
        """(H, W) The image, with every chosen pixel's value the weighted mean of a window."""
        reach = math.ceil(_REACH * self.window)
        if reach == 0:
            return measured
        stride = max(1, math.floor(self.window / _COARSE))
        lines = np.arange(-(reach // stride), reach // stride + 1) * stride
        down, right = (side.ravel() for side in np.meshgrid(lines, lines, indexing="ij"))
        inside = np.hypot(down, right) <= _REACH * self.window + 0.1
        down, right = down[inside], right[inside]
        weights = np.exp(-0.5 * (down**2 + right**2) / self.window**2)
        width = measured.shape[1] + 2 * reach
        around, known = np.pad(measured, reach, mode="edge").ravel(), np.pad(returned, reach).ravel()
        v, u = np.nonzero(where)
        middle, taps = (v + reach) * width + u + reach, down * width + right
        means = np.empty(len(middle))
        lot = max(1, _LOT // len(taps))
        for first in range(0, len(middle), lot):
            part = slice(first, first + lot)
            at = middle[part, None] + taps
            values, weight = around[at], weights * known[at]
            weight *= np.exp(-0.5 * ((values - around[middle[part], None]) / self.limit) ** 2)
            if self.background != 1.0:
                low = np.where(known[at], values, np.inf).min(axis=1, keepdims=True)
                high = np.where(known[at], values, -np.inf).max(axis=1, keepdims=True)
                # disparities are the less, depths the greater, the farther
                sign = 1.0 if self.baseline is None else -1.0
                weight *= np.where(sign * (values - 0.5 * (low + high)) > 0, self.background, 1.0)
            means[part] = (weight * values).sum(axis=1) / weight.sum(axis=1)
        result = measured.copy()
        result[v, u] = means
        return result


def _turn(inverse: Array) -> Array:
    """(H, W) By how much the inverse depth departs from a straight line along the row or the column."""
    around = np.pad(inverse, 1, mode="edge")
    across = np.abs(around[1:-1, 2:] + around[1:-1, :-2] - 2.0 * inverse)
    return np.maximum(across, np.abs(around[2:, 1:-1] + around[:-2, 1:-1] - 2.0 * inverse))


def _quantile(part: float) -> float:
    """Return the number under which such a part of normal numbers is."""
    return NormalDist().inv_cdf(part) if 0 < part < 1 else math.copysign(math.inf, part - 0.5)


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
"""Cameras by name: statistics like those of RealSense D435 and D405, ZED, a plain semi-global matcher on a
120 mm pair, and a time-of-flight camera."""
