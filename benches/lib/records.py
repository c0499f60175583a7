"""Records of answers beside the truth: doubts, alternatives, crossings, and what of them is right."""

from __future__ import annotations

import dataclasses
import signal
import time
from typing import Any

import numpy as np

import strand
from lib.asked_scenes import Asked, draw_asked
from lib.judging import MAX_NEAR
from lib.measure import measure_chains
from order import compare_crossings
from strand.reconstruction.evidence.measured import (
    Circumstances,
    describe_shapes,
    measure_bound,
    measure_evidence,
)
from strand.ropes.order import measure_order

MAX_SECONDS = 20  # of processor time for an answer


def record_answer(seed: int) -> dict[str, Any]:
    """Reconstruct the scene of a seed; return its record for JSON. A late answer counts as none."""
    asked = draw_asked(seed)
    record: dict[str, Any] = {
        "seed": seed,
        "kind": asked.kind,
        "part": asked.part,
        "known": sorted(asked.known),
        "views": len(asked.views),
        "masked": sum(view.mask is not None for view in asked.views),
        "colors": asked.views[0].colors is not None,
        "ropes": len(asked.truth),
    }
    start = time.process_time()
    signal.signal(signal.SIGPROF, raise_timeout)
    signal.setitimer(signal.ITIMER_PROF, MAX_SECONDS)
    try:
        model = strand.reconstruct(asked.views, **asked.known)
    except (strand.StrandError, ValueError, TimeoutError) as error:
        return {**record, "seconds": time.process_time() - start, "error": str(error)}
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    record["seconds"] = time.process_time() - start
    return {**record, **describe_answer(model, asked)}


def raise_timeout(*_: object) -> None:
    """End a reconstruction that takes too long, as a handler of signals."""
    raise TimeoutError(f"no answer after {MAX_SECONDS} s of processor time")


def describe_answer(model: strand.Model, asked: Asked) -> dict[str, Any]:
    """Return an answer's numbers, and whether it is right."""
    radius = asked.radius
    measure = measure_chains([chain.points for chain in model.chains], asked.truth, radius)
    crossings = model.crossings()
    judged = _judge_crossings(model, crossings, asked)
    how = Circumstances(
        model.sensor,
        len(asked.views),
        has_images=any(view.image is not None for view in asked.views),
        has_masks=any(view.mask is not None for view in asked.views),
        has_things=any(warning.kind == "thing" for warning in model.warnings),
        from_images=model.branch == "images",
        knows_ropes="ropes" in asked.known or "length" in asked.known,
        knows_lengths="length" in asked.known,
    )
    shapes = describe_shapes(model.chains)
    return {
        "right": measure.chains == measure.ropes and measure.frechet <= MAX_NEAR,
        "confidence": model.confidence,
        "evidence": measure_evidence(model.doubts, shapes, how),
        "bound": measure_bound(model.doubts),
        "alternatives": [(other.cost, _is_right(other.chains, asked)) for other in model.alternatives],
        "chains": [
            {
                "right": _is_one_right(chain.points, asked),
                "evidence": measure_evidence(chain.doubts, [shape], how),
                "bound": measure_bound(chain.doubts),
            }
            for chain, shape in zip(model.chains, shapes, strict=True)
        ],
        "crossings": [
            {"right": found.right, "evidence": evidence}
            for evidence, found in zip(_describe_crossings(model, crossings), judged, strict=True)
        ],
    }


def _describe_crossings(model: strand.Model, crossings: Any) -> list[dict[str, float]]:
    """Return the evidence about each crossing, without the model's confidence."""
    radii = [sum(model.chains[at[0]].radius for at in (one.over, one.under)) for one in crossings]
    height, sd, angle = (
        np.array([getattr(one, key) for one in crossings]) for key in ("height", "height_sd", "angle")
    )
    place = np.array([one.place for one in crossings]).reshape(-1, 3)
    evidence = measure_order(height, sd, np.array(radii), angle, place, model.doubts)
    return [{name: float(values[k]) for name, values in evidence.items()} for k in range(len(crossings))]


def _judge_crossings(model: strand.Model, crossings: Any, asked: Asked) -> Any:
    """Compare crossings with the true ones, both seen against the model's `up`."""
    up = model.up
    aside = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    aside /= np.linalg.norm(aside)
    turn = np.stack([aside, np.cross(up, aside), up])
    chains = [
        strand.Chain(chain.points @ turn.T, chain.radius, closed=chain.closed) for chain in model.chains
    ]
    seen = [
        dataclasses.replace(one, point_over=turn @ one.point_over, point_under=turn @ one.point_under)
        for one in crossings
    ]
    return compare_crossings(chains, seen, [nodes @ turn.T for nodes in asked.truth], asked.radius)


def _is_right(chains: Any, asked: Asked) -> bool:
    measure = measure_chains(chains, asked.truth, asked.radius)
    return bool(measure.chains == measure.ropes and measure.frechet <= MAX_NEAR)


def _is_one_right(nodes: Any, asked: Asked) -> bool:
    return any(measure_chains([nodes], [rope], asked.radius).frechet <= MAX_NEAR for rope in asked.truth)
