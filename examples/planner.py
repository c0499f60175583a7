"""A planner in a simulator: it looks at a rope, decides with strand's model, acts, and looks again.

    MUJOCO_GL=egl python examples/planner.py untie --views 3 --seed 1

Tasks: `pick` a free end, `straighten` a rope with a loop, `untie` a slip loop or a loose overhand knot.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from itertools import compress

import numpy as np
import simulation as sim

import strand

See = Callable[[sim.World], strand.Model]

LIFT = 0.06  # metres: height at which the gripper carries a strand over others
LOOKS = 12  # looks before the planner gives up
ALONG = np.array([0.0, 1.0, 0.0])  # direction of a straightened rope, through the table's middle
STRAIGHT = 0.02  # metres: largest deviation of a straight rope
PULL = 0.04  # metres: how far an end is pulled beyond its goal


def see(world: sim.World) -> strand.Model:
    """Look at the rope, and return its model."""
    return strand.reconstruct(sim.look(world), sim.RADIUS, sim.BOUNDS, ropes=1)


def pick(world: sim.World, see: See = see) -> bool:
    """Lift the end with the longest free stretch."""
    model = see(world)
    chain, grasps = model.chains[0], model.grasps(sim.GRIPPER, sim.TABLE)
    # grasps near an end without a crossing between
    near = [min(grasp.free) == min(grasp.s, chain.length - grasp.s) < 0.03 for grasp in grasps]
    if not any(near):
        return False
    grasp = max(compress(grasps, near), key=lambda grasp: (grasp.on_top, max(grasp.free)))
    sim.carry(world, sim.grasp_rope(world, grasp) + np.array([0.0, 0.0, LIFT]))
    return True


def untie(world: sim.World, see: See = see) -> bool:
    """Undo one crossing after the other until none is left."""
    for _ in range(LOOKS):
        model = see(world)
        plan = model.pull_plan()
        if not plan.pulls:
            return not plan.left
        pull = plan.pulls[0]
        if not move(world, model, pull.s, pull.distance * pull.direction, LIFT if pull.lift else 0.0):
            return False
    return False


def straighten(world: sim.World, see: See = see) -> bool:
    """Untie the rope, then pull its ends apart by turns until it is straight."""
    if not untie(world, see):
        return False
    for turn in range(LOOKS):
        model = see(world)
        chain = model.chains[0]
        if chain.shape_error(make_line(chain)).worst < STRAIGHT:
            return True
        # the other end is free, so a pull beyond the rope's length drags the rope straight
        first, last = chain.points[0], chain.points[-1]
        goal = np.sign((last - first) @ ALONG) * (0.5 * chain.length + PULL) * ALONG
        s, way = (chain.length, goal - last) if turn % 2 else (0.0, -goal - first)
        if not move(world, model, s, way * [1.0, 1.0, 0.0], LIFT):
            return False
    return False


def make_line(chain: strand.Chain) -> np.ndarray:
    """Return the (2, 3) ends of a straight line through a rope's ends, as long as the rope."""
    first, last = chain.points[0], chain.points[-1]
    half = 0.5 * chain.length * (last - first) / np.linalg.norm(last - first)
    return 0.5 * (first + last) + np.stack([-half, half])


def move(world: sim.World, model: strand.Model, s: float, way: np.ndarray, lift: float) -> bool:
    """Grasp the rope near an arc length, lift, carry and release it; return False if no grasp exists."""
    grasps = model.grasps(sim.GRIPPER, sim.TABLE)
    if not grasps:
        return False
    grasp = min(grasps, key=lambda grasp: abs(grasp.s - s) - 0.01 * grasp.score)
    place, up = sim.grasp_rope(world, grasp), np.array([0.0, 0.0, lift])
    sim.carry(world, place + up, place + up + way, place + way)
    sim.release(world)
    return True


def draw_rope(task: str, seed: int) -> np.ndarray:
    """Return the (N, 3) nodes of the rope at the start of a task, metres."""
    if task == "untie":
        return sim.turned(strand.synthetic.shape(("overhand", "paper")[seed % 2], sim.RADIUS, 0.45), seed)
    return strand.synthetic.random_ropes(1 if task == "straighten" else 1 + seed % 3, 1, sim.RADIUS, seed)[0]


TASKS = {"pick": pick, "straighten": straighten, "untie": untie}


def main() -> None:
    """Do a task, and print the number of crossings at its end."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("task", choices=TASKS)
    parser.add_argument("--views", type=int, default=3, help="1 to 7")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    world = sim.lay(draw_rope(options.task, options.seed), options.views, options.seed)
    done = TASKS[options.task](world)
    print(f"{'done' if done else 'given up'}: {len(sim.get_rope(world).crossings())} crossings are left")


if __name__ == "__main__":
    main()
