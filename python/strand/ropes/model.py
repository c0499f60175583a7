"""The model that a reconstruction returns: chains, their uncertainty, and queries for planners."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from strand._core import NotEnoughDataError, TubeQueries
from strand.config import METHODS
from strand.export.capsules import Capsules, make_capsules
from strand.export.files import format_csv, format_mesh, format_polylines
from strand.export.mjcf import make_mjcf
from strand.export.spheres import Spheres, make_spheres
from strand.export.urdf import make_urdf
from strand.export.usd import make_usd
from strand.geometry.line import make_queries
from strand.geometry.nearest import Nearest, find_nearest
from strand.geometry.plane import Plane
from strand.ropes.chain import Chain, remarked
from strand.ropes.contacts import Contact, find_contacts
from strand.ropes.crossings import Crossing, find_crossings, find_free_stretch, list_crossings
from strand.ropes.doubt import Alternative, Doubt, Join, ModelWarning
from strand.ropes.grasps import Grasps, Gripper, find_grasps
from strand.ropes.harness import Harness, describe_harness
from strand.ropes.joints import Ends
from strand.ropes.next_view import NextView, Workspace, propose_views
from strand.ropes.notebook import make_html
from strand.ropes.pulls import PullPlan, plan_pulls
from strand.ropes.queries import RayHits, SweepHits
from strand.ropes.seen_side import USUAL_UP, check_table, check_up
from strand.ropes.summary import format_confidence, summarize
from strand.support.checks import (
    Array,
    check_choice,
    check_float_array,
    check_fraction_or_nan,
    check_instance,
    check_instances,
    check_integer,
    check_small_array,
    check_stamp,
    describe_value,
    freeze_array,
)
from strand.support.files import JSON_BYTES, check_suffix, convert_to_json, write_bytes, write_json
from strand.support.lazy import lazy_property
from strand.views.sensor import Sensor

FORMAT = "strand model"
"""The `format` of JSON files of `Model.save`."""
VERSION = 2
"""Their `version`."""
SUFFIXES = ("json", "csv", "ply", "usda")
"""Kinds of files that `Model.save` writes."""

_MAX_CHAINS_SHOWN = 3  # in the repr of a model
_MAX_DOUBTS_SHOWN = 5  # in a notebook
_GRAVITY = 9.81  # m/s^2
_MIN_DOWNWARD = 0.1  # of `up` against z: with less, z may still be up if there is no table
_BRANCHES = ("tubes", "images")  # of the default method


@dataclass(frozen=True, eq=False)
class Model:
    """The reconstructed ropes, and the uncertainty about them. Its arrays are read-only.

    Attributes
    ----------
    chains : tuple of Chain
        The ropes, longest first.
    poses : (V, 4, 4) ndarray
        Camera-to-world poses after registration, one for each given view.
    timings : dict of str to float
        Seconds of each stage, in their order.
    warnings : tuple of ModelWarning
        Remarks about the data and the answer, such as views that saw nothing.
    stages : dict of str to object
        Arrays between the stages with `reconstruct(keep_stages=True)`, else empty.
    pose_sd : (V, 6) ndarray
        Standard deviations of the poses' corrections in the world frame: rotation vector, radians, and
        translation of the points' centroid, metres. 0 for the view that stayed, NaN where unknown.
    confidence : float
        Probability that the ropes run as the chains say, from 0 to 1: as many chains as ropes, each within
        3 radii of its rope, from end to end and in order. Which strand lies on top at a crossing has a
        probability of its own. NaN if the method does not say.
    joins : tuple of Join
        Where strand joined segments over gaps and crossings, the least certain first.
    doubts : tuple of Doubt
        Reasons that lower `confidence`, the greatest first.
    alternatives : tuple of Alternative
        Other ways to join the segments that strand fitted too, the best first, for each class of radius.
    method : str or None
        The method that found the ropes, as in `Config.method`; None if unknown.
    branch : str or None
        Source of the default method's answer: `"tubes"` fitted to the points, or readings of `"images"`; None
        for another method.
    sensor : Sensor or None
        The sensor's errors as measured on the ropes: `sd`, `correlation` and `step`, of readings of images
        also `bias` and `lateral`. `Config.sensor` takes it for similar scenes. None if not measured.
    up : (3,) ndarray
        Unit vector up from the table, world frame: the default direction of crossings, contacts, grasps and
        pulls. `reconstruct` gives the normal of the table, else that of the plane of flat ropes, else
        the side that the cameras look from. z of the world frame unless given.
    table : Plane or None
        The table that the views show: its unit normal n towards the cameras, world frame, and n.x of its top,
        metres. None if they show none.
    stamp : float or None
        Time of the latest view that has one, or of the `Track`, seconds, as in `View`; None if unknown.
    harness : Harness or None
        The ropes as a graph of junctions and ends, with `reconstruct(branches=True)`. Its edges' chains are
        then `chains`, in the edges' order. None without it.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind; of methods too.
    ValueError
        If an array has a wrong shape or is not finite, or a number is out of range; of methods too.

    Examples
    --------
    >>> import numpy as np
    >>> import strand
    >>> under = np.linspace([-0.1, 0.0, 0.004], [0.1, 0.0, 0.004], 51)
    >>> over = np.linspace([0.0, -0.1, 0.012], [0.0, 0.1, 0.012], 51)
    >>> chains = (strand.Chain(under, 0.004), strand.Chain(over, 0.004))
    >>> model = strand.Model(chains, poses=np.empty((0, 4, 4)))
    >>> print(model.crossings()[0])
    chain 1 at 100 mm passes over chain 0 at 100 mm, probability 0.692
    >>> print(model.grasps(strand.Gripper(opening=0.04, width=0.01, thickness=0.008, depth=0.04))[0])
    chain 1 at 8 mm, jaws 40.0 mm open, score 0.88
    >>> print(model.pull_plan().pulls[0])
    lift the end of chain 1 at 0 mm, 218 mm along (0.34, 0.94, 0.00)
    >>> model.nearest(np.array([[0.05, 0.0, 0.1]])).distance.round(3).tolist()
    [0.096]
    """

    chains: tuple[Chain, ...]
    poses: Array
    timings: dict[str, float] = field(default_factory=dict)
    warnings: tuple[ModelWarning, ...] = ()
    stages: dict[str, Any] = field(default_factory=dict)
    pose_sd: Array = field(default_factory=lambda: np.empty((0, 6)))
    confidence: float = float("nan")
    joins: tuple[Join, ...] = ()
    doubts: tuple[Doubt, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    method: str | None = None
    branch: str | None = None
    sensor: Sensor | None = None
    up: Array = field(default_factory=lambda: USUAL_UP)
    table: Plane | None = None
    stamp: float | None = None
    harness: Harness | None = None

    def __post_init__(self) -> None:
        for name, kind in (
            ("chains", Chain),
            ("warnings", ModelWarning),
            ("joins", Join),
            ("doubts", Doubt),
            ("alternatives", Alternative),
        ):
            object.__setattr__(self, name, check_instances(name, getattr(self, name), kind))
        for name in ("timings", "stages"):
            if not isinstance(getattr(self, name), dict):
                raise TypeError(f"{name}: expected a dict, got {type(getattr(self, name)).__name__}")
        poses = check_small_array("poses", self.poses, ("V", 4, 4))
        pose_sd = check_float_array("pose_sd", self.pose_sd, ("V", 6))
        object.__setattr__(self, "poses", freeze_array(poses))
        object.__setattr__(self, "pose_sd", freeze_array(pose_sd))
        for name, accepted in (("method", METHODS), ("branch", _BRANCHES)):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, check_choice(name, getattr(self, name), accepted))
        if self.sensor is not None and not isinstance(self.sensor, Sensor):
            raise TypeError(f"sensor: expected a Sensor or None, got {type(self.sensor).__name__}")
        object.__setattr__(self, "confidence", check_fraction_or_nan("confidence", self.confidence))
        object.__setattr__(self, "up", check_up("up", self.up))
        if self.table is not None:
            object.__setattr__(self, "table", check_table("table", self.table))
        object.__setattr__(self, "stamp", check_stamp("stamp", self.stamp))
        chains = (
            chain if np.array_equal(chain.up, self.up) else remarked(chain, up=self.up)
            for chain in self.chains
        )
        object.__setattr__(self, "chains", tuple(chains))
        if self.harness is not None:
            object.__setattr__(self, "harness", _check_harness(self.harness, self.chains))

    def __repr__(self) -> str:
        sure = "unknown" if np.isnan(self.confidence) else format_confidence(self.confidence)
        lines = [
            f"Model(chains: {len(self.chains)}, views: {len(self.poses)}, method: {self.method}, "
            f"confidence: {sure}, warnings: {len(self.warnings)})"
        ]
        lines += [f"  {chain!r}" for chain in self.chains[:_MAX_CHAINS_SHOWN]]
        if len(self.chains) > _MAX_CHAINS_SHOWN:
            lines.append(f"  and {len(self.chains) - _MAX_CHAINS_SHOWN} more")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: a small plot of the chains, numbers, and the greatest doubts."""
        places = [doubt.place for doubt in self.doubts if doubt.place is not None]
        lines = repr(self).splitlines() + [f"  {doubt}" for doubt in self.doubts[:_MAX_DOUBTS_SHOWN]]
        if len(self.doubts) > _MAX_DOUBTS_SHOWN:
            lines.append(f"  and {len(self.doubts) - _MAX_DOUBTS_SHOWN} more doubts")
        return make_html(self.chains, lines, self.up, places)

    def summary(self) -> str:
        """Return the answer in words; the first line says whether to act on it.

        "Act on it" stands for a confidence of at least 0.9, "Look again before acting" for at least 0.5, else
        "Do not act on it". The next lines list the chains, their crossings and the greatest doubts; that of a
        harness counts its junctions and ends.
        """
        crossings = list_model_crossings(self)
        said = summarize(self.confidence, self.chains, crossings, self.doubts)
        if self.harness is None:
            return said
        first, *others = said.splitlines()
        return "\n".join([first, repr(self.harness), *others])

    def next_view(
        self, workspace: Workspace | None = None, min_distance: float = 0.0, count: int = 3
    ) -> tuple[NextView, ...]:
        """Propose camera poses that settle most of the doubts, the best first.

        A view settles a doubt as far as it shows the rope around the doubtful place from new directions,
        past all strands. Doubts without a place are about all ropes. Things other than ropes are unknown:
        they may block the sight. Cameras look at the middle of the ropes from above `up`'s plane, at the old
        cameras' distance, or farther where the ropes fill more of the image than in any old one. Beyond twice
        the old distance they show ropes worse, in proportion.

        Parameters
        ----------
        workspace : Box or callable, optional
            Where the camera may be. A function takes (N, 3) places, world frame, metres, and returns N bools.
        min_distance : float
            Least distance of the camera from the ropes' surface, metres: depth cameras see nothing nearer.
        count : int
            Number of poses at most. Their directions are at least 25 degrees apart.

        Returns
        -------
        tuple of NextView
            Empty if the workspace has no place above the ropes.

        Raises
        ------
        strand.NotEnoughDataError
            If the model has no chains, or no camera away from them.
        ValueError
            If an argument is out of range.
        """
        if not self.chains or not len(self.poses):
            raise NotEnoughDataError("chains, poses: expected some of both, got none")
        return propose_views(
            self.chains,
            self._queries,
            self.poses,
            self.up,
            self.doubts,
            self.joins,
            workspace,
            min_distance,
            count,
        )

    @lazy_property
    def _queries(self) -> TubeQueries:
        """The tubes of all chains in one hierarchy, built for the first query."""
        return make_queries(self.chains)

    def signed_distance(self, points: ArrayLike) -> Array:
        """Return the distance of points from the ropes' surfaces, negative inside.

        It is the least `Chain.signed_distance` over all chains: exact outside, and inside at most the way
        out.

        Parameters
        ----------
        points : (N, 3) array_like of float
            World frame, metres.

        Returns
        -------
        (N,) ndarray
            Metres; infinite without chains.
        """
        return self._queries.signed_distances(points)

    def nearest(self, points: ArrayLike) -> Nearest:
        """Return the closest places of the chains to points, see `Nearest`; `Chain.nearest` asks one chain.

        Parameters
        ----------
        points : (N, 3) array_like of float
            World frame, metres.

        Returns
        -------
        Nearest
        """
        return find_nearest(self._queries, [chain.curve for chain in self.chains], points)

    def ray_hits(self, origins: ArrayLike, directions: ArrayLike) -> RayHits:
        """Find where rays first meet a rope's surface, exact up to rounding.

        Parameters
        ----------
        origins : (N, 3) array_like of float
            World frame, metres. A ray that starts inside a tube meets it at once.
        directions : (N, 3) array_like
            Of any length but 0.

        Returns
        -------
        RayHits
        """
        return RayHits(*self._queries.ray_hits(origins, directions))

    def swept_spheres(self, starts: ArrayLike, ends: ArrayLike, radius: ArrayLike) -> SweepHits:
        """Find when moving spheres touch a rope and how near they come, exact up to rounding.

        Each sphere moves straight and evenly from its start to its end, through whatever it touches. A touch
        counts as contact.

        Parameters
        ----------
        starts, ends : (N, 3) array_like of float
            Centres, world frame, metres.
        radius : float or (N,) array_like
            Of all spheres or of each, metres, 0 or above.

        Returns
        -------
        SweepHits
        """
        return SweepHits(*self._queries.swept_spheres(starts, ends, radius))

    def swept_boxes(self, starts: ArrayLike, ends: ArrayLike, half_sizes: ArrayLike) -> SweepHits:
        """Find when moving, turning boxes touch a rope and how near they come.

        Each box moves straight from its start to its end while it turns evenly about one axis, the shorter
        way; half a turn may go either way. It goes through whatever it touches. Answers are on the safe side
        by a slack of at most 1e-6 m plus 1e-5 of the way of its corners: clearances may be that much too
        small, and contacts too early, never too late.

        Parameters
        ----------
        starts, ends : (N, 4, 4) array_like
            Box-to-world poses, metres. A box lies along the axes of its frame, around the origin.
        half_sizes : (3,) or (N, 3) array_like
            Half of the sides of all boxes or of each, metres, 0 or above.

        Returns
        -------
        SweepHits
            The clearance is minus the chain's radius where its axis passes through the box.
        """
        return SweepHits(*self._queries.swept_boxes(starts, ends, half_sizes))

    def crossings(self, direction: ArrayLike | None = None) -> tuple[Crossing, ...]:
        """Find all crossings of the ropes as seen from one side, and which strand is on top.

        A strand that meets itself within four radii of rope only bends. One that touches another in the image
        plane and goes back does not cross it. Edges of a harness do not cross where they share a node.

        Parameters
        ----------
        direction : (3,) array_like, optional
            From the ropes to the viewer, world frame, of any length but zero; `up` by default.

        Returns
        -------
        tuple of Crossing
            In order along the chains.
        """
        towards = self._choose_direction(direction)
        return find_crossings(self.chains, towards, self.doubts, self.confidence, list_ends(self))

    def contacts(self, distance: float, direction: ArrayLike | None = None) -> tuple[Contact, ...]:
        """Find where strands lie near each other without crossing.

        Each stretch along which two strands are near is one contact, unless it comes from a node that both
        share in a harness. A stretch belongs to a crossing while
        the strands are at least a third as far apart as straight ones at the same angle. Two legs of a bend
        are separate strands if the rope between them is longer than a half circle. Its diameter is the sum
        of both radii and `distance`.

        Parameters
        ----------
        distance : float
            Greatest distance of the surfaces, metres, 0 or above.
        direction : (3,) array_like, optional
            As in `crossings`.

        Returns
        -------
        tuple of Contact
            In order along the chains.
        """
        return find_contacts(self.chains, distance, self._choose_direction(direction), list_ends(self))

    def segment_between_crossings(
        self, chain: int, s: float, direction: ArrayLike | None = None
    ) -> tuple[float, float]:
        """Return the stretch of a chain around a place without crossings.

        Parameters
        ----------
        chain : int
            Number of the chain.
        s : float
            Arc length of the place on it, metres.
        direction : (3,) array_like, optional
            As in `crossings`.

        Returns
        -------
        start, stop : float
            Arc lengths of the crossings or ends before and after the place, metres. On a closed chain start
            may be negative and stop above the length; `chain.at` wraps them.
        """
        if not self.chains:
            got = describe_value(chain)
            raise ValueError(f"chain: expected the number of a chain, got {got}: the model has no chains")
        number = check_integer("chain", chain, 0, len(self.chains) - 1)
        return find_free_stretch(self.chains[number], number, s, self.crossings(direction))

    def grasps(
        self,
        gripper: Gripper,
        table: tuple[ArrayLike, float] | Literal[False] | None = None,
        direction: ArrayLike | None = None,
    ) -> Grasps:
        """Find where a gripper can hold the ropes and touches nothing else.

        Places are half a finger's width apart. At each place the gripper comes down across the rope. Its
        approach is turned about the rope by 0, 15 or 30 degrees to either side; openings and depths of the
        tips vary. No other strand, and no second leg of a bend, may lie between the jaws. Fingers and palm (a
        box as deep as the fingers) keep the gripper's clearance from all strands and the table. Ends of ropes
        are half a finger's width and two of their standard deviations away, or more.

        The score is the mean of four parts: clearance c as c / (c + half the opening); length f to the next
        crossing as f / (f + opening); 1 if the rope is on top there; and cos(turn)^4.

        Parameters
        ----------
        gripper : Gripper
        table : ((3,) array_like, float) or False, optional
            Normal n of the table, towards the gripper, and n.x of its top, metres. By default it is the
            model's `table`. Without one, or with False, tips may reach into what the ropes lie on.
        direction : (3,) array_like, optional
            From the ropes to the gripper, of any length but zero; crossings are seen from there. By default
            it is `up`.

        Returns
        -------
        Grasps
            The best grasp of each place, the best first, and the stretches without one, with the reason.
        """
        towards = self._choose_direction(direction)
        plane = self.table if table is None else None if table is False else table
        return find_grasps(self.chains, gripper, self.crossings(towards), plane, towards)

    def pull_plan(self, direction: ArrayLike | None = None) -> PullPlan:
        """Plan the moves that take the ropes apart.

        There are four moves. A stretch that lies freely on another one is lifted off. An end next to a
        crossing goes back over it, or is pulled out beneath it, or the strand above is lifted over the end.
        The first move has the least effort for each crossing that it undoes. The effort is the length of its
        way. An end that is pulled out counts twice, a strand that is lifted over an end three times. The
        length of an end without room to lie straight is added eight times.

        This takes apart loose open ropes. Rings lose loops alone, and ends at junctions stay. How much a
        tight knot resists is unknown.

        Parameters
        ----------
        direction : (3,) array_like, optional
            From the ropes to the gripper, of any length but zero; crossings are seen from there, and places
            move at right angles to it. By default it is `up`: places move along the table.

        Returns
        -------
        PullPlan
            Empty if nothing crosses. Only its first move is sure: look again after it.
        """
        towards = self._choose_direction(direction)
        return plan_pulls(self.chains, self.crossings(towards), towards, list_ends(self))

    def _choose_direction(self, direction: ArrayLike | None) -> ArrayLike:
        return self.up if direction is None else direction

    def capsules(self, error: float) -> Capsules:
        """Return the ropes as capsules for collision checks.

        Capsules have the rope's radius, and their axes start and end on the centreline. Their surface and
        that of the rope, whose ends are round, are at most `error` apart. Capsules with a radius `error`
        larger hold the whole rope.

        Parameters
        ----------
        error : float
            Metres, at least a thousandth of each radius. The number of capsules grows as one over its root.

        Returns
        -------
        Capsules
            In order along the ropes.
        """
        return make_capsules(self.chains, error)

    def spheres(self, error: float) -> Spheres:
        """Return the ropes as spheres for collision checks.

        They are accurate as in `capsules`: spheres with a radius `error` larger hold the whole rope.

        Parameters
        ----------
        error : float
            Metres, at least a hundredth of each radius. From a radius on, spheres only touch each other.

        Returns
        -------
        Spheres
            In order along the ropes.
        """
        return make_spheres(self.chains, error)

    def save(self, path: str | os.PathLike[str], *, max_bytes: int = JSON_BYTES) -> None:
        """Write the model to a file, whole or not at all; an existing file is replaced.

        The new file keeps the mode of the old one, and its owner, group and extended attributes where the
        system allows. Symbolic links are followed. A file with more than one hard link is refused.

        Parameters
        ----------
        path : str or path-like
            A `.json` holds all but `stages`, and `strand.load_model` reads it back. A `.csv` has a row for
            each node. A `.ply` has the nodes as vertices and a polyline for each rope. A `.usda` is that of
            `save_usd`. Lengths are in metres.
        max_bytes : int
            The limit that `strand.load_model` needs for a `.json` file; both have the same default.

        Raises
        ------
        ValueError
            If the name ends with none of the four.
        strand.StrandError
            If `strand.load_model` would refuse the `.json` file.
        OSError
            If the file cannot be written, has hard links or is not a regular file; of the other `save_`
            methods too.
        """
        kind, max_bytes = check_suffix(path, SUFFIXES), check_integer("max_bytes", max_bytes, 1)
        if kind == "usda":
            self.save_usd(path)
        elif kind == "json":
            write_json(path, _collect_content(self), max_bytes=max_bytes)
        else:
            write_bytes(path, format_csv(self.chains) if kind == "csv" else format_polylines(self.chains))

    def save_tube(self, path: str | os.PathLike[str], sides: int = 16) -> None:
        """Write the ropes' surfaces as one triangle mesh to a PLY file, see `Chain.tube`.

        Parameters
        ----------
        path : str or path-like
            Its name ends with `.ply`.
        sides : int
            Number of sides of each tube.
        """
        check_suffix(path, ("ply",))
        write_bytes(path, format_mesh([chain.tube(sides) for chain in self.chains]))

    def save_mjcf(
        self,
        path: str | os.PathLike[str],
        version: int = 4,
        *,
        spacing: float | None = None,
        density: float = 1000.0,
        young: float = 1e6,
        gravity: ArrayLike | None = None,
    ) -> None:
        """Write the ropes as a MuJoCo model in which they bend, fall and touch.

        Each rope starts, and rests, in its measured shape. Another model may `include` the file; the
        integrator must stay the one in the file. Edges of a harness come apart: use `Harness.save_mjcf`.

        Parameters
        ----------
        path : str or path-like
            Its name ends with `.xml`.
        version : int
            3: a `composite` cable of capsules with ball joints, `rope_0_B_first` to `rope_0_B_last`. 4: a
            `flexcomp` rod `rope_0` whose edges keep their lengths, as MuJoCo 4 has no cables.
        spacing : float, optional
            Length of the straight segments, metres: at least 2.5 radii, three radii by default.
        density : float
            kg/m^3; the mass is that of a cylinder of the rope's length and radius.
        young : float
            Young's modulus against bending, Pa; a third of it counts against twist. A rope bends more easily
            than its material: 1e6 is a soft rope.
        gravity : (3,) array_like, optional
            Acceleration of gravity, world frame, m/s^2. By default it is 9.81 m/s^2, against `up` if
            there is a table or the cameras look along z, as one without a pose does, else against z.
        """
        check_suffix(path, ("xml",))
        pull = self._choose_gravity(gravity)
        write_bytes(path, make_mjcf(self.chains, version, spacing, density, young, pull))

    def save_usd(
        self,
        path: str | os.PathLike[str],
        *,
        spacing: float | None = None,
        density: float = 1000.0,
        young: float = 1e6,
        stretch: float = 1e7,
        pinned: Sequence[tuple[int, float]] = (),
        tube: bool = False,
        gravity: ArrayLike | None = None,
    ) -> None:
        """Write the ropes as deformable curves to a USD file, for Newton and Isaac Lab.

        The file follows the draft "Deformable Body Physics" of the AOUSD. `/ropes/rope_0/curve` is a linear
        `BasisCurves` in the world frame, in metres and single precision, with its material beside it. Each
        rope starts, and rests, in its measured shape. Ropes of a harness end exactly at its nodes. There they
        are attached to each other, point to point, and segments near the node do not collide.

        Parameters
        ----------
        path : str or path-like
            Its name ends with `.usda`.
        spacing, density, gravity : optional
            As in `save_mjcf`; the file has a physics scene only if it says how gravity pulls.
        young : float
            Young's modulus against bending, Pa, as in `save_mjcf`.
        stretch : float
            Young's modulus along the rope, Pa; 0.3 of it counts against shear. Solvers that iterate need
            more steps with stiffer ropes.
        pinned : sequence of (int, float)
            Chains and arc lengths, metres, of places that do not move, such as `[(0, 0.0)]` for the first
            end. The nearest end of a segment is attached to the world.
        tube : bool
            Write each rope's surface as a mesh that follows the curve, see `Chain.tube`.
        """
        check_suffix(path, ("usda",))
        pull = self._choose_gravity(gravity)
        nodes = () if self.harness is None else [node.position for node in self.harness.nodes]
        made = make_usd(
            self.chains, spacing, density, young, stretch, pinned, tube, pull, nodes, list_ends(self)
        )
        write_bytes(path, made)

    def _choose_gravity(self, gravity: ArrayLike | None) -> Array | None:
        """Return the gravity (3,) that a file states; None if it is the usual one."""
        if gravity is not None:
            return check_small_array("gravity", gravity, (3,))
        # without a table z may still be up, and the ropes hang on a wall
        if self.up[2] < -_MIN_DOWNWARD or (self.table is not None and self.up[2] < 1.0):
            return np.asarray(-_GRAVITY * self.up)
        return None

    def save_urdf(self, path: str | os.PathLike[str], error: float = 5e-4) -> None:
        """Write the ropes as rigid obstacles to a URDF file.

        Each rope is a link such as `rope_0`, fixed to the link `world`, whose frame is the world frame.
        Shapes are cylinders and spheres, as many readers know no capsules. Links have no mass.

        Parameters
        ----------
        path : str or path-like
            Its name ends with `.urdf`.
        error : float
            As in `capsules`, metres.
        """
        check_suffix(path, ("urdf",))
        write_bytes(path, make_urdf(self.chains, error))


