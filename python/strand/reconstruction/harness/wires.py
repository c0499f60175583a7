"""Radii of bundles: all strands decided together, since wires neither begin nor end at a junction.

A round bundle of k wires of radius w has the radius w sqrt(k). So the square of the thickest strand's radius
is the sum of the others' squares. A moulded harness or a plant does not keep to it: the data may refuse it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array

_MAX_WIRES = 60  # of a strand
_NEAREST = 4  # radii near a strand's own that are tried
_MASK_SD = 0.05  # radii: standard deviation of half widths of masks
_SHARED_SDS = 1.5  # deviations: that of an error that all strands share, as masks that are too wide
_SHARED = np.linspace(-3.0, 3.0, 25)  # deviations of the shared error that are tried
_UNEQUAL = 9.0  # cost of a junction at which squares do not add up
_TOLERANCE = 0.04  # of the greatest square: squares that differ by less add up
_REFUSED = 6.0  # mean cost of a strand: with more, these are no bundles of such wires
_STRAINED = 4.0  # mean cost, the shared error's included: with more, the wire may have another radius
_ROUNDS = 20  # of improving the radii junction by junction at most


@dataclass(frozen=True, eq=False)
class Possible:
    """The radii that strands may have.

    Attributes
    ----------
    given : (K,) ndarray or None
        The radii that ropes have, in rising order, metres; None if nobody knows.
    bundles : (K,) ndarray or None
        Those of round bundles of 1, 2, 3 ... wires, metres, which strands have about, if they have none of
        `given`; None if the wire is not known.
    """

    given: Array | None
    bundles: Array | None

    @property
    def radii(self) -> Array | None:
        """Those that come first."""
        return self.bundles if self.given is None else self.given


@dataclass(frozen=True, eq=False)
class Choice:
    """The radius of each strand.

    Attributes
    ----------
    numbers : (K,) ndarray of int
        Which of the possible radii each strand has.
    unequal : list of int
        The junctions at which squares of radii do not add up.
    cost : float
        Mean squared misfit of the strands' radii, standard deviations.
    shared : float
        The error that all measured radii share, standard deviations.
    rival : (K,) ndarray of int or None
        The next likely choice.
    margin : float
        How much more it costs, squared standard deviations.
    """

    numbers: NDArray[np.int64]
    unequal: list[int]
    cost: float
    shared: float
    rival: NDArray[np.int64] | None = None
    margin: float = np.inf

    @property
    def refused(self) -> bool:
        """Whether strands have none of the possible radii."""
        return self.cost > _REFUSED

    @property
    def strained(self) -> bool:
        """Whether strands have the possible radii only with errors that are hardly likely."""
        return self.cost + self.shared**2 > _STRAINED

    @property
    def counts(self) -> list[int | None]:
        """Numbers of wires, if the radii are those of 1, 2, 3 ... wires; None where they contradict it."""
        return [None if self.refused else int(number) + 1 for number in self.numbers]


def choose_radii(
    measured: Array, pairs: Sequence[tuple[int, int]], possible: Array, deviations: Array | float = _MASK_SD
) -> Choice:
    """Choose a radius for each strand.

    Parameters
    ----------
    measured : (K,) ndarray
        Radii of strands, metres.
    pairs : sequence of (int, int)
        The nodes where each strand starts and stops.
    possible : (N,) ndarray
        The radii that strands may have, in rising order, metres.
    deviations : float or (K,) ndarray
        Of the measured radii, relative to them.
    """
    at = _list_junctions(pairs)
    own_sd = np.broadcast_to(deviations, measured.shape)[:, None]
    shared_sd = _SHARED_SDS * float(np.median(own_sd)) * measured.min()
    found = []
    for shared in _SHARED:
        own = measured - shared * shared_sd
        misfits = ((possible[None] / own[:, None] - 1.0) / own_sd) ** 2
        numbers = _find_best(misfits, at, possible**2)
        unequal = [node for node, strands in at.items() if not _add_up(possible[numbers[strands]] ** 2)]
        own_cost = float(misfits[np.arange(len(own)), numbers].sum())
        choice = Choice(numbers, unequal, own_cost / max(len(own), 1), float(shared))
        found.append((own_cost + _UNEQUAL * len(unequal) + float(shared) ** 2, choice))
    least, best = min(found, key=lambda one: one[0])
    others = [one for one in found if not np.array_equal(one[1].numbers, best.numbers)]
    if not others:
        return best
    cost, rival = min(others, key=lambda one: one[0])
    return replace(best, rival=rival.numbers, margin=cost - least)


def list_bundles(wire: float) -> Array:
    """Return the radii of bundles of 1, 2, 3 ... wires of a radius, metres."""
    return np.asarray(wire * np.sqrt(np.arange(1.0, _MAX_WIRES + 1.0)))


def _list_junctions(pairs: Sequence[tuple[int, int]]) -> dict[int, list[int]]:
    """Return the strands at each junction; one that starts and stops there comes twice."""
    at: dict[int, list[int]] = {}
    for number, pair in enumerate(pairs):
        for node in pair:
            at.setdefault(node, []).append(number)
    return {node: strands for node, strands in sorted(at.items()) if len(strands) > 2}


def _find_best(misfits: Array, at: dict[int, list[int]], squares: Array) -> NDArray[np.int64]:
    """Return the number of each strand's radius, improved junction by junction from the nearest ones on."""
    nearest = np.argsort(misfits, axis=1, kind="stable")[:, :_NEAREST]
    numbers = nearest[:, 0].astype(np.int64)
    for _ in range(_ROUNDS):
        before = numbers.copy()
        for strands in at.values():
            mine = sorted(set(strands))[:4]
            tried = np.array(list(product(*nearest[mine].tolist())), dtype=np.int64)
            cost = misfits[mine, tried].sum(axis=1)
            for ends in at.values():
                if set(ends) & set(mine):
                    columns = [
                        squares[tried[:, mine.index(k)]]
                        if k in mine
                        else np.full(len(tried), squares[numbers[k]])
                        for k in ends
                    ]
                    cost = cost + _UNEQUAL * ~_add_up(np.column_stack(columns))
            numbers[mine] = tried[cost.argmin()]
        if np.array_equal(before, numbers):
            break
    return numbers


def _add_up(squares: Array) -> NDArray[np.bool_]:
    """Tell for each row of squares of radii whether the greatest is the sum of the others."""
    greatest = squares.max(axis=-1)
    return np.asarray(np.abs(2.0 * greatest - squares.sum(axis=-1)) <= _TOLERANCE * greatest)
