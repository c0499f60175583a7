"""Whether knots are named right, and how long that takes.

python benches/knots.py [--count N] [--nodes N] [--seed N] [--runs N] [--scenes N]

Each chain is a knot of up to seven crossings: a closed braid. It is mirrored by chance, cut open at a
random place with up to 1 % of it left out, resampled, moved by smooth noise, stretched and turned. Braids are
those of KnotInfo (knotinfo.org), and sums of these for composite knots. A name counts as right with its
chirality. Times are processor time of `strand.knot` on one thread, with the knotted core: the least of --runs
calls.

With --scenes so many simulated scenes of each shape of `strand.synthetic.shape` are reconstructed from depth,
and their ropes and true centrelines named.
"""

from __future__ import annotations

import time
from collections import Counter

import numpy as np
from numpy.typing import NDArray

import strand
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.ropes.knots import Knot

Array = NDArray[np.float64]

# by name: the braid whose closure is the right knot, and whether its mirror image is another one
BRAIDS: dict[str, tuple[tuple[int, ...], bool]] = {
    "0_1": ((1, -2), False),
    "3_1": ((1, 1, 1), True),
    "4_1": ((1, -2, 1, -2), False),
    "5_1": ((1, 1, 1, 1, 1), True),
    "5_2": ((1, 1, 1, 2, -1, 2), True),
    "6_1": ((1, 1, 2, -1, -3, 2, -3), True),
    "6_2": ((1, 1, 1, -2, 1, -2), True),
    "6_3": ((1, 1, -2, 1, -2, -2), False),
    "7_1": ((1, 1, 1, 1, 1, 1, 1), True),
    "7_2": ((1, 1, 1, 2, -1, 2, 3, -2, 3), True),
    "7_3": ((1, 1, 1, 1, 1, 2, -1, 2), True),
    "7_4": ((1, 1, 2, -1, 2, 2, 3, -2, 3), True),
    "7_5": ((1, 1, 1, 1, 2, -1, 2, 2), True),
    "7_6": ((1, 1, -2, 1, 3, -2, 3), True),
    "7_7": ((1, -2, 1, -2, 3, -2, 3), True),
    # composite knots: strands of their own, joined by what they share
    "granny": ((1, 1, 1, 2, 2, 2), True),
    "square": ((1, 1, 1, -2, -2, -2), False),
    "3_1#4_1": ((1, 1, 1, 2, -3, 2, -3), True),
}
COMPOSITE = {"granny": "3_1#3_1", "square": "3_1#3_1"}


def closed_braid(word: tuple[int, ...], steps: int = 24) -> Array:
    """(N, 3) A braid closed about the z axis: strands a unit apart, right-handed for numbers above 0."""
    strands = max(abs(letter) for letter in word) + 1
    turn = (1 - np.cos(np.pi * np.arange(steps) / steps)) / 2
    bump = np.sin(np.pi * np.arange(steps) / steps) ** 2
    position, nodes = 0, []
    for _ in range(strands):
        for k, letter in enumerate(word):
            low = abs(letter) - 1
            rise, height = np.zeros(steps), np.zeros(steps)
            if position == low:
                rise, height, after = turn, np.sign(letter) * bump / 2, low + 1
            elif position == low + 1:
                rise, height, after = -turn, -np.sign(letter) * bump / 2, low
            else:
                after = position
            angle = 2 * np.pi * (k + np.arange(steps) / steps) / len(word)
            radius = 2.0 + position + rise
            nodes.append(np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1))
            position = after
    return np.concatenate(nodes)


