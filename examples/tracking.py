"""The planner's loop, closed by a tracker: it sees every frame, while grippers move the rope and cover it.

    MUJOCO_GL=egl python examples/tracking.py pick --seed 1

Tasks: `pick` a place of a rope that a second gripper drags, `follow` such a place, or `untie` a rope.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
import planner
import simulation as sim

import strand
from strand.ropes.grasps import Grasp

UP = np.array([0.0, 0.0, 1.0])
FIRST = 5  # frames of the rope at rest, before the gripper comes
HOVER = 0.05  # metres from the place to the gripper above it
APPROACH = 2.5  # seconds above the moving place until the gripper descends
DESCENT = 0.5  # seconds
FAST = 0.4  # metres per second: speed of the empty gripper
FOLLOWED = 3.0  # seconds
PULLS = 8  # pulls before the planner gives up
REST = 0.5  # seconds after a pull
ASIDE = np.array([0.0, 0.25, 0.25])  # metres: where the empty gripper covers little of the rope
DRAGGED = 0.15  # metres per second: speed of the second gripper
CIRCLE = 0.22  # metres: radius of its circle around the table's middle
DRAG_HEIGHT = 0.02  # metres above the table


class Sight(Protocol):
    """The questions about a rope that the tasks ask."""

    def look(self, views: Sequence[strand.View], time: float) -> None:
        """Take the images of a time, seconds."""

    def get_model(self) -> strand.Model:
        """Return the rope in the last images."""

    def predict(self, time: float) -> strand.Chain:
        """Return the rope at a later time, seconds."""

    def hold(self, s: float, place: np.ndarray, time: float) -> None:
        """Learn that the gripper holds the rope, and where it is."""

    def release(self, s: float) -> None:
        """Learn that the gripper holds the rope no more."""


class Tracked:
    """The rope as a tracker follows it; its length in metres is known."""

    def __init__(self, length: float) -> None:
        self.tracker = strand.Tracker(sim.RADIUS, ropes=1, length=length)

    def look(self, views: Sequence[strand.View], time: float) -> None:
        """Take the images of a time, seconds."""
        self.track = self.tracker.update(views, time)

    def get_model(self) -> strand.Model:
        """Return the rope in the last images."""
        return self.track.model

    def predict(self, time: float) -> strand.Chain:
        """Return the rope at a later time, seconds."""
        return self.tracker.predict(time).ropes[0]

    def hold(self, s: float, place: np.ndarray, time: float) -> None:
        """Tell the tracker where the gripper holds the rope."""
        self.tracker.anchor(0, s, place, time)

    def release(self, s: float) -> None:
        """Tell the tracker that the gripper has let go."""
        self.tracker.release(0, s)


def pick(world: sim.World, sight: Sight, s: float) -> bool:
    """Grasp a moving rope at an arc length, metres, and lift it."""
    grasp = enter(world, sight, s)
    if grasp is None:
        return False
    hover(world, sight, grasp, s, APPROACH)
    closing = world.data.time + DESCENT
    while world.data.time < closing:
        # the gripper moves with the rope on its way down, as it goes to where the rope will be
        grasp = turn_grasp(grasp, sight.predict(closing), s)
        sim.aim(world, grasp)
        sim.steer(world, grasp.pose[:3, 3], closing, FAST)
        sight.look(sim.watch(world), world.data.time)
    sim.close(world, grasp)
    sim.carry(world, world.data.mocap_pos[0] + planner.LIFT * UP)
    return True


def follow(world: sim.World, sight: Sight, s: float) -> bool:
    """Keep the fingers above a place of a moving rope, at an arc length, metres."""
    grasp = enter(world, sight, s)
    if grasp is None:
        return False
    hover(world, sight, grasp, s, APPROACH + FOLLOWED)
    return True


def untie(world: sim.World, sight: Sight, s: float = 0.0) -> bool:
    """Undo one crossing after the other until none is left; the arc length does not matter."""
    wait(world, sight, FIRST * sim.FRAME)
    sim.put_gripper(world, ASIDE)
    for _ in range(PULLS):
        model = sight.get_model()
        plan, grasps = model.pull_plan(), model.grasps(sim.GRIPPER, sim.TABLE)
        if not plan.pulls or not grasps:
            return bool(grasps) and not plan.left
        pull = plan.pulls[0]
        grasp = min(grasps, key=lambda grasp: abs(grasp.s - pull.s) - 0.01 * grasp.score)
        place, way = grasp.pose[:3, 3], pull.distance * pull.direction
        lift = planner.LIFT * UP * pull.lift
        sim.aim(world, grasp)
        go(world, sight, place - sim.RETREAT * grasp.approach, speed=FAST)
        go(world, sight, place)
        sim.close(world, grasp)
        for goal in (place + lift, place + lift + way, place + way):
            go(world, sight, goal, grasp.s)
        sight.release(grasp.s)
        sim.let_go(world)
        go(world, sight, world.data.mocap_pos[0] + sim.RETREAT * UP)
        sim.touch(world)
        go(world, sight, ASIDE, speed=FAST)
        wait(world, sight, REST)
    return False


def enter(world: sim.World, sight: Sight, s: float) -> Grasp | None:
    """Look at the rope at rest, and bring the gripper above a place; return its grasp, if there is one."""
    wait(world, sight, FIRST * sim.FRAME)
    grasps = sight.get_model().grasps(sim.GRIPPER, sim.TABLE)
    if not grasps:
        return None
    grasp = turn_grasp(min(grasps, key=lambda grasp: abs(grasp.s - s)), sight.predict(world.data.time), s)
    sim.aim(world, grasp)
    sim.put_gripper(world, grasp.pose[:3, 3] + sim.RETREAT * UP)
    return grasp


def hover(world: sim.World, sight: Sight, grasp: Grasp, s: float, seconds: float) -> None:
    """Keep the gripper above a place of the rope."""
    end = world.data.time + seconds
    while world.data.time < end:
        soon = world.data.time + sim.FRAME
        grasp = turn_grasp(grasp, sight.predict(soon), s)
        sim.aim(world, grasp)
        sim.steer(world, grasp.pose[:3, 3] + HOVER * UP, soon, FAST)
        sight.look(sim.watch(world), world.data.time)


def turn_grasp(grasp: Grasp, chain: strand.Chain, s: float) -> Grasp:
    """Return a grasp from above at an arc length of a chain, metres."""
    along = chain.tangent_at(s) * [1.0, 1.0, 0.0]
    along /= np.linalg.norm(along)
    pose = np.eye(4)
    pose[:3] = np.stack([along, np.cross(-UP, along), -UP, chain.at(s)], axis=1)
    return replace(grasp, s=s, pose=pose)


def go(
    world: sim.World, sight: Sight, goal: np.ndarray, held: float | None = None, speed: float = sim.SPEED
) -> None:
    """Move the gripper in a straight line, with the rope held at an arc length, metres, or not."""
    while np.linalg.norm(goal - world.data.mocap_pos[0]) > 1e-4:
        sim.steer(world, goal, speed=speed)
        if held is not None:
            sight.hold(held, world.data.mocap_pos[0], world.data.time)
        sight.look(sim.watch(world), world.data.time)


def wait(world: sim.World, sight: Sight, seconds: float) -> None:
    """Look while nothing is asked of the gripper."""
    end = world.data.time + seconds
    while world.data.time < end:
        sim.wait(world, sim.FRAME)
        sight.look(sim.watch(world), world.data.time)


def make_circle(start: np.ndarray, begin: float, turn: float) -> Callable[[float], np.ndarray]:
    """Return a path for `drag`: from a (3,) place to a circle around the table's middle, and along it."""
    radius, angle = np.hypot(*start[:2]), np.arctan2(start[1], start[0])

    def path(time: float) -> np.ndarray:
        way = DRAGGED * max(time - begin, 0.0)
        share = min(way / 0.1, 1.0)
        reach = radius + (CIRCLE - radius) * 0.5 * (1.0 - np.cos(np.pi * share))
        at = angle + turn * way / CIRCLE
        return np.array([reach * np.cos(at), reach * np.sin(at), start[2] + share * DRAG_HEIGHT])

    return path


