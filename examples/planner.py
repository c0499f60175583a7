"""A planner in a simulator: look at a rope, decide with strand's model of it, act, look again.

    MUJOCO_GL=egl python examples/planner.py untie --views 3 --seed 1

Tasks: `pick` a free end without dragging another strand, `straighten` a rope with a loop, `untie` a slip loop
or a loose overhand knot. The table is simulated by MuJoCo, see simulation.py.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from itertools import compress

import numpy as np
from simulation import BOUNDS, GRIPPER, RADIUS, TABLE, World, carry, lay, look, release, rope, take, turned

import strand

See = Callable[[World], strand.Model]

LIFT = 0.06  # metres, over strands that lie on one another
LOOKS = 12  # how often it looks before it gives up
ALONG = np.array([0.0, 1.0, 0.0])  # where a rope is straightened, through the table's middle
STRAIGHT, PULL = 0.02, 0.04  # metres that it may be off anywhere, and that it is pulled farther


def see(world: World) -> strand.Model:
    """Look, and return the rope."""
    return strand.reconstruct(look(world), RADIUS, BOUNDS, ropes=1)


def pick(world: World, see: See = see) -> bool:
    """Lift the end that lies freest."""
    model = see(world)
    chain, grasps = model.chains[0], model.grasps(GRIPPER, TABLE)
    # near an end, and free up to there
    near = [min(grasp.free) == min(grasp.s, chain.length - grasp.s) < 0.03 for grasp in grasps]
    if not any(near):
        return False
    grasp = max(compress(grasps, near), key=lambda each: (each.on_top, max(each.free)))
    carry(world, take(world, grasp) + np.array([0.0, 0.0, LIFT]))
    return True


def untie(world: World, see: See = see) -> bool:
    """Undo crossing after crossing until none is left."""
    for _ in range(LOOKS):
        model = see(world)
        plan = model.pull_plan()
        if not plan.pulls:
            return not plan.left
        pull = plan.pulls[0]
        if not move(world, model, pull.s, pull.distance * pull.direction, LIFT if pull.lift else 0.0):
            return False
    return False


def straighten(world: World, see: See = see) -> bool:
    """Untie the rope, then pull its ends apart in turn until it is straight."""
    if not untie(world, see):
        return False
    for turn in range(LOOKS):
        model = see(world)
        chain = model.chains[0]
        if chain.shape_error(straight(chain)).worst < STRAIGHT:
            return True
        # the other end is free: what is pulled farther than the rope is long drags it along, and straight
        first, last = chain.points[0], chain.points[-1]
        goal = np.sign((last - first) @ ALONG) * (0.5 * chain.length + PULL) * ALONG
        s, way = (chain.length, goal - last) if turn % 2 else (0.0, -goal - first)
        if not move(world, model, s, way * [1.0, 1.0, 0.0], LIFT):
            return False
    return False


def straight(chain: strand.Chain) -> np.ndarray:
    """(2, 3) Ends of a straight line as long as a rope, along its own ends."""
    first, last = chain.points[0], chain.points[-1]
    half = 0.5 * chain.length * (last - first) / np.linalg.norm(last - first)
    return 0.5 * (first + last) + np.stack([-half, half])


def move(world: World, model: strand.Model, s: float, way: np.ndarray, lift: float) -> bool:
    """Hold the rope near an arc length, lift it, carry it along and put it down, if it can be held."""
    grasps = model.grasps(GRIPPER, TABLE)
    if not grasps:
        return False
    grasp = min(grasps, key=lambda each: abs(each.s - s) - 0.01 * each.score)
    place, up = take(world, grasp), np.array([0.0, 0.0, lift])
    carry(world, place + up, place + up + way, place + way)
    release(world)
    return True


def start(task: str, seed: int) -> np.ndarray:
    """(N, 3) Nodes of the rope that a task begins with, metres: another one for each seed."""
    if task == "untie":
        return turned(strand.synthetic.shape(("overhand", "paper")[seed % 2], RADIUS, 0.45), seed)
    return strand.synthetic.random_ropes(1 if task == "straighten" else 1 + seed % 3, 1, RADIUS, seed)[0]


TASKS = {"pick": pick, "straighten": straighten, "untie": untie}


def main() -> None:
    """Do a task and say how the rope lies then."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("task", choices=TASKS)
    parser.add_argument("--views", type=int, default=3, help="1 to 7")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    world = lay(start(options.task, options.seed), options.views, options.seed)
    done = TASKS[options.task](world)
    print(f"{'done' if done else 'given up'}: {len(rope(world).crossings())} crossings are left")


if __name__ == "__main__":
    main()
