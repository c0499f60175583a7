"""Let the planner of examples/ work in a simulator, with strand and with a nearest-point chain.

MUJOCO_GL=egl python benches/planning.py [--seeds N] [--first SEED] [--views V] [--film DIR]

The planner is the same for both, only its input differs. The nearest-point chain knows no crossings, like
simple trackers of ropes. It thins the points above the table to one per cube as wide as the rope's radius. It
starts at the point that is farthest from their middle, and goes on to the nearest point. The bench judges the
place of the simulated rope in the end, not the planner's report:

- `pick`: one end is held alone in the air, and no part beyond 15 cm along the rope has moved by 1 cm.
- `straighten`: the rope is nowhere more than 3 cm off a straight line of its length, and crosses nothing.
- `untie`: nothing crosses any more.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

import planner
from simulation import BOUNDS, MAX_HELD, RADIUS, World, get_rope, lay, look, take_photo

import strand

FREE = 0.15  # metres along the rope: beyond this it must not move
MAX_MOVE = 0.01  # metres: motion of the rest of the rope
MIN_LIFT = 0.03  # metres: height of a lifted end
MAX_BEND = 0.03  # metres off a straight line


@dataclass(frozen=True)
class Run:
    """One run of a task: whether it worked, the number of looks, and the seconds for a look."""

    task: str
    done: bool
    looks: int
    seconds: float


def see_nearest_points(world: World) -> strand.Model:
    """Look, and join each point to the nearest remaining point."""
    points = np.concatenate([view.points @ view.pose[:3, :3].T + view.pose[:3, 3] for view in look(world)])
    # without the table, whose depths have noise
    points = points[((points > [*BOUNDS[0][:2], 0.6 * RADIUS]) & (points < BOUNDS[1])).all(axis=1)]
    _, cube = np.unique(np.floor(points / RADIUS).astype(np.int64), axis=0, return_inverse=True)
    cube = cube.ravel()
    count = np.bincount(cube)
    left = np.stack([np.bincount(cube, column) / count for column in points.T], axis=1)
    if len(left) < 2:
        raise strand.NotEnoughDataError("views: the rope is out of sight")
    # the cameras see the upper side
    left[:, 2] -= 0.5 * RADIUS
    at = int(np.linalg.norm(left - left.mean(axis=0), axis=1).argmax())
    path = [left[at]]
    left = np.delete(left, at, axis=0)
    while len(left):
        away = np.linalg.norm(left - path[-1], axis=1)
        at = int(away.argmin())
        if away[at] > 6.0 * RADIUS and len(path) > 1:
            break
        # skips the points beside the path
        path.append(left[at])
        left = left[np.linalg.norm(left - left[at], axis=1) > 1.5 * RADIUS]
    return strand.Model((strand.Chain(np.array(path), RADIUS),), world.poses)


def try_task(
    task: str, see: Callable[[World], strand.Model], views: int, seed: int, film: bool
) -> tuple[Run, World]:
    """Run a task, and judge the simulated rope."""
    world = lay(planner.draw_rope(task, seed), views, seed)
    world.film = [take_photo(world)] if film else None
    before, seconds = get_rope(world).points, []

    def see_timed(world: World) -> strand.Model:
        start = time.perf_counter()
        model = see(world)
        seconds.append(time.perf_counter() - start)
        return model

    try:
        planner.TASKS[task](world, see_timed)
    except strand.StrandError as error:
        print(f"{task} {seed}: {error}", file=sys.stderr)
    return Run(task, RIGHT[task](world, before), len(seconds), statistics.median(seconds or [0.0])), world


def _is_picked(world: World, before: np.ndarray) -> bool:
    after = get_rope(world).points
    held = int(world.data.eq_active[:MAX_HELD].sum())
    s = get_rope(world).arc_length
    moved = np.linalg.norm(after - before, axis=1)
    lifted = [z > MIN_LIFT for z in (after[0, 2], after[-1, 2])]
    rest = s > FREE if lifted[0] else s < s[-1] - FREE
    return held == 1 and any(lifted) and bool(moved[rest].max() < MAX_MOVE)


def _is_straight(world: World, _: np.ndarray) -> bool:
    chain = get_rope(world)
    return not chain.crossings() and chain.shape_error(planner.make_line(chain)).worst < MAX_BEND


def _is_untied(world: World, _: np.ndarray) -> bool:
    return not get_rope(world).crossings()


RIGHT = {"pick": _is_picked, "straighten": _is_straight, "untie": _is_untied}


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--seeds", type=int, default=20, metavar="N", help="runs of a task (default: 20)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument("--views", type=int, default=3, metavar="V", help="cameras (default: 3)")
    parser.add_argument("--tasks", nargs="+", choices=RIGHT, default=list(RIGHT))
    parser.add_argument("--film", type=Path, metavar="DIR", help="draw a strip of each task's first run")
    options = parser.parse_args()
    print_head("task", "chain", "done", "looks (median)", "seconds a look")
    for task in options.tasks:
        for name, see in (("strand", planner.see), ("nearest points", see_nearest_points)):
            runs = []
            for seed in range(options.first, options.first + options.seeds):
                film = options.film is not None and seed == options.first
                run, world = try_task(task, see, options.views, seed, film)
                runs.append(run)
                if film:
                    draw_film(world, options.film / f"{task}_{name.replace(' ', '_')}.png")
            done = sum(run.done for run in runs)
            failed = [seed for seed, run in enumerate(runs, options.first) if not run.done]
            looks, seconds = (
                statistics.median(values)
                for values in zip(*((r.looks, r.seconds) for r in runs), strict=True)
            )
            print_row(task, name, f"{done} of {len(runs)}", looks, f"{seconds:.2f}")
            if failed:
                print(f"{task} by {name} failed with the seeds {failed}", file=sys.stderr, flush=True)
    return 0


def draw_film(world: World, path: Path) -> None:
    """Save three or six photos of a run in rows, the first and the last among them."""
    picked = np.linspace(0, len(world.film) - 1, 6 if len(world.film) > 5 else 3).round().astype(int)
    photos = [world.film[number][60:-100, 90:-90] for number in picked]
    rows = [np.concatenate(photos[i : i + 3], axis=1) for i in range(0, len(photos), 3)]
    path.parent.mkdir(parents=True, exist_ok=True)
    plt.imsave(path, np.concatenate(rows))


if __name__ == "__main__":
    run_bench(main)
