"""Smooth centrelines: cubic B-splines, asked by arc length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

import strand._core as _core
from strand.geometry.lengths import multiply_rows
from strand.support.checks import (
    Array,
    check_finite_array,
    check_number,
    check_numbers,
    check_positive,
    freeze_array,
)
from strand.support.lazy import lazy_property

_MAX_STEPS = 1_000_000  # of an evenly spaced curve
_NEWTON_STEPS = 4  # to the closest place of a curve


@dataclass(frozen=True, eq=False)
class Curve:
    """A stretch of a uniform cubic B-spline.

    Parameters
    ----------
    control : (n, 3) array_like of float
        Control points, metres, n >= 4.
    start, stop : float
        Parameters of its two ends, 0 <= start < stop <= n - 3.

    Raises
    ------
    TypeError
        If `control` does not hold floating point numbers, or a parameter is not a number.
    ValueError
        If `control` has another shape or is not finite, or the parameters are out of range.
    """

    control: Array
    start: float
    stop: float

    def __post_init__(self) -> None:
        control = check_finite_array("control", self.control, ("N", 3))
        if len(control) < 4:
            raise ValueError(f"control: expected at least four points, got {len(control)}")
        object.__setattr__(self, "start", check_number("start", self.start))
        object.__setattr__(self, "stop", check_number("stop", self.stop))
        if not 0 <= self.start < self.stop <= len(control) - 3:
            raise ValueError(
                f"start, stop: expected 0 <= start < stop <= {len(control) - 3}, "
                f"got {self.start} and {self.stop}"
            )
        object.__setattr__(self, "control", freeze_array(control))

    def __repr__(self) -> str:
        return f"Curve({self.length * 1e3:.1f} mm, {len(self.control)} control points)"

    @classmethod
    def whole(cls, control: Array) -> Curve:
        """Return the whole spline of control points."""
        points = check_finite_array("control", control, ("N", 3))
        return cls(points, 0.0, float(len(points) - 3))

    @lazy_property
    def _arcs(self) -> Array:
        """The arc length from the start to each of evenly spaced parameters; linear in between."""
        return _core.tabulate_arc_length(self.control, self.start, self.stop)

    @lazy_property
    def length(self) -> float:
        """Arc length, metres."""
        return float(self._arcs[-1])

    def parameter_at(self, s: ArrayLike) -> Array:
        """Return parameters of the spline at arc lengths `s`, metres, clamped to the ends."""
        return _core.find_parameters(self._arcs, self.start, self.stop, check_numbers("s", s))

    def arc_length_at(self, parameter: ArrayLike) -> Array:
        """Return arc lengths at parameters of the spline, metres, clamped to the ends."""
        place = check_numbers("parameter", parameter)
        return _core.find_arc_lengths(self._arcs, self.start, self.stop, place)

    def trimmed(self, start: float, stop: float) -> Curve:
        """Return the stretch between two arc lengths, metres."""
        first, last = (
            self.parameter_at(check_number(name, s)) for name, s in (("start", start), ("stop", stop))
        )
        return Curve(self.control, float(first), float(last))

    def reversed(self) -> Curve:
        """Return the same stretch in the other direction."""
        last = len(self.control) - 3
        return Curve(self.control[::-1], last - self.stop, last - self.start)

    def at(self, s: ArrayLike) -> tuple[Array, Array, Array]:
        """Return positions, unit tangents and curvature vectors at arc lengths `s`.

        Parameters
        ----------
        s : (M,) array_like
            From the start, metres; clamped to the ends.

        Returns
        -------
        position : (M, 3) ndarray
            Metres.
        tangent : (M, 3) ndarray
            Unit vectors.
        curvature : (M, 3) ndarray
            The tangent's derivative by arc length, 1/m.
        """
        return _core.evaluate_spline(self.control, self.parameter_at(s))

    def place_at(self, s: ArrayLike) -> Array:
        """Return (M, 3) positions alone at arc lengths `s`, metres, as `at` does."""
        return _core.evaluate_spline(self.control, self.parameter_at(s))[0]

    def closest(self, points: Array, s: Array) -> Array:
        """Return (N,) arc lengths of the closest places to points, by Newton's method from near ones."""
        points, s = check_finite_array("points", points, ("N", 3)), check_numbers("s", s)
        if s.shape != points.shape[:1]:
            raise ValueError(f"s: expected one for each of {len(points)} points, got shape {s.shape}")
        for _ in range(_NEWTON_STEPS):
            position, tangent, bend = self.at(s)
            offset = points - position
            slope = np.maximum(1.0 - multiply_rows(offset, bend), 0.1)
            s = np.clip(s + multiply_rows(offset, tangent) / slope, 0.0, self.length)
        return s

    def spaced(self, spacing: float) -> Array:
        """Return evenly spaced arc lengths from end to end, about `spacing` metres apart, at least two."""
        steps = self.length / check_positive("spacing", spacing)
        if steps > _MAX_STEPS:
            raise ValueError(f"spacing: expected at most {_MAX_STEPS} steps, got {steps:g}")
        count = max(round(steps), 1)
        # as linspace, which takes longer for few numbers
        s = np.arange(count + 1) * (self.length / count)
        s[-1] = self.length
        return np.asarray(s)
