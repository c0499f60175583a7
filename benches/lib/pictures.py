"""Pictures of scenes: the depth image, the mask, the truth and the answer; curves over strengths."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from strand.ropes.harness import Harness
from strand.synthetic import HarnessScene, SyntheticScene

SURE = 0.9  # confidence from which on an answer is sure
MARGIN = 15  # pixels around the ropes
TRUTH = "#ffffff"
MASK = "#e45756"
ANSWERS = ("#222222", "#f58518", "#b279a2", "#54a24b", "#9d755d")  # colours of chains


def draw_scene(synthetic: SyntheticScene, chains: Sequence[np.ndarray], path: Path) -> None:
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
        drawn = [project(nodes, synthetic.intrinsics, pose) for nodes in synthetic.truth]
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
            line = project(nodes, synthetic.intrinsics, pose)
            axis.plot(*line.T, "--", color=ANSWERS[i % len(ANSWERS)], linewidth=1.4)
        axis.set_xlim(ends[:, 0].min() - MARGIN, ends[:, 0].max() + MARGIN)
        axis.set_ylim(ends[:, 1].max() + MARGIN, ends[:, 1].min() - MARGIN)
    above = axes[-1]
    # a hanging rope is drawn in the two directions in which it extends
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


def draw_graph(made: HarnessScene, found: Harness, path: Path) -> None:
    """Draw the middle view of a harness, with the edges and nodes of the graph that was found."""
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axis = figure.subplots()
    image, pose = made.depth[len(made.depth) // 2] * made.depth_scale, made.poses_true[len(made.depth) // 2]
    # heights above the table by shades
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
    k = made.intrinsics
    rays = np.stack(
        [(columns - k[0, 2]) / k[0, 0], (rows - k[1, 2]) / k[1, 1], np.ones(image.shape)], axis=-1
    )
    height = (rays * image[..., None]) @ pose[2, :3] + pose[2, 3]
    axis.imshow(np.where(image > 0, height, np.nan), cmap="gray", vmin=-0.01, vmax=0.03)
    box = {"boxstyle": "round,pad=0.15", "fc": "k", "ec": "none", "alpha": 0.7}
    for edge in found.edges:
        drawn = project(edge.chain.points, k, pose)
        axis.plot(*drawn.T, color="C1", linewidth=1.2)
        wires = "" if edge.wires is None else f", {edge.wires} wires"
        text = f"{1e3 * edge.length:.0f} mm, radius {1e3 * edge.radius:.1f} mm{wires}"
        axis.annotate(
            text, drawn[len(drawn) // 2], (8, 0), textcoords="offset points", color="w", fontsize=7, bbox=box
        )
    for node in found.nodes:
        (place,) = project(node.position[None], k, pose)
        axis.plot(*place, "o", color="w" if node.kind == "junction" else "C0", ms=6, mec="k")
        axis.annotate(str(node.id), place, (-11, -11), textcoords="offset points", color="w", fontsize=8)
    ends = project(np.concatenate(made.truth), k, pose)
    axis.set_xlim(ends[:, 0].min() - 60, ends[:, 0].max() + 110)
    axis.set_ylim(ends[:, 1].max() + 40, ends[:, 1].min() - 40)
    axis.axis("off")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90)


def project(nodes: np.ndarray, intrinsics: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Return (N, 2) the columns and rows at which a camera sees nodes of the world."""
    seen = (nodes - pose[:3, 3]) @ pose[:3, :3] @ intrinsics.T
    return seen[:, :2] / seen[:, 2:]


def draw_severity(
    records: Sequence[dict[str, Any]],
    kinds: Mapping[str, Any],
    said: Callable[[Any, float], str],
    path: Path,
) -> None:
    """Draw the shares of runs that are right, sure, and sure and wrong, for each kind over its strengths."""
    shown = [name for name in kinds if any(r["kind"] == name for r in records)]
    rows = -(-len(shown) // 6)
    figure = Figure(figsize=(16, 2.3 * rows), layout="constrained")
    axes = figure.subplots(rows, 6, squeeze=False, sharey=True).flat
    for axis, name in zip(axes, shown, strict=False):
        kind = kinds[name]
        groups = [[r for r in records if r["kind"] == name and r["strength"] == s] for s in kind.strengths]
        at = np.arange(len(groups))
        for label, colour, counts in (
            ("right", "#4c78a8", lambda r: r["right"]),
            ("sure", "#222222", lambda r: r["confidence"] >= SURE),
            ("sure and wrong", "#e45756", lambda r: r["confidence"] >= SURE and not r["right"]),
        ):
            values = [100.0 * sum(map(counts, group)) / max(len(group), 1) for group in groups]
            axis.plot(at, values, "o-", markersize=3, color=colour, label=label)
        axis.set_xticks(at, [said(kind, strength) for strength in kind.strengths], fontsize=6)
        axis.set_title(name, fontsize=8)
        axis.set_ylim(-4, 104)
    for axis in axes:
        axis.set_visible(False)
    figure.axes[0].legend(fontsize=6)
    figure.supylabel("% of scenes", fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
