"""Pictures of scenes: what a camera saw, the mask, the truth and the answer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from strand.synthetic import SyntheticScene

MARGIN = 15  # pixels around the ropes
TRUTH, MASK, ANSWERS = "#ffffff", "#e45756", ("#222222", "#f58518", "#b279a2", "#54a24b", "#9d755d")


def draw(synthetic: SyntheticScene, chains: Sequence[np.ndarray], path: Path) -> None:
    """Draw every view of a scene with the ropes' true and found centrelines, and both seen from above."""
    count = len(synthetic.depth)
    figure = Figure(figsize=(6 * (count + 1), 5.5), layout="constrained")
    axes = figure.subplots(1, count + 1, squeeze=False)[0]
    for axis, image, pose, mask in zip(
        axes,
        synthetic.depth * synthetic.depth_scale,
        synthetic.poses_true,
        [None] * count if synthetic.mask is None else synthetic.mask,
        strict=False,
    ):
        drawn = [projected(nodes, synthetic.intrinsics, pose) for nodes in synthetic.truth]
        ends = np.concatenate(drawn)
        around = image if mask is None else image[mask != 0]
        middle = np.median(around[around > 0]) if (around > 0).any() else 0.0
        reach = 8.0 * synthetic.radius
        axis.imshow(np.where(image > 0, image, np.nan), vmin=middle - reach, vmax=middle + reach)
        if mask is not None:
            axis.contour(mask != 0, [0.5], colors=MASK, linewidths=0.6)
        for line in drawn:
            axis.plot(*line.T, color=TRUTH, linewidth=1.0)
        for i, nodes in enumerate(chains):
            line = projected(nodes, synthetic.intrinsics, pose)
            axis.plot(*line.T, "--", color=ANSWERS[i % len(ANSWERS)], linewidth=1.4)
        axis.set_xlim(ends[:, 0].min() - MARGIN, ends[:, 0].max() + MARGIN)
        axis.set_ylim(ends[:, 1].max() + MARGIN, ends[:, 1].min() - MARGIN)
    above = axes[-1]
    # a rope that hangs is seen from the camera's side, in the two directions in which it extends
    spans = np.ptp(np.concatenate(synthetic.truth), axis=0)
    first, second = sorted(np.argsort(spans)[1:])
    for nodes in synthetic.truth:
        above.plot(nodes[:, first], nodes[:, second], color="#bbbbbb", linewidth=5.0)
    for i, nodes in enumerate(chains):
        above.plot(nodes[:, first], nodes[:, second], color=ANSWERS[i % len(ANSWERS)], linewidth=1.4)
    above.set_aspect("equal")
    figure.suptitle(f"{synthetic.name}: mask red, truth white or grey, answer the other lines")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=70)


def projected(nodes: np.ndarray, intrinsics: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """(N, 2) Columns and rows at which a camera sees nodes of the world."""
    seen = (nodes - pose[:3, 3]) @ pose[:3, :3] @ intrinsics.T
    return seen[:, :2] / seen[:, 2:]
