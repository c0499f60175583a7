"""reconstruct(): views in, a point chain model out."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from strand._core import NotEnoughDataError
from strand.config import Config
from strand.reconstruction.answering import build_model
from strand.reconstruction.default import find_chains as find_by_default
from strand.reconstruction.evidence.confidence import compute_trust
from strand.reconstruction.evidence.prior import Prior, check_branches
from strand.reconstruction.hand_eye import find_hand_eye_error
from strand.reconstruction.harness.answer import answer_with_harness
from strand.reconstruction.masks import refuse_empty
from strand.reconstruction.mistakes.diagnosis import explain_errors
from strand.reconstruction.mistakes.units import refuse_poses_in_other_units
from strand.reconstruction.observing import Hints, Scene, observe
from strand.reconstruction.published.method import find_chains as find_published
from strand.reconstruction.radius import Radii
from strand.reconstruction.stages import Found, Observed, Run
from strand.ropes.model import Model
from strand.ropes.netlist import Netlist
from strand.support.checks import check_bool, check_instance, check_positive
from strand.views.box import Bounds, make_box
from strand.views.extract import Extract, extract_views
from strand.views.view import View, placed

_USUAL = Config()
_METHODS: dict[str, Callable[[Observed, Config, Run], Found]] = {
    "default": find_by_default,
    "published": find_published,
}


def reconstruct(
    views: Sequence[View],
    radius: float | Sequence[float] | None = None,
    bounds: Bounds | None = None,
    ropes: int | None = None,
    config: Config | None = None,
    *,
    length: float | Sequence[float] | None = None,
    previous: Model | None = None,
    keep_stages: bool = False,
    progress: Callable[[str], None] | None = None,
    deadline: float | None = None,
    branches: bool | Netlist = False,
    wire: float | None = None,
) -> Model:
    """Turn depth-camera views of ropes into ordered centrelines.

    Parameters
    ----------
    views : sequence of View
        The cameras' views. Registration keeps the pose of the middle view, or of the nearest view that shows
        ropes, and corrects the others.
    radius : float or sequence of float, optional
        The ropes' radius, or the radii of ropes that differ, metres. Without it, the default method
        estimates it; the published method needs one.
    bounds : pair of (3,) array_like, or Box, optional
        The extraction range, metres: low and high corner of a box along the axes of the world frame, or a
        `strand.Box`, which may be turned. The default method looks for ropes among other things on a table
        if no view has a mask, and bounds are absent or include the table (see `strand.find_ropes`). Without
        a table, it takes all points for ropes.
    ropes : int, optional
        The number of ropes; by default as many as the data show. The default method then bridges gaps of any
        length until no more chains are left (see `Chain.bridged`).
    config : Config, optional
        The method and its numbers; by default `Config()`.
    length : float or sequence of float, optional
        The ropes' lengths, metres: one for all ropes, or one for each rope in any order, which also gives
        the number of ropes. The default method then makes bridges over occluded gaps as long as the rest of
        the rope demands, and prefers joins with which the lengths agree. A rope whose length is off by more
        than 2 % and a radius raises a doubt, which lowers the confidence.
    previous : Model, optional
        An earlier model of the same ropes. Chains near its chains start at the same end. All others start at
        the end that lies farther back along the direction (0.83, 0.47, 0.31). Where the views show no table,
        the earlier model's `table` counts if the ropes lie above it. Without masks, colours are searched near
        its chains first, and in the whole image if they do not show all that stands on the table there.
    keep_stages : bool
        Whether to keep the arrays between the stages, in `Model.stages`:

        - "raw", "filtered" and "registered": tuples of (N, 3) arrays, one for each view used;
          "registered" has only some of the points of very dense views;
        - "arcs", the pieces of ropes before they were linked, and "fit", a `TubeFit`;
        - "readings", for answers read from images instead: (M, 3) nodes of all ropes of all readings;
        - "normals", "axis_points" (M, 3), "traced" (chains before the split), "separation" (d* along each),
          "cuts" (its nodes that were cut at) and "segments", for the published method.
    progress : callable, optional
        Called with the name of each stage when it starts.
    deadline : float, optional
        Seconds from the call. Afterwards strand starts no work that an answer can do without. It names what
        it skipped in a doubt and a warning of kind "deadline". There is always an answer: an early deadline
        leaves the shortest way to it, with fewer points. With a deadline, the answer depends on the machine's
        speed.
    branches : bool or Netlist
        Whether the ropes may branch, as the branches of a wire harness do. The answer is then a graph,
        `Model.harness`; a rope is a graph of one edge. Radii may change at junctions. With `branches`, there
        is no `ropes` and no `length`, and the method is the default one. A netlist is the harness as it
        should be: its branches and lengths decide where heights do not, and an answer that lacks some of them
        has a doubt.
    wire : float, optional
        The radius of one wire, metres, if the branches are bundles of equal wires. Edges then have a number
        of wires, unless the data contradict it. Only with `branches`.

    Returns
    -------
    Model

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If a number is out of range, there are no views, the number of lengths is not that of ropes, the
        published method is given no radius, or arguments exclude each other. Also if poses look like
        millimetres: without bounds, cameras stand over 50 m and a hundred depths from the origin, and no two
        that moved see the same place.
    strand.NotEnoughDataError
        If no view has points in the extraction range, or they make no chain.
    strand.NoRopeError
        If there are neither masks nor bounds that exclude the table, and the things on the table are no
        ropes. It is a `NotEnoughDataError`.

    Examples
    --------
    >>> import strand
    >>> scene = strand.synthetic.scene("s", views=3)
    >>> model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    >>> len(model.chains)
    1
    """
    begun = time.monotonic()
    hints = _check(radius, bounds, ropes, config, length, previous)
    hints = _allow_branches(hints, branches, wire)
    run = _start(begun, progress, deadline)
    keep_stages = check_bool("keep_stages", keep_stages)
    # whatever the caller set: numbers that underflow are meant to
    with np.errstate(all="ignore"):
        extract = extract_views(views, hints.bounds)
        with explain_errors(extract, hints.radii):
            refuse_empty(extract, run)
            refuse_poses_in_other_units(extract)
            if hints.branches:
                return answer_with_harness(observe(extract, hints, run), hints, run, keep_stages)
            attempt = run.fork()
            scene, found = _find(extract, hints, attempt)
        error = find_hand_eye_error(scene.observed, found, hints.config.poses)
        if error is not None and not run.skips("the correction of a hand-eye error"):
            again = run.fork()
            views = [placed(view, view.pose @ error.motion) for view in extract.whole]
            try:
                corrected = _find(extract_views(views, hints.bounds), hints, again)
            except NotEnoughDataError:
                corrected = None
            if corrected is not None and _is_surer(corrected[1], found):
                (scene, found), attempt = corrected, again
                run.warn("pose", error.reason)
        run.warnings.extend(attempt.warnings)
        return build_model(scene, found, hints, run, keep_stages)


def _find(extract: Extract, hints: Hints, run: Run) -> tuple[Scene, Found]:
    """Observe views, and find chains in them."""
    scene = observe(extract, hints, run)
    return scene, _METHODS[hints.config.method](scene.observed, hints.config, run)


def _is_surer(some: Found, other: Found) -> bool:
    return compute_trust(some.doubts or ()) > compute_trust(other.doubts or ())


def _check(
    radius: float | Sequence[float] | None,
    bounds: Bounds | None,
    ropes: int | None,
    config: Config | None,
    length: float | Sequence[float] | None,
    previous: Model | None,
) -> Hints:
    """Check what the caller knows of the ropes."""
    config = _USUAL if config is None else config
    check_instance("config", config, Config)
    radii = None if radius is None else Radii.from_caller(radius, config.known)
    if previous is not None and not isinstance(previous, Model):
        raise TypeError(f"previous: expected a Model or None, got {type(previous).__name__}")
    if config.method == "published" and (radii is None or len(radii.values) > 1):
        raise ValueError(
            "radius: the published method needs the ropes' one radius, metres (--radius on the command line)"
        )
    box = None if bounds is None else make_box(bounds)
    prior = Prior.from_caller(ropes, length, box, config.known)
    return Hints(radii, box, prior, config, previous)


def _allow_branches(hints: Hints, branches: bool | Netlist, wire: float | None) -> Hints:
    """Add what the caller knows of ropes that branch."""
    branches, wire, net = check_branches(branches, wire, hints.config.method, hints.prior)
    return replace(hints, branches=branches, wire=wire, net=net)


def _start(begun: float, progress: Callable[[str], None] | None, deadline: float | None) -> Run:
    """Check and note what the caller wants of the run, which began at a time by `time.monotonic`."""
    if progress is not None and not callable(progress):
        raise TypeError(f"progress: expected a callable or None, got {type(progress).__name__}")
    run = Run(progress)
    if deadline is not None:
        run.deadline = begun + check_positive("deadline", deadline)
    return run
