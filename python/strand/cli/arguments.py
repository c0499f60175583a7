"""The arguments of `strand.reconstruct`: from the command line, or else from the scene."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

import strand
from strand import config
from strand.cli.progress import show_progress
from strand.io.scenes import Scene
from strand.views.box import Bounds, make_box


def reconstruct_scene(options: argparse.Namespace, scene: Scene, keep_stages: bool) -> strand.Model:
    """Reconstruct a scene's ropes, and show the progress."""
    arguments = collect_arguments(options, scene)
    with show_progress() as show:
        return strand.reconstruct(scene.views, **arguments, keep_stages=keep_stages, progress=show)


def collect_arguments(options: argparse.Namespace, scene: Scene | None = None) -> dict[str, Any]:
    """Return keyword arguments of `strand.reconstruct`."""
    return {
        "radius": options.radius if scene is None else choose_radius(options, scene),
        "bounds": _choose_bounds(options, scene),
        "ropes": options.ropes,
        "length": options.length[0] if options.length and len(options.length) == 1 else options.length,
        "config": strand.Config() if options.config is None else config.load(options.config),
        "deadline": vars(options).get("deadline"),
        **{name: vars(options)[name] for name in ("branches", "wire") if vars(options).get(name)},
    }


def describe_arguments(options: argparse.Namespace, scene: Scene) -> dict[str, str]:
    """Return the values that the user or the scene gave, in words."""
    radius, bounds = choose_radius(options, scene), _choose_bounds(options, scene)
    given = {
        "scene": f"{options.scene[0]}",
        "radius": "not given: estimated"
        if radius is None
        else ", ".join(f"{one * 1e3:.2f} mm" for one in np.atleast_1d(radius).tolist()),
        "ropes": "not given" if options.ropes is None else f"{options.ropes}",
        "lengths": ", ".join(f"{length * 1e3:.0f} mm" for length in options.length or ()) or "not given",
        "extraction range": "not given",
        "configuration": "defaults" if options.config is None else f"{options.config}",
    }
    if bounds is not None:
        given["extraction range"] = f"{make_box(bounds)}"
    return given


def choose_radius(options: argparse.Namespace, scene: Scene) -> float | list[float] | None:
    """Return the ropes' radius or radii, metres; None if neither the user nor the scene gives them."""
    given: float | list[float] | None = options.radius
    return scene.radius if given is None else given


def _choose_bounds(options: argparse.Namespace, scene: Scene | None) -> Bounds | None:
    if options.bounds is None:
        return None if scene is None else scene.bounds
    return np.array(options.bounds[:3]), np.array(options.bounds[3:])
