"""How well probabilities are calibrated: expected calibration error, area under the curve, coverage."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import rankdata

from lib.judging import SURE

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

BINS = 10  # of equal width, in which said and right are compared


def measure_calibration_error(said: Array, right: Flags, bins: int = BINS) -> float:
    """Return the mean difference of said and right over bins of equal width, weighed by answers."""
    bin_of = np.minimum((said * bins).astype(int), bins - 1)
    error = 0.0
    for number in np.unique(bin_of):
        here = bin_of == number
        error += here.mean() * abs(float(said[here].mean()) - float(right[here].mean()))
    return error


def measure_area(said: Array, right: Flags) -> float:
    """Return the probability that a right answer has the higher probability; NaN without both kinds."""
    positive, negative = int(right.sum()), int((~right).sum())
    if not positive or not negative:
        return float("nan")
    ranks = rankdata(said)
    return float((ranks[right].sum() - positive * (positive + 1) / 2) / (positive * negative))


def find_threshold(said: Array, right: Flags, wrong: float) -> tuple[float, float]:
    """Return the least probability above which at most a share is wrong, and the share of answers above."""
    order = np.argsort(-said, kind="stable")
    mistakes = np.cumsum(~right[order])
    kept = np.flatnonzero(mistakes <= wrong * np.arange(1, len(said) + 1))
    if not len(kept):
        return 1.0, 0.0
    return float(said[order[kept[-1]]]), float((kept[-1] + 1) / len(said))


def share_sure_and_wrong(said: Array, right: Flags) -> float:
    """Return the share of answers that are sure and wrong."""
    return float(((said >= SURE) & ~right).mean())


def draw_reliability(
    groups: Mapping[str, tuple[Array, Flags]], kinds: Mapping[str, tuple[Array, Flags]], path: Path
) -> None:
    """Draw what share is right over what was said for each group, and errors over coverage for each kind."""
    figure = Figure(figsize=(3.4 * (len(groups) + 1), 3.6), layout="constrained")
    *first, last = figure.subplots(1, len(groups) + 1)
    for axis, (name, every) in zip(first, groups.items(), strict=True):
        _draw_bins(axis, *every)
        axis.set_title(f"{name}: ECE {measure_calibration_error(*every):.3f}", fontsize=9)
    for name, (said, right) in kinds.items():
        wrong = ~right[np.argsort(-said, kind="stable")]
        count = np.arange(1, len(wrong) + 1)
        last.plot(100 * count / len(wrong), 100 * np.cumsum(wrong) / count, linewidth=1, label=name)
    last.legend(fontsize=6)
    last.set_title("wrong among the surest", fontsize=9)
    last.set_xlabel("acted on / %")
    last.set_ylabel("wrong / %")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def _draw_bins(axis: Axes, said: Array, right: Flags) -> None:
    """Draw the share of right answers in each bin, with its standard deviation and the number of answers."""
    bin_of = np.minimum((said * BINS).astype(int), BINS - 1)
    axis.plot([0, 1], [0, 1], color="#999999", linewidth=1)
    for number in np.unique(bin_of):
        here = bin_of == number
        count, share = int(here.sum()), float(right[here].mean())
        # with one more answer of each outcome
        sd = np.sqrt((count * share + 1) * (count * (1 - share) + 1) / (count + 2) ** 2 / (count + 3))
        axis.errorbar(said[here].mean(), share, sd, fmt="o", color="#4c78a8", capsize=2)
        place = (said[here].mean(), share)
        axis.annotate(str(count), place, fontsize=6, xytext=(4, -8), textcoords="offset points")
    axis.set_xlabel("said")
    axis.set_ylabel("right")
    axis.set_aspect("equal")
