"""Reconstruct random scenes by several threads in one process: memory stays flat, answers keep their bits.

python benches/soak.py [--scenes N] [--threads N] [--first SEED]

The scenes are small and come from seeds. One thread reconstructs them in order, then several threads share
them, and the bench compares each answer bit for bit. It notes the resident memory after each hundredth of the
scenes, when no thread works and the allocator has given back free memory. The slope is that of a straight
line through the second half. The exit code is 1 if an answer differs, or if memory grows by more than 1 kB a
scene, which is less than the nodes of a rope.
"""

from __future__ import annotations

import ctypes
import hashlib
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

import strand
from lib.results import make_parser, run_bench
from strand.synthetic import SHAPES, Camera, Noise, random_ropes, scene

SMALL = (160, 120)  # pixels
MAX_SLOPE = 1.0  # kB of resident memory a scene


def digest_answer(seed: int) -> str:
    """Draw a scene, reconstruct it in one of several ways, and return a digest of the answer."""
    rng = np.random.default_rng(seed)
    views = int(rng.integers(1, 4))
    if rng.random() < 0.5:
        made = scene(
            SHAPES[seed % len(SHAPES)],
            views=views,
            camera=Camera(size=SMALL),
            seed=seed,
            noise=Noise(flying=0.0),
        )
    else:
        chains = random_ropes(int(rng.integers(1, 3)), 1, seed=seed)
        made = scene(
            chains=chains, views=views, camera=Camera(size=SMALL), seed=seed, noise=Noise(flying=0.0)
        )
    config = strand.Config.published() if rng.random() < 0.2 else strand.Config()
    ropes = 1 if rng.random() < 0.5 else None
    whole = hashlib.sha256()
    try:
        model = strand.reconstruct(made.views, made.radius, made.bounds, ropes, config)
    except strand.StrandError as error:
        whole.update(str(error).encode())
    else:
        for array in (*(chain.points for chain in model.chains), model.poses, model.pose_sd):
            whole.update(array.tobytes())
        whole.update(repr((model.confidence, [str(warning) for warning in model.warnings])).encode())
    return whole.hexdigest()


def read_resident() -> float:
    """Return the process's resident memory, kB."""
    ctypes.CDLL(None).malloc_trim(0)
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return float(line.split()[1])
    raise OSError("/proc/self/status: no VmRSS")


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", type=int, default=2000, metavar="N", help="(default: 2000)")
    parser.add_argument("--threads", type=int, default=4, metavar="N", help="(default: 4)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.scenes)
    start = time.perf_counter()
    alone = [digest_answer(seed) for seed in seeds]
    print(f"one thread: {len(seeds)} scenes in {time.perf_counter() - start:.0f} s", flush=True)
    start = time.perf_counter()
    places, sizes, differing = [], [], []
    every = max(len(seeds) // 100, 1)
    with ThreadPoolExecutor(arguments.threads) as pool:
        for first in range(0, len(seeds), every):
            part = seeds[first : first + every]
            for seed, found in zip(part, pool.map(digest_answer, part), strict=True):
                if found != alone[seed - seeds[0]]:
                    differing.append(seed)
            # no thread works now
            places.append(first)
            sizes.append(read_resident())
    print(f"{arguments.threads} threads: {len(seeds)} scenes in {time.perf_counter() - start:.0f} s")
    half = len(places) // 2
    slope = float(np.polyfit(places[half:], sizes[half:], 1)[0]) if len(places) - half > 1 else 0.0
    print(
        f"resident memory: {sizes[half] / 1e3:.1f} MB halfway, {sizes[-1] / 1e3:.1f} MB at the end, ", end=""
    )
    print(f"{slope:+.3f} kB for each scene")
    print(f"answers that differ from one thread's: {len(differing)} {differing[:10] if differing else ''}")
    return int(bool(differing) or slope > MAX_SLOPE)


if __name__ == "__main__":
    run_bench(main)
