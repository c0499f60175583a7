"""A rope on a table in MuJoCo, reconstructed from simulated depth images and compared with the truth.

    MUJOCO_GL=egl python examples/simulated_rope.py --shape overhand --views 3

The rope settles under its weight; then each camera takes a depth image with noise, see simulation.py.
"""

from __future__ import annotations

import argparse

import numpy as np
from simulation import BOUNDS, RADIUS, get_rope, lay, look

import strand


def main() -> None:
    """Simulate, look, reconstruct, compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--shape", default="overhand", help="one of strand.synthetic.SHAPES (default: overhand)"
    )
    parser.add_argument("--views", type=int, default=3, choices=range(1, 8), metavar="1 to 7")
    parser.add_argument(
        "--noise", type=float, default=0.0003, help="standard deviation of the depths, metres"
    )
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()

    world = lay(strand.synthetic.shape(options.shape), options.views, options.seed)
    found = strand.reconstruct(look(world, options.noise), radius=RADIUS, bounds=BOUNDS, ropes=1)

    chain, truth = found.chains[0], get_rope(world)
    points = truth.at(np.linspace(0.0, truth.length, 400))
    error = chain.nearest(points).distance
    print(f"off by {np.sqrt((error**2).mean()) * 1e3:.2f} mm (RMS), {error.max() * 1e3:.2f} mm at most")
    # the simulated rope has round ends, a radius beyond its nodes
    length = truth.length + 2.0 * RADIUS
    print(f"{chain.length * 1e3:.0f} mm of {length * 1e3:.0f} mm, confidence {found.confidence:.2f}")


if __name__ == "__main__":
    main()
