"""Let the planner of examples/tracking.py work with a tracker, and with an answer to each single frame.

MUJOCO_GL=egl python benches/tracking_planner.py [--seeds N] [--first SEED] [--views V] [--film DIR]

The loop is the same for both, only its answers differ. Both are given the rope's radius and length, and masks
of the rope and of the grippers. Single frames are reconstructed with the last answer as `previous`. They know
no motion, so the rope is expected where it is. In `untie`, only frames before a pull are reconstructed, as no
other decides anything. The simulated time does not wait for answers. The simulated rope is judged:

- `pick`: the gripper holds the rope alone, within 15 mm of the wanted place along it. The distance is that
  from the gripper to the place when it closes, seen from above.
- `follow`: the distance in each frame of three seconds.
- `untie`: nothing crosses any more.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from planning import draw_film

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

import simulation as sim

import strand
import tracking

WITHIN = 0.015  # metres along the rope, of the wanted place
FRAMES_A_PHOTO = 4


class SingleFrames:
    """The rope in each frame by itself; its length in metres is known."""

    def __init__(self, length: float) -> None:
        self.length = length
        self.model: strand.Model | None = None
        self.views: Sequence[strand.View] = ()

    def look(self, views: Sequence[strand.View], _: float) -> None:
        self.views = views

    def get_model(self) -> strand.Model:
        if self.views:
            try:
                self.model = strand.reconstruct(
                    self.views, sim.RADIUS, ropes=1, length=self.length, previous=self.model
                )
            except strand.NotEnoughDataError:
                if self.model is None:
                    raise
            self.views = ()
        assert self.model is not None
        return self.model

    def predict(self, _: float) -> strand.Chain:
        return self.get_model().chains[0]

    def hold(self, s: float, place: np.ndarray, time: float) -> None:
        """Do nothing: a frame by itself has no use for it."""

    def release(self, s: float) -> None:
        """Do nothing."""


class Watched:
    """Passes another sight on, and notes in every frame what is true."""

    def __init__(self, sight: tracking.Sight, world: sim.World) -> None:
        self.sight, self.world = sight, world
        self.hold, self.release = sight.hold, sight.release
        self.grippers: list[np.ndarray] = []
        self.ropes: list[strand.Chain] = []
        self.seconds: list[float] = []
        self.turned: bool | None = None  # whether the answers start at the rope's last end

    def look(self, views: Sequence[strand.View], time: float) -> None:
        world = self.world
        if world.film is not None and len(self.ropes) % FRAMES_A_PHOTO == 0:
            world.film.append(sim.take_photo(world))
        self.grippers.append(world.data.mocap_pos[0].copy())
        self.ropes.append(sim.get_rope(world))
        self._time(self.sight.look, views, time)

    def get_model(self) -> strand.Model:
        model = self._time(self.sight.get_model)
        if self.turned is None and model.chains:
            ends, true = model.chains[0].points[[0, -1]], self.ropes[-1].points[[0, -1]]
            gaps = [np.linalg.norm(ends - way, axis=1).sum() for way in (true, true[::-1])]
            self.turned = bool(gaps[1] < gaps[0])
        return model

    def predict(self, time: float) -> strand.Chain:
        return self._time(self.sight.predict, time)

    def _time(self, call, *arguments):
        start = time.perf_counter()
        try:
            return call(*arguments)
        finally:
            self.seconds.append(time.perf_counter() - start)

    def find_place(self, s: float) -> float:
        """Return the arc length on the simulated rope, without its round ends, of a place of the answers."""
        return self.ropes[-1].length + sim.RADIUS - s if self.turned else s - sim.RADIUS

    def is_held(self, s: float) -> bool:
        """Tell whether the gripper holds the rope alone, where it closed in the last frame near a place."""
        held = int(self.world.data.eq_active[: sim.MAX_HELD].sum())
        found = self.ropes[-1].nearest(self.grippers[-1][None])
        return held == 1 and bool(abs(found.s[0] - self.find_place(s)) <= WITHIN)

    def measure(self, s: float, frames: int) -> tuple[np.ndarray, np.ndarray]:
        """Return a place's distances from the gripper, metres, and speeds, metres per second, from above.

        They are those of the last frames.
        """
        at = self.find_place(s)
        places = np.array([rope.at(at)[:2] for rope in self.ropes])
        distances = np.linalg.norm(np.array(self.grippers)[:, :2] - places, axis=1)
        speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / sim.FRAME
        return distances[len(distances) - frames :], speeds[len(speeds) - frames :]


@dataclass(frozen=True, eq=False)
class Run:
    """One run of a task: whether it worked, distances, speeds, and the time for an answer, in SI units."""

    done: bool
    distances: np.ndarray
    speeds: np.ndarray
    seconds: float


def try_task(task: str, sight: type, views: int, seed: int, film: bool) -> tuple[Run, sim.World]:
    """Run a task, and judge the simulated rope."""
    world, length, s = tracking.lay(task, views, seed)
    world.film = [sim.take_photo(world)] if film else None
    watched = Watched(sight(length), world)
    try:
        tracking.TASKS[task](world, watched, s)
    except strand.StrandError as error:
        print(f"{task} {seed}: {error}", file=sys.stderr)
    if film:
        world.film.append(sim.take_photo(world))
    frames = {"pick": 1, "follow": round(tracking.FOLLOWED / sim.FRAME), "untie": 0}[task]
    # the times of calls that only return what is known already do not count
    answers = [seconds for seconds in watched.seconds if seconds > 0.002]
    done = not sim.get_rope(world).crossings() if task == "untie" else watched.is_held(s)
    return Run(done, *watched.measure(s, frames), float(np.median(answers))), world


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--seeds", type=int, default=6, metavar="N", help="runs of a task (default: 6)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument("--views", type=int, default=1, metavar="V", help="cameras (default: 1)")
    parser.add_argument("--tasks", nargs="+", choices=tracking.TASKS, default=list(tracking.TASKS))
    parser.add_argument("--film", type=Path, metavar="DIR", help="draw a strip of each task's first run")
    options = parser.parse_args()
    print_head(
        "task", "answers", "done", "distance (median)", "95 %", "place's speed (median)", "s an answer"
    )
    for task in options.tasks:
        for name, sight in (("tracker", tracking.Tracked), ("single frames", SingleFrames)):
            runs = []
            for seed in range(options.first, options.first + options.seeds):
                film = options.film is not None and seed == options.first
                run, world = try_task(task, sight, options.views, seed, film)
                runs.append(run)
                if film:
                    draw_film(world, options.film / f"tracking_{task}_{name.replace(' ', '_')}.png")
                middle = f"{1e3 * np.median(run.distances):.1f} mm" if len(run.distances) else ""
                print(f"{task} by {name}, seed {seed}: {run.done} {middle}", file=sys.stderr, flush=True)
            print_row(task, name, *_describe(task, runs))
    return 0


def _describe(task: str, runs: Sequence[Run]) -> list[str]:
    """Return the cells of a row."""
    done = "" if task == "follow" else f"{sum(run.done for run in runs)} of {len(runs)}"
    seconds = f"{np.median([run.seconds for run in runs]):.3f}"
    if task == "untie":
        return [done, "", "", "", seconds]
    distances = 1e3 * np.concatenate([run.distances for run in runs])
    speed = 1e3 * np.median(np.concatenate([run.speeds for run in runs]))
    middle, most = np.percentile(distances, (50, 95))
    return [done, f"{middle:.1f} mm", f"{most:.1f} mm", f"{speed:.0f} mm/s", seconds]


if __name__ == "__main__":
    run_bench(main)
