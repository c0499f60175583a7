"""The noise of a scene: independent errors of its depths and errors of its poses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array, check_finite_array, check_instance, check_nonnegative, check_positive

DEFAULT_FLYING = 0.05  # fraction of the pixels at steps in depth that fly


@dataclass(frozen=True)
class Noise:
    """The errors of a scene's depths and poses.

    Attributes
    ----------
    depth : float, optional
        Standard deviation of the depths, metres; 0.7 mm by default. With `Camera(device=...)` it holds at
        the camera's distance from the origin, and the default is the device's own.
    flying : float, optional
        Fraction of the pixels next to a step in depth that get a depth between the two sides, from 0 to 1;
        0.05 by default. A device mixes depths its own way, so do not give both.
    turn : float
        Standard deviation of the poses' rotation about the world's z axis, radians; 0.5 degrees by default.
    shift : float
        Standard deviation of the poses' translation along the world's x and y axes, metres.

    Raises
    ------
    TypeError
        If a value is not a number.
    ValueError
        If a value is negative or not finite, or `flying` is above 1.
    """

    depth: float | None = None
    flying: float | None = None
    turn: float = math.radians(0.5)
    shift: float = 0.0015

    def __post_init__(self) -> None:
        if self.depth is not None:
            object.__setattr__(self, "depth", check_nonnegative("depth", self.depth))
        if self.flying is not None:
            _check_flying(self.flying)
        check_nonnegative("turn", self.turn)
        check_nonnegative("shift", self.shift)

    def misplace(self, poses: Array, rng: np.random.Generator) -> Array:
        """Return (V, 4, 4) camera-to-world poses with errors; the middle view's pose stays exact."""
        poses = check_finite_array("poses", poses, ("V", 4, 4))
        check_instance("rng", rng, np.random.Generator)
        errors = rng.normal(size=(len(poses), 3)) * (self.turn, self.shift, self.shift)
        errors[len(poses) // 2] = 0.0
        return np.stack([_displace(pose, *error) for pose, error in zip(poses, errors, strict=True)])


def _check_flying(flying: float) -> float:
    if check_nonnegative("flying", flying) > 1:
        raise ValueError(f"flying: expected a fraction from 0 to 1, got {flying}")
    return float(flying)


def _displace(pose: Array, angle: float, dx: float, dy: float) -> Array:
    """Return the pose, turned about the world's z axis and then shifted in the table plane."""
    motion = np.eye(4)
    motion[:2, :2] = make_plane_rotation(angle)
    motion[:2, 3] = dx, dy
    return np.asarray(motion @ pose)


def make_plane_rotation(angle: float) -> Array:
    """Return the (2, 2) rotation by an angle, radians."""
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def sense(
    depth: Array,
    *,
    noise: float,
    flying: float,
    step: float,
    depth_scale: float,
    rng: np.random.Generator,
) -> NDArray[np.uint16]:
    """Return the depth image of a camera with independent errors, from an exact one.

    Parameters
    ----------
    depth : (H, W) ndarray
        Exact depths, metres; 0 for no return.
    noise : float
        Standard deviation of the normal errors along the camera's z axis, metres.
    flying : float
        Fraction, from 0 to 1, of the pixels next to a step in depth that fly. A flying pixel gets a depth
        between its own and that of the neighbour across its largest step.
    step : float
        Smallest difference between neighbours in a row or a column that counts as a step, metres.
    depth_scale : float
        Metres per unit of the result.
    rng : numpy.random.Generator
        The random number generator.

    Returns
    -------
    (H, W) ndarray of uint16
        Depths in units of `depth_scale`, rounded; 0 for no return and for depths beyond uint16.

    Raises
    ------
    TypeError
        If `depth` does not hold floating point numbers, another value is not a number, or `rng` is not a
        generator.
    ValueError
        If `depth` is not two-dimensional and finite, `noise` is negative or not finite, `flying` is
        not from 0 to 1, or `step` or `depth_scale` is not positive.
    """
    exact = check_finite_array("depth", depth, ("H", "W"))
    noise, flying = check_nonnegative("noise", noise), _check_flying(flying)
    step, depth_scale = check_positive("step", step), check_positive("depth_scale", depth_scale)
    check_instance("rng", rng, np.random.Generator)
    returned = exact > 0
    height, width = exact.shape
    padded = np.pad(exact, 1)
    largest = np.zeros_like(exact)
    for dv, du in ((0, 1), (1, 0), (1, 2), (2, 1)):
        neighbor = padded[dv : dv + height, du : du + width]
        gap = np.where(returned & (neighbor > 0), neighbor - exact, 0.0)
        largest = np.where(np.abs(gap) > np.abs(largest), gap, largest)
    # the draws do not depend on the arguments: with other noise, the same pixels fly
    chance, fraction, error = rng.random(exact.shape), rng.random(exact.shape), rng.normal(size=exact.shape)
    flies = (np.abs(largest) > step) & (chance < flying)
    measured = exact + np.where(flies, fraction * largest, 0.0) + noise * error
    units = np.rint(measured / depth_scale)
    units[~returned | (units < 0) | (units > np.iinfo(np.uint16).max)] = 0
    return units.astype(np.uint16)
