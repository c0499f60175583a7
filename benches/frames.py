"""Reconstruct single frames as cameras and segmenters give them, and count the answers that are right.

python benches/frames.py [--scenes N] [--first SEED] [--only KIND] [--pictures DIR]

The kinds are those of `strand.synthetic.frame_scene`. "points" are frames of the kind `usual` as bare
points; `usual` gives the same with their images and masks. The number of ropes is given, and the
radius in every other scene; ropes of two radii have none. `--pictures` draws the scenes that are not right.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from lib.judging import Judgement, format_summary, judge_scenes
from lib.results import make_parser, run_bench
from strand.synthetic import FRAMES, SyntheticScene, frame_scene

KINDS = (*FRAMES, "points")


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", type=int, default=40, metavar="N", help="of each kind (default: 40)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument("--only", choices=KINDS, metavar="KIND", help=f"one of {', '.join(KINDS)}")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="draw the scenes that are not right")
    arguments = parser.parse_args()
    if arguments.scenes < 1:
        parser.error("--scenes: expected at least 1")
    kinds = KINDS if arguments.only is None else (arguments.only,)
    seeds = range(arguments.first, arguments.first + arguments.scenes)
    results: list[Judgement] = []
    groups = []
    for kind in kinds:
        first = len(results)
        for give_radius in (True, False):
            scenes = draw_scenes(kind, seeds, give_radius)
            results += judge_scenes(
                scenes, arguments.pictures, give_radius=give_radius, bare=kind == "points"
            )
        own = {id(found) for found in results[first:]}
        groups.append((kind, lambda found, own=own: id(found) in own))
    print(f"\n{format_summary(results, 'kind', groups)}")
    return 0


def draw_scenes(kind: str, seeds: range, give_radius: bool) -> Iterator[SyntheticScene]:
    """Draw the scenes of a kind whose radius is given, or the others."""
    for seed in seeds:
        if (seed % 2 == 0 and kind != "mixed") == give_radius:
            yield frame_scene("usual" if kind == "points" else kind, seed)


if __name__ == "__main__":
    run_bench(main)
