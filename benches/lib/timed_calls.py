"""Reconstruct stored scenes as lines on standard input ask, and answer each with times and a digest, in JSON.

A process of its own, so that it can have another installation of strand and a number of threads. It needs
nothing else of the benches.
"""

from __future__ import annotations

import hashlib
import json
import sys
import time
from typing import Any

import numpy as np

import strand


def reconstruct(stored: dict[str, Any], facts: list[str]) -> tuple[bytes, dict[str, float]]:
    """Reconstruct a scene from its images and some facts about it.

    Return the bits of the answer, and the time of each stage, seconds.
    """
    masks = stored["mask"] if "mask" in facts else [None] * len(stored["depth"])
    views = [
        strand.View.from_depth(image, stored["K"], pose, mask=mask, depth_scale=float(stored["depth_scale"]))
        for image, pose, mask in zip(stored["depth"], stored["poses"], masks, strict=True)
    ]
    given: dict[str, Any] = {}
    if "radius" in facts:
        given["radius"] = float(stored["radius"])
    if "bounds" in facts:
        given["bounds"] = tuple(stored["box"])
    if "ropes" in facts:
        given["ropes"] = sum(key.startswith("truth_") for key in stored)
    if "published" in facts:
        given["config"] = strand.Config.published()
    try:
        model = strand.reconstruct(views, **given)
    except strand.StrandError as error:
        return str(error).encode(), {}
    nodes = b"".join(np.asarray(chain.points).tobytes() for chain in model.chains)
    rest = repr((model.confidence, list(map(str, model.warnings)))).encode()
    return nodes + rest, dict(model.timings)


def time_calls(path: str, facts: list[str], calls: int) -> dict[str, Any]:
    """Return the least times of some calls, seconds, and a digest of the answer.

    They are the processor time, the wall time, and that of each stage.
    """
    with np.load(path) as arrays:
        stored = dict(arrays)
    spent, taken, stages, answer = [], [], [], b""
    for _ in range(calls):
        wall, processor = time.perf_counter(), time.process_time()
        answer, times = reconstruct(stored, facts)
        spent.append(time.process_time() - processor)
        taken.append(time.perf_counter() - wall)
        stages.append(times)
    return {
        "processor": min(spent),
        "wall": min(taken),
        "stages": {stage: min(times[stage] for times in stages) for stage in stages[0]},
        "digest": hashlib.sha256(answer).hexdigest(),
    }


if __name__ == "__main__":
    for line in sys.stdin:
        print(json.dumps(time_calls(**json.loads(line))), flush=True)