def lay(task: str, views: int, seed: int) -> tuple[sim.World, float, float]:
    """Return a world, the rope's length, and the arc length that the task is about, metres."""
    if task == "untie":
        world = sim.lay(planner.draw_rope("untie", seed), views, seed)
    else:
        world = sim.lay(strand.synthetic.random_ropes(seed % 2, 1, sim.RADIUS, seed)[0], views, seed)
        vertex = (0, -1)[seed // 2 % 2]
        start = world.data.flexvert_xpos[vertex].copy()
        path = make_circle(start, world.data.time + FIRST * sim.FRAME, (-1.0, 1.0)[seed // 4 % 2])
        sim.drag(world, range(world.model.nflexvert)[vertex], path)
    sim.stiffen(world)
    length = sim.get_rope(world).length + 2.0 * sim.RADIUS  # a tape measure tells it
    return world, length, np.random.default_rng(seed).uniform(0.3, 0.7) * length


TASKS = {"pick": pick, "follow": follow, "untie": untie}


def main() -> None:
    """Do a task, and print where the gripper is in the end, or how many crossings are left."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("task", choices=TASKS)
    parser.add_argument("--views", type=int, default=1, help="1 to 7")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    world, length, s = lay(options.task, options.views, options.seed)
    done = TASKS[options.task](world, Tracked(length), s)
    print("done" if done else "given up", end=": ")
    rope = sim.get_rope(world)
    if options.task == "untie":
        print(f"{len(rope.crossings())} crossings are left")
    else:
        found = rope.nearest(world.data.mocap_pos[:1])
        at = found.s[0] + sim.RADIUS
        print(f"wanted {s * 1e3:.0f} mm, is at {at * 1e3:.0f} or {(length - at) * 1e3:.0f} mm from an end")


if __name__ == "__main__":
    main()
