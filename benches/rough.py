"""Reconstruct scenes that are hard to see for one reason each, and count the answers that are right.

python benches/rough.py [--scenes N] [--first SEED] [--only KIND] [--pictures DIR]

The kinds are those of `strand.synthetic.rough_scene`, with seeds from 0 on. Cameras take turns, and so do one
view and three. The radius and the number of ropes are given. `--pictures` draws the scenes that are not
right.
"""

from __future__ import annotations

from pathlib import Path

from lib.judging import format_summary, judge_scenes
from lib.results import make_parser, run_bench
from strand.synthetic import ROUGH, rough_scene


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", type=int, default=10, metavar="N", help="of each kind (default: 10)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument("--only", choices=ROUGH, metavar="KIND", help=f"one of {', '.join(ROUGH)}")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="draw the scenes that are not right")
    arguments = parser.parse_args()
    if arguments.scenes < 1:
        parser.error("--scenes: expected at least 1")
    kinds = ROUGH if arguments.only is None else (arguments.only,)
    seeds = range(arguments.first, arguments.first + arguments.scenes)
    results = judge_scenes((rough_scene(kind, seed) for kind in kinds for seed in seeds), arguments.pictures)
    groups = [(kind, lambda found, kind=kind: found.scene.startswith(kind)) for kind in kinds]
    print(f"\n{format_summary(results, 'kind', groups)}")
    return 0


if __name__ == "__main__":
    run_bench(main)