def resampled(nodes: Array, count: int) -> Array:
    """(count, 3) Nodes evenly apart along a polyline, from end to end."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(nodes, axis=0), axis=1))])
    at = np.linspace(0.0, arc[-1], count)
    return np.stack([np.interp(at, arc, nodes[:, k]) for k in range(3)], axis=1)


def smooth_noise(count: int, rng: np.random.Generator) -> Array:
    """(count, 3) A smooth random displacement of standard deviation 1."""
    phase = np.linspace(0.0, 2 * np.pi, count)
    waves = np.arange(1, 25)
    angles = waves[:, None] * phase[:, None, None] + rng.uniform(0, 2 * np.pi, (len(waves), 3))[None]
    return np.asarray(np.sin(angles).sum(axis=1) / np.sqrt(len(waves) / 2))


def knotted_chain(name: str, mirror: bool, nodes: int, rng: np.random.Generator) -> Array:
    """(nodes, 3) An open chain that holds a knot of `BRAIDS`, of about a metre in size."""
    ring = closed_braid(BRAIDS[name][0])
    ring[:, 2] *= -2.0 if mirror else 2.0
    ring = np.roll(ring, rng.integers(len(ring)), axis=0)
    gap = rng.uniform(0.003, 0.01)
    chain = resampled(ring[: int((1 - gap) * len(ring))], nodes)
    chain += rng.uniform(0.02, 0.08) * smooth_noise(nodes, rng)
    stretch = np.exp(rng.uniform(-0.4, 0.4, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    chain = chain * stretch @ turn.T / 8.0
    if rng.random() < 0.5:
        chain = chain[::-1]
    return np.ascontiguousarray(chain)


def drawn(count: int, nodes: int, seed: int) -> list[tuple[str, str | None, Array]]:
    """Chains with their names and chiralities: all knots of `BRAIDS` by turns, mirrored by chance."""
    found = []
    for k in range(count):
        rng = np.random.default_rng((seed, k))
        name = list(BRAIDS)[k % len(BRAIDS)]
        mirror = bool(rng.random() < 0.5)
        hand = ("left" if mirror else "right") if BRAIDS[name][1] else None
        found.append((COMPOSITE.get(name, name), hand, knotted_chain(name, mirror, nodes, rng)))
    return found


def named_scenes(count: int) -> None:
    """Print a table of names from depth."""
    print_head("shape", "true centreline", "from depth")
    for shape in strand.synthetic.SHAPES:
        truth, found = Counter[str](), Counter[str]()
        for seed in range(count):
            scene = strand.synthetic.scene(shape, seed=seed)
            truth[named(strand.knot(scene.truth[0]))] += 1
            model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
            found[" and ".join(named(chain.knot()) for chain in model.chains)] += 1
        print_row(shape, *(", ".join(f"{name}: {n}" for name, n in of.items()) for of in (truth, found)))


def named(knot: Knot) -> str:
    """A knot's name, with its chirality if it has one."""
    return f"{knot.name} {knot.chirality}" if knot.chirality else knot.name


def milliseconds(chain: Array) -> float:
    """Processor time of one call: what else runs does not count."""
    begun = time.process_time()
    strand.knot(chain)
    return (time.process_time() - begun) * 1e3


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument("--count", type=int, default=500, help="how many chains (500)")
    parser.add_argument("--nodes", type=int, default=400, help="nodes of each (400)")
    parser.add_argument("--seed", type=int, default=0, help="where the random numbers begin (0)")
    parser.add_argument("--runs", type=int, default=5, help="calls that are timed for each (5)")
    parser.add_argument("--scenes", type=int, default=0, help="scenes of each shape, instead (0)")
    options = parser.parse_args()
    if options.scenes:
        named_scenes(options.scenes)
        return
    strand.set_num_threads(1)
    total: Counter[str] = Counter()
    right: Counter[str] = Counter()
    times: dict[str, list[float]] = {}
    wrong = []
    for name, hand, chain in drawn(options.count, options.nodes, options.seed):
        knot = strand.knot(chain)
        times.setdefault(name, []).append(min(milliseconds(chain) for _ in range(options.runs)))
        total[name] += 1
        if (knot.name, knot.chirality) == (name, hand):
            right[name] += 1
        else:
            wrong.append(f"{name} {hand}: {knot}")
    print_head("knot", "right", "time, ms: median", "longest")
    for name, taken in times.items():
        print_row(name, f"{right[name]} of {total[name]}", f"{np.median(taken):.2f}", f"{max(taken):.2f}")
    everything = np.concatenate(list(times.values()))
    print(f"\nRight: {right.total()} of {total.total()}; median {np.median(everything):.2f} ms,", end=" ")
    print(f"95 % within {np.percentile(everything, 95):.2f} ms, longest {everything.max():.2f} ms,", end=" ")
    print(f"{np.mean(everything < 5):.1%} under 5 ms.")
    print("\n".join(wrong))


if __name__ == "__main__":
    run_bench(main)
