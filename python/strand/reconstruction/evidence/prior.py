"""The caller's knowledge of the ropes: their number, their lengths, and where they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from strand.config import Known
from strand.ropes.netlist import Netlist
from strand.support.checks import check_bool, check_integer, check_lengths, check_positive
from strand.views.box import Box

LENGTH_COST = 2.0  # cost of a hypothesis for each radius by which it misses a known length
MAX_LENGTH_COST = 30.0  # largest cost of a hypothesis for the length of one rope
_MAX_ROPES = 10_000  # ropes that a caller may ask for


@dataclass(frozen=True, eq=False)
class Prior:
    """The caller's knowledge of the ropes.

    Attributes
    ----------
    ropes : int or None
        Their number.
    lengths : tuple of float
        Their lengths, the longest first, metres; empty if the caller gives none.
    same_length : bool
        Whether all ropes have the one length.
    bounds : Box or None
        The extraction range, which holds all ropes, metres.
    known : Known
        How exact the lengths are.
    """

    ropes: int | None = None
    lengths: tuple[float, ...] = ()
    same_length: bool = False
    bounds: Box | None = None
    known: Known = field(default_factory=Known)

    @classmethod
    def from_caller(
        cls,
        ropes: int | None,
        length: float | Sequence[float] | None,
        bounds: Box | None = None,
        known: Known | None = None,
    ) -> Prior:
        """Check what the caller knows; several lengths also give the number of ropes.

        Raises
        ------
        TypeError
            If `ropes` is not a whole number, or a length is not a number.
        ValueError
            If a number is out of range, or there are not as many lengths as ropes.
        """
        known = Known() if known is None else known
        if ropes is not None:
            ropes = check_integer("ropes", ropes, 1, _MAX_ROPES)
        if length is None:
            return cls(ropes, bounds=bounds, known=known)
        lengths = check_lengths("length", length)
        if np.ndim(length) == 0:
            return cls(ropes, lengths, True, bounds, known)
        if ropes is not None and len(lengths) != ropes:
            raise ValueError(f"length: expected one for each of {ropes} ropes, got {len(lengths)}")
        return cls(len(lengths), tuple(sorted(lengths, reverse=True)), bounds=bounds, known=known)

    def select_common(self) -> Prior:
        """Return the knowledge that also holds for some of the ropes alone."""
        return replace(self, ropes=None, lengths=self.lengths if self.same_length else ())

    def match_lengths(self, lengths: Sequence[float]) -> list[float | None]:
        """Return the known length of each rope, given the lengths that were found, metres.

        The sum of their differences is as small as possible. The shortest ropes have None if there are more
        ropes than known lengths.
        """
        if self.same_length:
            return [self.lengths[0]] * len(lengths)
        true: list[float | None] = [None] * len(lengths)
        order = sorted(range(len(lengths)), key=lambda k: -lengths[k])[: len(self.lengths)]
        found = [lengths[k] for k in order]
        best = min(
            combinations(self.lengths, len(order)),
            key=lambda some: sum(abs(a - b) for a, b in zip(some, found, strict=True)),
        )
        for k, value in zip(order, best, strict=True):
            true[k] = value
        return true

    def measure_excess(self, length: float, true: float | None, radius: float) -> float:
        """Return by how many radii a length misses the true one beyond what is allowed; 0 without one."""
        if true is None:
            return 0.0
        share, radii = self.known.length_share, self.known.length_radii
        return max(abs(length - true) / radius - share * true / radius - radii, 0.0)


NO_PRIOR = Prior()


def check_branches(
    branches: bool | Netlist, wire: float | None, method: str, prior: Prior
) -> tuple[bool, float | None, Netlist | None]:
    """Check what the caller knows of ropes that branch: whether they do, a wire's radius, and the netlist."""
    net = branches if isinstance(branches, Netlist) else None
    if net is None and not check_bool("branches", branches):
        if wire is not None:
            raise ValueError("wire: expected None without branches=True")
        return False, None, None
    if method != "default":
        raise ValueError(f"branches: expected False with the {method} method")
    if prior.ropes is not None or prior.lengths:
        raise ValueError("branches: expected False with ropes or length: edges of a graph are no ropes")
    return True, None if wire is None else check_positive("wire", wire), net
