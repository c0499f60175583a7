"""Find ropes in colour and depth without a mask, and count the masks and the answers that are right.

python benches/colors.py [--scenes N] [--empty N] [--first SEED] [--only KIND] [--pictures DIR]

The kinds are those of `strand.synthetic.color_scene`. Each scene is reconstructed twice: with the number of
ropes given, and with nothing given. Recall is the share of the true middle lines within two pixels of the
mask, 0 without a mask. Precision is the share of the mask within two pixels of the true one. `--pictures`
draws the scenes that are not right.
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import strand
import strand._core as _core
from lib import pictures
from lib.judging import MAX_NEAR, SURE
from lib.measure import measure_chains
from lib.results import make_parser, run_bench
from lib.tables import format_head, format_row, print_head, print_row
from strand.synthetic import COLOR_KINDS, color_scene
from strand.synthetic.color_scenes import ColorScene

NEAR = 2  # pixels: a mask this near shows a rope


@dataclass(frozen=True)
class Answer:
    """An answer beside the truth.

    Attributes
    ----------
    near : bool
        As many chains as ropes, each within 3 radii of its rope.
    found : int
        Number of chains.
    confidence : float
        0 without chains.
    """

    near: bool
    found: int
    confidence: float

    @property
    def sure_and_wrong(self) -> bool:
        """Whether the confidence is high and the answer wrong."""
        return self.confidence >= SURE and not self.near


@dataclass(frozen=True)
class Judgement:
    """A scene with ropes: its mask, and its answers with the number of ropes given and with nothing given."""

    kind: str
    recall: float
    precision: float
    told: Answer
    untold: Answer


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", type=int, default=4, metavar="N", help="of each kind (default: 4)")
    parser.add_argument("--empty", type=int, default=4, metavar="N", help="tables of each kind (default: 4)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument(
        "--only", choices=COLOR_KINDS, metavar="KIND", help=f"one of {', '.join(COLOR_KINDS)}"
    )
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="draw the scenes that are not right")
    arguments = parser.parse_args()
    if arguments.scenes < 1 or arguments.empty < 0:
        parser.error("--scenes: expected at least 1, and --empty at least 0")
    kinds = COLOR_KINDS if arguments.only is None else (arguments.only,)
    print_head("scene", "recall", "precision", "given", "confidence", "nothing given", "confidence")
    results, false = [], dict.fromkeys(kinds, 0)
    for kind in kinds:
        for seed in range(arguments.first, arguments.first + arguments.scenes):
            results.append(judge(kind, color_scene(kind, seed), arguments.pictures))
        for seed in range(arguments.first, arguments.first + arguments.empty):
            answer, _ = reconstruct(color_scene(kind, seed, rope=False), None)
            false[kind] += bool(answer.found)
    print(f"\n{format_table(results, false, arguments.empty)}")
    return 0


def judge(kind: str, made: ColorScene, folder: Path | None) -> Judgement:
    """Judge a scene with ropes and print a row; draw it into a folder if it is not right."""
    recall, precision = measure_mask(find_mask(made), made.labels[0] > 0)
    told, chains = reconstruct(made, len(made.scene.truth))
    untold, _ = reconstruct(made, None)
    print_row(
        made.scene.name,
        f"{recall:.2f}",
        f"{precision:.2f}",
        "near" if told.near else "wrong",
        f"{told.confidence:.2f}",
        "near" if untold.near else "wrong",
        f"{untold.confidence:.2f}",
    )
    if folder is not None and not told.near:
        pictures.draw_scene(made.scene, chains, folder / f"{made.scene.name}.png")
    return Judgement(kind, recall, precision, told, untold)


def reconstruct(made: ColorScene, ropes: int | None) -> tuple[Answer, list[NDArray[np.float64]]]:
    """Reconstruct a scene and judge it by the truth. Return the chains' nodes too."""
    chains: list[NDArray[np.float64]] = []
    confidence = 0.0
    try:
        model = strand.reconstruct(made.views, ropes=ropes)
    except strand.StrandError:
        pass
    else:
        chains, confidence = [chain.points for chain in model.chains], model.confidence
    if not chains or not made.scene.truth:
        return Answer(not chains and not made.scene.truth, len(chains), confidence), chains
    found = measure_chains(chains, made.scene.truth, made.scene.radius)
    near = found.chains == found.ropes and found.frechet <= MAX_NEAR
    return Answer(near, len(chains), confidence), chains


def find_mask(made: ColorScene) -> NDArray[np.bool_]:
    """Return the mask that strand finds in a scene; an empty one if it finds none."""
    try:
        (view,) = strand.find_ropes(made.views).views
    except strand.StrandError:
        view = None
    mask = None if view is None else view.mask
    return np.zeros(made.labels[0].shape, dtype=bool) if mask is None else np.asarray(mask)


def measure_mask(mask: NDArray[np.bool_], true: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the recall and the precision of a mask; NaN for that of an empty one."""
    if not mask.any():
        return 0.0, float("nan")
    inside = _core.measure_edge_distances(true, sum(true.shape))
    around = np.pad(inside, 1)
    height, width = true.shape
    deepest = np.max(
        [around[down : down + height, right : right + width] for down in range(3) for right in range(3)],
        axis=0,
    )
    middle = true & (inside >= deepest)
    to_mask = _core.measure_edge_distances(np.ascontiguousarray(~mask), NEAR + 2)
    to_true = _core.measure_edge_distances(np.ascontiguousarray(~true), NEAR + 2)
    return float(np.mean(to_mask[middle] <= NEAR)), float(np.mean(to_true[mask] <= NEAR))


def format_table(results: Sequence[Judgement], false: dict[str, int], empty: int) -> str:
    """Return a table with a row for each kind and one for all."""
    lines = [
        format_head(
            "kind",
            "scenes",
            "recall",
            "precision",
            "within 3 r, number given",
            "nothing given",
            "confidence, median",
            f"confidence ≥ {SURE} and wrong",
            "tables without a rope",
            "false ropes",
        )
    ]
    for name in (*false, "all"):
        group = [found for found in results if name in (found.kind, "all")]
        precisions = [found.precision for found in group if np.isfinite(found.precision)]
        lines.append(
            format_row(
                name,
                len(group),
                f"{statistics.mean(found.recall for found in group):.2f}",
                f"{statistics.mean(precisions):.2f}" if precisions else "–",
                sum(found.told.near for found in group),
                sum(found.untold.near for found in group),
                f"{statistics.median(found.told.confidence for found in group):.2f}",
                sum(found.told.sure_and_wrong + found.untold.sure_and_wrong for found in group),
                empty * len(false) if name == "all" else empty,
                sum(false.values()) if name == "all" else false[name],
            )
        )
    return "\n".join(lines)


if __name__ == "__main__":
    run_bench(main)
