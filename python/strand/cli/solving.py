"""A scene's ropes, by what is known of them: from the command line, or else from the scene."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

import strand
from strand import config
from strand.cli.progress import progress
from strand.io.scenes import Scene
from strand.views.box import Bounds, extraction_range


def solve(options: argparse.Namespace, recorded: Scene, keep_stages: bool) -> strand.Model:
    """Reconstruct a scene's ropes; say what is at work."""
    given = known(options, recorded)
    with progress() as show:
        return strand.reconstruct(recorded.views, **given, keep_stages=keep_stages, progress=show)


def known(options: argparse.Namespace, recorded: Scene | None = None) -> dict[str, Any]:
    """Arguments of a reconstruction: what the command line says, or else the scene."""
    return {
        "radius": options.radius if recorded is None else radius_of(options, recorded),
        "bounds": _bounds(options, recorded),
        "ropes": options.ropes,
        "length": options.length[0] if options.length and len(options.length) == 1 else options.length,
        "config": strand.Config() if options.config is None else config.load(options.config),
        "deadline": options.deadline,
    }


def in_words(options: argparse.Namespace, recorded: Scene) -> dict[str, str]:
    """Say what was known beforehand."""
    radius, bounds = radius_of(options, recorded), _bounds(options, recorded)
    given = {
        "scene": f"{options.scene[0]}",
        "radius": "not given: estimated" if radius is None else f"{radius * 1e3:.2f} mm",
        "ropes": "not given" if options.ropes is None else f"{options.ropes}",
        "lengths": ", ".join(f"{length * 1e3:.0f} mm" for length in options.length or ()) or "not given",
        "extraction range": "not given",
        "configuration": "defaults" if options.config is None else f"{options.config}",
    }
    if bounds is not None:
        given["extraction range"] = f"{extraction_range(bounds)}"
    return given


def radius_of(options: argparse.Namespace, recorded: Scene) -> float | None:
    """Return the ropes' radius, metres; None if it is not known."""
    return recorded.radius if options.radius is None else options.radius


def _bounds(options: argparse.Namespace, recorded: Scene | None) -> Bounds | None:
    if options.bounds is None:
        return None if recorded is None else recorded.bounds
    return np.array(options.bounds[:3]), np.array(options.bounds[3:])