def list_model_crossings(model: Model, direction: ArrayLike | None = None) -> tuple[Crossing, ...] | None:
    """Return a model's crossings for files, tables and pages; None if there are too many to list."""
    towards = model.up if direction is None else direction
    return list_crossings(model.chains, towards, model.doubts, model.confidence, list_ends(model))


def list_ends(model: Model) -> Ends:
    """Return the nodes of a harness at the ends of each chain."""
    return () if model.harness is None else [(edge.start, edge.stop) for edge in model.harness.edges]


def _check_harness(harness: Harness, chains: tuple[Chain, ...]) -> Harness:
    """Return the harness with the model's chains, which must be those of its edges."""
    edges = check_instance("harness", harness, Harness).edges
    if len(edges) != len(chains):
        raise ValueError(f"harness: expected an edge for each chain ({len(chains)}), got {len(edges)}")
    for edge, chain in zip(edges, chains, strict=True):
        if edge.chain is not chain and not np.array_equal(edge.chain.points, chain.points):
            raise ValueError(f"harness: expected chains[{edge.id}] as the chain of edge {edge.id}")
    return replace(harness, edges=tuple(replace(edge, chain=chains[edge.id]) for edge in edges))


def describe_model(model: Model) -> dict[str, Any]:
    """Return the content of a model's JSON file, in JSON's types."""
    content: dict[str, Any] = convert_to_json(_collect_content(model))
    return content


def _collect_content(model: Model) -> dict[str, Any]:
    """Return the content of a model's file, without the large arrays of stages."""
    content = {entry.name: getattr(model, entry.name) for entry in fields(model) if entry.name != "stages"}
    # `up` is the model's
    content["chains"] = [
        {entry.name: getattr(chain, entry.name) for entry in fields(chain) if entry.name != "up"}
        for chain in model.chains
    ]
    if model.stamp is None:  # such files keep their bytes
        del content["stamp"]
    if model.harness is None:
        del content["harness"]
    else:
        content["harness"] = describe_harness(model.harness)
    content["table"] = None if model.table is None else model.table._asdict()
    crossings = list_model_crossings(model)
    if crossings is not None:
        content["crossings"] = crossings
    return {"format": FORMAT, "version": VERSION, "units": "metres, radians, seconds", **content}
