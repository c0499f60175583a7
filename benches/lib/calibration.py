"""Errors of chains beside their covariances: whether the reported deviations match."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import strand

Array = NDArray[np.float64]

STEP = 1e-4  # metres between places of the true centrelines


@dataclass(frozen=True, eq=False)
class Truth:
    """True centrelines as dense places.

    Attributes
    ----------
    points, tangents : (M, 3) ndarray
        Metres; unit vectors.
    frames : (M, 2, 3) ndarray
        Two unit vectors across each tangent.
    rope : (M,) ndarray of int64
        The rope of each place.
    along : (M,) ndarray
        Arc length over the rope's length.
    lengths : list of float
        Metres.
    """

    points: Array
    tangents: Array
    frames: Array
    rope: NDArray[np.int64]
    along: Array
    lengths: list[float]

    @classmethod
    def of(cls, ropes: tuple[Array, ...], radius: float) -> Truth:
        """Sample ropes every `STEP`."""
        points, tangents, along, lengths = [], [], [], []
        for nodes in ropes:
            chain = strand.Chain(nodes, radius)
            s = np.linspace(0.0, chain.length, round(chain.length / STEP) + 1)
            places = chain.at(s)
            slope = np.gradient(places, axis=0)
            points.append(places)
            tangents.append(slope / np.linalg.norm(slope, axis=1, keepdims=True))
            along.append(s / chain.length)
            lengths.append(chain.length)
        tangent = np.concatenate(tangents)
        return cls(
            np.concatenate(points),
            tangent,
            make_frames(tangent),
            np.repeat(np.arange(len(points)), [len(places) for places in points]),
            np.concatenate(along),
            lengths,
        )


def make_frames(tangents: Array) -> Array:
    """Return (M, 2, 3) two unit vectors at right angles to each tangent and to each other."""
    least = np.eye(3)[np.abs(tangents).argmin(axis=1)]
    first = np.cross(tangents, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(tangents, first)], axis=1)


def compute_calibration(chains: tuple[strand.Chain, ...], truth: Truth) -> tuple[float, float]:
    """Return the RMS of the reported standard deviation, metres, and the normalised squared error."""
    tree = cKDTree(truth.points)
    variances, squares = [], []
    for chain in chains:
        if chain.covariance is None:
            continue
        _, place = tree.query(chain.points)
        error = chain.points - truth.points[place]
        frame = truth.frames[place]
        covariance = np.einsum("mai,mij,mbj->mab", frame, chain.covariance, frame)
        error = np.einsum("mai,mi->ma", frame, error)
        inside = (truth.along[place] > 0.0) & (truth.along[place] < 1.0)
        variances.append(np.trace(covariance, axis1=1, axis2=2)[inside])
        solved = np.linalg.solve(covariance, error[..., None])[..., 0]
        squares.append(((error * solved).sum(axis=1) / 2)[inside])
    return float(np.sqrt(np.concatenate(variances).mean())), float(np.concatenate(squares).mean())
