"""What a reconstruction returns: the chains, and what is known and unsure about them."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from strand._core import TubeQueries
from strand.config import METHODS
from strand.export.capsules import Capsules, make_capsules
from strand.export.files import check_suffix, format_csv, format_mesh, format_polylines
from strand.export.mjcf import make_mjcf
from strand.export.spheres import Spheres, make_spheres
from strand.export.urdf import make_urdf
from strand.geometry.line import make_queries
from strand.geometry.nearest import Nearest, find_nearest
from strand.ropes.chain import Chain
from strand.ropes.contacts import Contact, find_contacts
from strand.ropes.crossings import Crossing, find_crossings, find_free_stretch, list_crossings
from strand.ropes.doubt import Alternative, Doubt, Join, ModelWarning
from strand.ropes.grasps import Grasps, Gripper, find_grasps
from strand.ropes.next_view import find_best_camera
from strand.ropes.notebook import notebook_html
from strand.ropes.pulls import PullPlan, plan_pulls
from strand.ropes.queries import RayHits, SweepHits
from strand.support.checks import (
    Array,
    check_choice,
    check_float_array,
    check_fraction_or_nan,
    check_instances,
    check_integer,
    check_small_array,
    freeze_array,
)
from strand.support.files import convert_to_json, write_bytes, write_json
from strand.support.lazy import lazy_property
from strand.views.sensor import Sensor

FORMAT, VERSION = "strand model", 2
"""What the JSON files of `Model.save` say they are."""

_MAX_CHAINS_SHOWN = 3  # in the repr of a model
_MAX_DOUBTS_SHOWN = 5  # in a notebook
_BRANCHES = ("tubes", "images")  # of the default method


@dataclass(frozen=True, eq=False)
class Model:
    """A point chain model: the ropes that the views show. Its arrays are read-only.

    Attributes
    ----------
    chains : tuple of Chain
        The ropes, longest first.
    poses : (V, 4, 4) ndarray
        Camera-to-world poses after registration, one for each view that was given.
    timings : dict of str to float
        Seconds that each stage took, in the stages' order.
    warnings : tuple of ModelWarning
        What the caller should know about the data and the answer: views that saw nothing, for example.
    stages : dict of str to object
        The arrays between the stages, if they were asked for (see `strand.reconstruct`); else empty.
    pose_sd : (V, 6) ndarray
        Standard deviations of the poses' corrections in the world frame: rotation vector, radians, and
        translation of the points' centroid, metres; 0 for the view that stayed, NaN where none is known.
    confidence : float
        How likely it is that the ropes run as the chains say, from 0 to 1: in order, none missing, none
        joined to another, ends in place. NaN if the method does not say.
    joins : tuple of Join
        Where segments were joined over gaps and crossings, the least certain first.
    doubts : tuple of Doubt
        What speaks against the answer and lowers `confidence`, the greatest first.
    alternatives : tuple of Alternative
        Other ways to join the segments that were fitted too, the best first; of each class of radius, if
        there are several.
    method : str or None
        The method that found the ropes, as in `Config.method`; None if that is not known.
    branch : str or None
        What the default method's answer comes from: `"tubes"` fitted to the points, or readings of
        `"images"`; None for another method.
    sensor : Sensor or None
        The sensor's errors as measured on the ropes, whether or not they were given: `sd`, `correlation` and
        `step`, of ropes read from images also `bias` and `lateral`. `Config.sensor` takes it for other scenes
        like this one. None if the method measures none.
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
        object.__setattr__(self, "poses", freeze_array(check_small_array("poses", self.poses, ("V", 4, 4))))
        object.__setattr__(
            self, "pose_sd", freeze_array(check_float_array("pose_sd", self.pose_sd, ("V", 6)))
        )
        if self.method is not None:
            object.__setattr__(self, "method", check_choice("method", self.method, METHODS))
        if self.branch is not None:
            object.__setattr__(self, "branch", check_choice("branch", self.branch, _BRANCHES))
        if self.sensor is not None and not isinstance(self.sensor, Sensor):
            raise TypeError(f"sensor: expected a Sensor or None, got {type(self.sensor).__name__}")
        object.__setattr__(self, "confidence", check_fraction_or_nan("confidence", self.confidence))

    def __repr__(self) -> str:
        sure = "unknown" if np.isnan(self.confidence) else f"{self.confidence:.2f}"
        lines = [
            f"Model(chains: {len(self.chains)}, views: {len(self.poses)}, method: {self.method}, "
            f"confidence: {sure}, warnings: {len(self.warnings)})"
        ]
        lines += [f"  {chain!r}" for chain in self.chains[:_MAX_CHAINS_SHOWN]]
        if len(self.chains) > _MAX_CHAINS_SHOWN:
            lines.append(f"  and {len(self.chains) - _MAX_CHAINS_SHOWN} more")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the chains in a small plot, numbers, and the greatest doubts."""
        places = [doubt.place for doubt in self.doubts if doubt.place is not None]
        lines = repr(self).splitlines() + [f"  {doubt}" for doubt in self.doubts[:_MAX_DOUBTS_SHOWN]]
        if len(self.doubts) > _MAX_DOUBTS_SHOWN:
            lines.append(f"  and {len(self.doubts) - _MAX_DOUBTS_SHOWN} more doubts")
        return notebook_html(self.chains, lines, places)

    def next_view(self) -> Array:
        """Camera position from which one more view would tell most: it best sees the least certain place.

        That is the place of the greatest doubt; without any that has one, of the join with the least margin;
        without joins, the place that fewest points support.

        Returns
        -------
        (3,) ndarray
            World frame, metres; as far from the place as the cameras were, in the median.

        Raises
        ------
        ValueError
            If there is no chain, or no pose whose camera is away from the place.
        """
        if not self.chains or not len(self.poses):
            raise ValueError("model: expected chains and poses, got none")
        places = [doubt.place for doubt in self.doubts if doubt.place is not None]
        places += [join.place for join in self.joins]
        if places:
            place = places[0]
        else:
            weakest = [
                (int(chain.points_seen.min()), k)
                for k, chain in enumerate(self.chains)
                if chain.points_seen is not None
            ]
            chain = self.chains[min(weakest)[1]] if weakest else self.chains[0]
            seen = chain.points_seen
            place = chain.points[len(chain.points) // 2 if seen is None else int(seen.argmin())]
        radius = self.chains[0].radius
        return find_best_camera(place, [chain.points for chain in self.chains], self.poses[:, :3, 3], radius)

    @lazy_property
    def _tubes(self) -> TubeQueries:
        """All chains' tubes in one hierarchy, built when it is first asked."""
        return make_queries(self.chains)

    def signed_distance(self, points: ArrayLike) -> Array:
        """Distance of points from the ropes' surfaces, negative inside.

        The least over all chains of `Chain.signed_distance`: exact outside, and at most the way out inside,
        where ropes touch each other.

        Parameters
        ----------
        points : (N, 3) array_like of float
            World frame, metres.

        Returns
        -------
        (N,) ndarray
            Metres; infinite if there is no chain.

        Raises
        ------
        TypeError
            If `points` does not hold floating point numbers.
        ValueError
            If its shape is wrong, or a coordinate is not finite.
        """
        return self._tubes.signed_distances(points)

    def nearest(self, points: ArrayLike) -> Nearest:
        """Return the closest places of the chains to points: of the chain whose surface is nearest.

        The places are those of `Chain.at`, as in `Chain.nearest`.

        Parameters
        ----------
        points : (N, 3) array_like of float
            World frame, metres.

        Returns
        -------
        Nearest

        Raises
        ------
        TypeError
            If `points` does not hold floating point numbers.
        ValueError
            If its shape is wrong, or a coordinate is not finite.
        """
        return find_nearest(self._tubes, [chain.curve for chain in self.chains], points)

    def ray_hits(self, origins: ArrayLike, directions: ArrayLike) -> RayHits:
        """Where rays first meet a rope's surface; exact, up to rounding.

        A ray that starts in a tube meets it at once; its normal is then that of the place of the axis in
        whose tube it is deepest.

        Parameters
        ----------
        origins : (N, 3) array_like of float
            World frame, metres.
        directions : (N, 3) array_like
            Of any length but 0.

        Returns
        -------
        RayHits

        Raises
        ------
        TypeError
            If an array does not hold numbers of its kind.
        ValueError
            If shapes are wrong or differ, a number is not finite, or a direction is zero.
        """
        return RayHits(*self._tubes.ray_hits(origins, directions))

    def swept_spheres(self, starts: ArrayLike, ends: ArrayLike, radius: ArrayLike) -> SweepHits:
        """When spheres that move touch a rope, and how near they come; exact, up to rounding.

        Each moves straight and evenly from its start to its end, and goes through what it touches. A touch
        counts as contact. One that stays in place has its contact at 0.

        Parameters
        ----------
        starts, ends : (N, 3) array_like of float
            The centres, world frame, metres.
        radius : float or (N,) array_like
            Of all spheres or each, metres, not negative.

        Returns
        -------
        SweepHits

        Raises
        ------
        TypeError
            If an array does not hold numbers of its kind.
        ValueError
            If shapes are wrong or differ, a number is not finite, or a radius is negative.
        """
        return SweepHits(*self._tubes.swept_spheres(starts, ends, radius))

    def swept_boxes(self, starts: ArrayLike, ends: ArrayLike, half_sizes: ArrayLike) -> SweepHits:
        """When boxes that move and turn touch a rope, and how near they come.

        Each box' centre moves straight and evenly from its start to its end, while the box turns evenly
        about one axis, the shorter way round. (Where it turns by half a circle, both ways are as short, and
        it is not said which it goes.) It goes through what it touches.

        Answers are on the safe side, by a slack of at most 1e-6 m and 1e-5 of the way that its corners turn:
        the clearance is at most that much too small, and contact is where the surfaces are nearer than that.
        So a contact may be said to be too early, and never too late.

        Parameters
        ----------
        starts, ends : (N, 4, 4) array_like
            Box-to-world poses; the box is around the origin of its frame, along its axes. Metres.
        half_sizes : (3,) or (N, 3) array_like
            Half of the sides of all boxes or each, metres, not negative.

        Returns
        -------
        SweepHits
            The clearance is no less than minus the chain's radius: its axis is in the box then.

        Raises
        ------
        TypeError
            If an array does not hold numbers.
        ValueError
            If shapes are wrong or differ, a number is not finite, a pose is no rigid motion, or a half size
            is negative.
        """
        return SweepHits(*self._tubes.swept_boxes(starts, ends, half_sizes))

    def crossings(self, direction: ArrayLike = (0, 0, 1)) -> tuple[Crossing, ...]:
        """Find where the ropes cross each other, and themselves, as seen from one side, and which is on top.

        All crossings of the chains in the plan across the direction are found. A strand that crosses itself
        within four radii only bends. One that touches another in the plan, and goes back, does not cross it.

        Parameters
        ----------
        direction : (3,) array_like
            Towards who looks, world frame, of any length but zero: up, if not given.

        Returns
        -------
        tuple of Crossing
            Along the chains: by the first of the two places that each joins.

        Raises
        ------
        TypeError
            If `direction` does not hold real numbers.
        ValueError
            If it is not of shape (3,), not finite, or zero.
        """
        return find_crossings(self.chains, direction, self.doubts)

    def contacts(self, distance: float, direction: ArrayLike = (0, 0, 1)) -> tuple[Contact, ...]:
        """Find where strands lie near each other and do not cross.

        Each stretch along which two strands are near is one contact. A crossing reaches as far as the strands
        come apart by a third, or more, of what straight ones of its angle do; where they stay nearer than
        that, they lie side by side. What a smaller distance finds between two chains, a larger one finds
        too. Legs of a bend are strands of their own where the rope between them is longer than a half circle
        from one to the other, drawn as far apart as `distance` lets their axes be.

        Parameters
        ----------
        distance : float
            The surfaces are nearer to each other than this, metres, 0 or above.
        direction : (3,) array_like
            From which side crossings are seen, as in `crossings`.

        Returns
        -------
        tuple of Contact
            Along the chains.

        Raises
        ------
        TypeError
            If an argument does not hold real numbers.
        ValueError
            If `distance` is negative or not finite, or `direction` is as `crossings` refuses it.
        """
        return find_contacts(self.chains, distance, direction)

    def segment_between_crossings(
        self, chain: int, s: float, direction: ArrayLike = (0, 0, 1)
    ) -> tuple[float, float]:
        """Return the stretch of a chain around a place in which nothing crosses it.

        Parameters
        ----------
        chain : int
            Its number.
        s : float
            Arc length of the place, metres, on the chain.
        direction : (3,) array_like
            From which side crossings are seen, as in `crossings`.

        Returns
        -------
        start, stop : float
            Arc lengths of the crossings, or ends, before and after the place, metres, start <= s <= stop.
            Around a closed chain with crossings start may be below 0, or stop above its length; `chain.at`
            goes round. Without any it is all of the chain.

        Raises
        ------
        TypeError
            If an argument is of the wrong kind.
        ValueError
            If there is no such chain, `s` is not on it, or `direction` is as `crossings` refuses it.
        """
        if not self.chains:
            raise ValueError(f"chain: expected the number of a chain, got {chain!r}: the model has no chains")
        number_ = check_integer("chain", chain, 0, len(self.chains) - 1)
        return find_free_stretch(self.chains[number_], number_, s, self.crossings(direction))

    def grasps(
        self,
        gripper: Gripper,
        table: tuple[ArrayLike, float] | None = None,
        direction: ArrayLike = (0, 0, 1),
    ) -> Grasps:
        """Find where a gripper can take hold of the ropes and touches nothing else.

        Places are half a finger's width apart. At each the gripper comes down across the rope, with the
        approach turned about the rope by 0, 15 and 30 degrees to both sides, the jaws opened by different
        amounts and tips at different depths. Between the jaws may be no other strand, and no second leg of a
        bend; fingers and palm, a box as deep as the fingers, keep the gripper's clearance from all strands
        and from the table.
        The best grasp at each place has the greatest score, the mean of four parts: clearance c as c / (c +
        half the opening); length f to the nearest crossing as f / (f + opening); 1 if the rope is on top
        there; and the fourth power of the cosine of the turn.

        Parameters
        ----------
        gripper : Gripper
        table : ((3,) array_like, float), optional
            The table's normal n, towards the gripper, and n.x of its top, metres, as in
            `FoundRopes.tables`. Without it nothing is known of a table.
        direction : (3,) array_like
            From the ropes to where the gripper comes from, of any length but zero; crossings are seen from
            there.

        Returns
        -------
        Grasps
            The best first, and the stretches where there is none, each with the reason. Without any grasp it
            is empty.

        Raises
        ------
        TypeError
            If an argument is of the wrong kind.
        ValueError
            If the normal or the direction is zero or not finite.
        """
        return find_grasps(self.chains, gripper, self.crossings(direction), table, direction)

    def pull_plan(self, direction: ArrayLike = (0, 0, 1)) -> PullPlan:
        """Plan how the ropes come apart, move by move.

        A stretch that lies on another one, without anything between, is lifted off it. An end next to a
        crossing goes back over it, or is pulled out beneath it, or the strand above it is lifted off over it.
        Of all moves that are possible the one with the least effort for each crossing that it undoes comes
        first: the length of the way, twice for an end that is pulled out, three times for a strand that is
        lifted over an end, and eight times the length of an end that there is no room to lay out straight.
        This takes apart open ropes that are loose: unknots, slip loops and knots. Rings have no ends, so only
        loops are lifted off them. Nothing is said of how much a tight knot resists.

        Parameters
        ----------
        direction : (3,) array_like
            From the ropes to where the gripper comes from, of any length but zero; crossings are seen from
            there.

        Returns
        -------
        PullPlan
            Without pulls if nothing crosses. Only the first one is sure: look again when it is done.

        Raises
        ------
        TypeError
            If `direction` does not hold real numbers.
        ValueError
            If it is not of shape (3,), not finite, or zero.
        """
        return plan_pulls(self.chains, self.crossings(direction), direction)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model to a file, whole or not at all.

        Parameters
        ----------
        path : str or path-like
            The file; one that exists is replaced. A `.json` holds all but the arrays between the stages, and
            `strand.load_model` reads it back. A `.csv` has a row for each node; a `.ply` has the nodes as
            vertices and a polyline for each rope. Lengths are metres.

        Raises
        ------
        ValueError
            If its name ends with none of the three.
        OSError
            If the file cannot be written.
        """
        kind = check_suffix(path)
        if kind != "json":
            write_bytes(path, format_csv(self.chains) if kind == "csv" else format_polylines(self.chains))
            return
        write_json(path, describe_model(self))

    def save_tube(self, path: str | os.PathLike[str], sides: int = 16) -> None:
        """Write the ropes' surfaces as one triangle mesh to a PLY file, whole or not at all.

        Parameters
        ----------
        path : str or path-like
            The file, whose name ends with `.ply`; one that exists is replaced.
        sides : int
            How many sides each tube has, see `Chain.tube`.

        Raises
        ------
        TypeError
            If `sides` is not a whole number.
        ValueError
            If the name ends otherwise, or `sides` is out of range.
        OSError
            If the file cannot be written.
        """
        check_suffix(path, ("ply",))
        write_bytes(path, format_mesh([chain.tube(sides) for chain in self.chains]))

    def capsules(self, error: float) -> Capsules:
        """Return the ropes as capsules for collision checks.

        A rope's tube is all that lies within its radius of its centreline: its ends are round. Capsules have
        the rope's radius, and their axes end on the centreline. A point of their surface is no more than
        `error` nearer to or farther from the centreline than the radius, and a point of the tube's surface so
        from the axes. Capsules with a radius `error` larger hold the whole rope.

        Parameters
        ----------
        error : float
            Metres. The smaller it is, the more capsules there are, about as one over its root.

        Returns
        -------
        Capsules
            Along the ropes, rope by rope.

        Raises
        ------
        TypeError
            If `error` is not a number.
        ValueError
            If it is not positive and finite, or less than a thousandth of a radius.
        """
        return make_capsules(self.chains, error)

    def spheres(self, error: float) -> Spheres:
        """Return the ropes as spheres for collision checks, of the ropes' radius.

        A point of their surface is no more than `error` nearer to or farther from the centreline than the
        radius. Spheres with a radius `error` larger hold the whole rope; its ends are round as in `capsules`.

        Parameters
        ----------
        error : float
            Metres. From a radius on, spheres only touch each other.

        Returns
        -------
        Spheres
            Along the ropes, rope by rope.

        Raises
        ------
        TypeError
            If `error` is not a number.
        ValueError
            If it is not positive and finite, or less than a hundredth of a radius.
        """
        return make_spheres(self.chains, error)

    def save_mjcf(
        self,
        path: str | os.PathLike[str],
        version: int = 4,
        *,
        spacing: float | None = None,
        density: float = 1000.0,
        young: float = 1e6,
    ) -> None:
        """Write the ropes as a model of MuJoCo, whole or not at all: they bend, fall and touch.

        Each lies where it was seen, and rests in that shape. The file is a model, and can be an `include` of
        another one. There the integrator must stay what the file says.

        Parameters
        ----------
        path : str or path-like
            The file, whose name ends with `.xml`; one that exists is replaced.
        version : int
            3: a `composite` cable of capsules with ball joints, `rope_0_B_first` to `rope_0_B_last`, for
            MuJoCo 3. 4: a `flexcomp` rod `rope_0` whose edges keep their lengths, for MuJoCo 4, which has
            no cables.
        spacing : float, optional
            How long segments are along the rope, metres, at least 2.5 radii; three radii if not given.
            Segments are straight between places of the centreline.
        density : float
            kg/m^3. A rope's mass is that of its length and radius.
        young : float
            Young's modulus against bending, Pa; against twist a third of it counts. A rope of strands bends
            far more easily than its material: 1e6 is a soft rope.

        Raises
        ------
        TypeError
            If a number is of the wrong kind.
        ValueError
            If the name ends otherwise, a number is not positive, `version` is neither 3 nor 4, or `spacing`
            is too small.
        OSError
            If the file cannot be written.
        """
        check_suffix(path, ("xml",))
        write_bytes(path, make_mjcf(self.chains, version, spacing, density, young))

    def save_urdf(self, path: str | os.PathLike[str], error: float = 5e-4) -> None:
        """Write the ropes as a URDF, whole or not at all: rigid, for what must not be touched.

        Each rope is a link `rope_0`, fixed to the link `world`, whose frame is the world frame. Its shapes
        are cylinders and spheres, as many readers know no capsules. Links have no mass: they do not move.

        Parameters
        ----------
        path : str or path-like
            The file, whose name ends with `.urdf`; one that exists is replaced.
        error : float
            As in `capsules`, metres.

        Raises
        ------
        TypeError
            If `error` is not a number.
        ValueError
            If the name ends otherwise, or `error` is not positive or too small.
        OSError
            If the file cannot be written.
        """
        check_suffix(path, ("urdf",))
        write_bytes(path, make_urdf(self.chains, error))


def describe_model(model: Model) -> dict[str, Any]:
    """Return what a model's file says, in JSON's types."""
    # the arrays between the stages are large and stay out
    said = convert_to_json(replace(model, stages={}))
    del said["stages"]
    crossings = convert_to_json(list_crossings(model.chains, (0, 0, 1), model.doubts))
    return {
        "format": FORMAT,
        "version": VERSION,
        "units": "metres, radians, seconds",
        **said,
        "crossings": crossings,
    }
