"""The numbers of both methods. Most lengths are in rope radii, so that they fit ropes of any thickness.

Sections and equations are those of *Shape Modeling of A String And Recognition Using Distance Sensor*.
"""

from __future__ import annotations

import dataclasses
import math
import os
import sys
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from strand.support.checks import check_choice, check_instance, describe_value, refuse_masks_and_units
from strand.support.files import FileFormatError, read_toml
from strand.views.sensor import Sensor, find_preset

METHODS = ("default", "published")
"""Values of `Config.method`."""

RINGS = ("maybe", "never", "always")
"""Values of `Linking.rings`."""


class _Section:
    """A section of numbers. Each is positive and finite, whole numbers may be 0; NumPy's become Python's."""

    def __post_init__(self) -> None:
        where = type(self).__name__
        for entry in dataclasses.fields(self):  # type: ignore[arg-type]
            value = getattr(self, entry.name)
            if (value is None and entry.default is None) or entry.type == "str":
                continue
            refuse_masks_and_units(f"{where}.{entry.name}", value)
            if isinstance(value, (np.integer, np.floating)) or (
                isinstance(value, np.ndarray) and value.ndim == 0
            ):
                value = value.item()
                object.__setattr__(self, entry.name, value)
            whole = entry.type == "int"
            if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)):
                kind = "a whole number" if whole else "a number"
                raise TypeError(f"{where}.{entry.name}: expected {kind}, got {describe_value(value)}")
            if not abs(value) <= sys.float_info.max or value < 0 or (value == 0 and not whole):
                bound = "at least 0" if whole else "above 0"
                raise ValueError(
                    f"{where}.{entry.name}: expected a number {bound}, got {describe_value(value)}"
                )


@dataclass(frozen=True)
class Filter(_Section):
    """Both methods drop points with few neighbours as outliers (section IV-A of the paper).

    Parameters
    ----------
    radius : float
        Neighbours are points within this distance, in rope radii.
    min_fraction : float
        A point needs this share of its view's median number of neighbours. Raise it if outliers remain,
        lower it if thin parts of ropes vanish.
    min_neighbors : int
        A point needs at least this number of neighbours in any view.
    widen_below : float
        The default method widens the search until the median number of neighbours reaches this. Coarse
        cameras need it; the published method does not do it.
    """

    radius: float = 1.0
    min_fraction: float = 0.25
    min_neighbors: int = 4
    widen_below: float = 10.0


@dataclass(frozen=True)
class Known(_Section):
    """Uncertainty of the given radius and lengths; the published method takes the radius as it is.

    Parameters
    ----------
    radius_sd : float
        Standard deviation of a given radius, as a share of it. Raise it for a radius that was not measured
        with a calliper.
    length_share : float
        A rope may miss its given length by this share of it, and by `length_radii`, before strand doubts the
        answer. Raise it for lengths read off a reel.
    length_radii : float
        A rope may miss its given length by this much more, in rope radii.
    """

    radius_sd: float = 0.003
    length_share: float = 0.02
    length_radii: float = 1.0


@dataclass(frozen=True)
class Poses(_Section):
    """Uncertainty of the reported poses: the default method corrects them within these limits.

    Parameters
    ----------
    rotation_sd : float
        Standard deviation of each component of the rotation vector, radians. Set it to what your calibration
        reports.
    translation_sd : float
        Standard deviation of each component of the translation, metres. Set it to what your calibration
        reports.
    """

    rotation_sd: float = math.radians(0.5)
    translation_sd: float = 1.5e-3


@dataclass(frozen=True)
class Tubes(_Section):
    """The default method traces tubes through the points and fits them together with the poses.

    Parameters
    ----------
    spacing : float
        Length of a spline's spans, in rope radii; at least 0.5. Lower it for ropes with very tight bends.
    rounds : int
        Largest number of rounds of tracing and fitting before the joins; at least 1. Raise it if the reported
        poses are far off.
    min_arc : float
        Traced pieces shorter than this are dropped, in rope radii. Raise it if noise is traced.
    node_spacing : float
        Distance between a chain's nodes, in rope radii; at least 0.01.
    min_bend : float
        The tightest radius of curvature that a rope's axis can have, in rope radii; at least 1. Raise it for
        stiff cables.
    noise : float, optional
        Standard deviation of the depth noise along the viewing rays, metres; measured in the data if not
        given. Set it if you know your camera's noise.
    """

    spacing: float = 2.5
    rounds: int = 2
    min_arc: float = 1.0
    node_spacing: float = 0.25
    min_bend: float = 1.5
    noise: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, least in (("rounds", 1), ("spacing", 0.5), ("node_spacing", 0.01), ("min_bend", 1.0)):
            value = getattr(self, name)
            if value < least:
                raise ValueError(f"Tubes.{name}: expected at least {least}, got {value}")


@dataclass(frozen=True)
class Linking(_Section):
    """The default method joins traced pieces to ropes by the matching of their ends that costs least.

    Parameters
    ----------
    free_end : float
        Cost of an end that is joined to none. Raise it to join more, lower it to join less.
    seen_through : float
        Cost of each rope radius of a join that lies where a camera saw free space.
    gap : float
        The longest gap that is bridged, in rope radii. Gaps that no camera could see may be longer, and so
        may all gaps if the number of ropes is given.
    margin : float
        A join is warned about if the next best way costs less than this more. Raise it to hear of more joins.
    loop : float
        The two ends of a piece are joined to a ring only if it is longer than this, in rope radii.
    contact : float
        An end nearer than this to the inside of another piece cuts that piece, in rope radii. Two strands
        that touch are 2 apart.
    contact_gap : float
        A cut removes this length on each side, in rope radii of arc length.
    min_length : float
        Ropes shorter than this are dropped, in rope radii. Lower it for short ropes, raise it if scraps look
        like ropes.
    rings : {"maybe", "never", "always"}
        `"maybe"` lets the data decide, `"never"` gives every rope two ends, `"always"` closes every rope.
        To close a rope, strand bridges gaps of any length, but not through free space.
    """

    free_end: float = 5.0
    seen_through: float = 2.0
    gap: float = 12.0
    margin: float = 1.5
    loop: float = 10.0
    contact: float = 1.6
    contact_gap: float = 1.5
    min_length: float = 6.0
    rings: str = "maybe"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice("Linking.rings", self.rings, RINGS)


@dataclass(frozen=True)
class Normals(_Section):
    """The published method fits a plane to each point's neighbourhood (section IV-B, eq. 10-14).

    Parameters
    ----------
    radius : float
        Radius of the neighbourhood, in rope radii.
    """

    radius: float = 1.0


@dataclass(frozen=True)
class Registration(_Section):
    """The published method registers views by ICP (section IV-C, eq. 15).

    Parameters
    ----------
    max_correspondence_distance : float
        Points farther from each other than this are no correspondence, in rope radii. Raise it if the
        reported poses are far off; views slide along straight ropes then.
    max_iterations : int
        Largest number of updates of a view's pose.
    tolerance : float
        ICP stops at a smaller change of the fitness, and of the inlier RMSE over the correspondence
        distance.
    """

    max_correspondence_distance: float = 0.5
    max_iterations: int = 30
    tolerance: float = 1e-6


@dataclass(frozen=True)
class Centerline(_Section):
    """The published method averages axis points within two rope radii (section IV-D, eq. 16-18).

    Parameters
    ----------
    min_neighbors : int
        N_lim: a surface point needs this number of points within two rope radii, itself included. Lower it
        for coarse cameras.
    """

    min_neighbors: int = 20


@dataclass(frozen=True)
class Tracing(_Section):
    """The published method traces chains through axis points (section V-A, fig. 9-10).

    Parameters
    ----------
    near : float
        r_n: the least distance between nodes, in rope radii.
    far : float
        r_f: the greatest distance to the next node, in rope radii; above `near`. Raise it if chains break.
    min_length : float
        Chains shorter than this are dropped, in rope radii.

    Raises
    ------
    ValueError
        If `far` is not above `near`.
    """

    near: float = 1.0
    far: float = 2.5
    min_length: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.far <= self.near:
            raise ValueError(f"Tracing.far: expected more than near = {self.near}, got {self.far}")


@dataclass(frozen=True)
class Splitting(_Section):
    """The published method cuts chains at minima of d*, a node's distance from the rest of the rope.

    Section V-B, eq. 19-20, fig. 11-12.

    Parameters
    ----------
    neighborhood : float
        Nodes nearer than this along their chain do not count for d*, in rope radii of arc length; above
        `threshold`.
    threshold : float
        A minimum above this is no crossing, in rope radii. Strands that touch are 2 apart.
    prominence : float
        d* must rise by this on both sides of a minimum, in rope radii. Raise it if noise is cut at.
    closure : float
        A chain is closed if its ends are nearer to each other than this, in rope radii.

    Raises
    ------
    ValueError
        If `neighborhood` is not above `threshold`: every node would seem to cross.
    """

    neighborhood: float = 6.0
    threshold: float = 3.2
    prominence: float = 0.75
    closure: float = 2.5

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.neighborhood <= self.threshold:
            raise ValueError(
                f"Splitting.neighborhood: expected more than threshold = {self.threshold}, "
                f"got {self.neighborhood}"
            )


@dataclass(frozen=True)
class Reconnection(_Section):
    """The published method groups four ends to a crossing and pairs them by direction (section V-B, fig. 13).

    Parameters
    ----------
    reach : float
        Ends farther from each other than this do not meet at a crossing, in rope radii.
    loop : float
        Both ends of a segment meet at a crossing only if it is longer than this, in rope radii.
    skip : float
        Nodes nearer than this to an end do not count for its direction, in rope radii of arc length. Eq.
        17-18 mixes strands there.
    span : float
        The direction of an end is taken over this stretch, in rope radii of arc length.
    min_agreement : float
        Least cosine between the directions of two ends that are joined, unless four ends meet.
    trim : float
        Ends that meet others lose this stretch before a cubic bridges the gap, in rope radii of arc length.
    gap : float
        The longest gap that is bridged away from crossings, in rope radii. It counts only if the number of
        ropes is given.
    """

    reach: float = 5.0
    loop: float = 10.0
    skip: float = 1.5
    span: float = 3.0
    min_agreement: float = 0.25
    trim: float = 2.0
    gap: float = 12.0


@dataclass(frozen=True)
class Config:
    """All numbers of a reconstruction, one section for each stage.

    Parameters
    ----------
    method : {"default", "published"}
        The method that finds the ropes: strand's own, or the published one.
    sensor : Sensor or str, optional
        The camera's errors in the default method: a `strand.Sensor`, or a camera's name from
        `strand.views.sensor.PRESETS`. If not given, strand measures them in the data. Set either this or
        `Tubes.noise`.
    filter : Filter
        Both methods: the outlier filter.
    known : Known
        How exact the given radius (default method) and lengths (both methods) are.
    poses : Poses
        The default method: how exact the reported poses are.
    tubes : Tubes
        The default method: how tubes are traced and fitted.
    linking : Linking
        The default method: how traced pieces are joined.
    normals : Normals
        The published method: section IV-B.
    registration : Registration
        The published method: section IV-C.
    centerline : Centerline
        The published method: section IV-D.
    tracing : Tracing
        The published method: section V-A.
    splitting : Splitting
        The published method: the cuts of section V-B.
    reconnection : Reconnection
        The published method: the joins of section V-B.

    Examples
    --------
    >>> from strand.config import Config, Linking
    >>> Config(linking=Linking(rings="never")).linking.rings
    'never'
    """

    method: str = "default"
    sensor: Sensor | str | None = None
    filter: Filter = field(default_factory=Filter)
    known: Known = field(default_factory=Known)
    poses: Poses = field(default_factory=Poses)
    tubes: Tubes = field(default_factory=Tubes)
    linking: Linking = field(default_factory=Linking)
    normals: Normals = field(default_factory=Normals)
    registration: Registration = field(default_factory=Registration)
    centerline: Centerline = field(default_factory=Centerline)
    tracing: Tracing = field(default_factory=Tracing)
    splitting: Splitting = field(default_factory=Splitting)
    reconnection: Reconnection = field(default_factory=Reconnection)

    def __post_init__(self) -> None:
        check_choice("Config.method", self.method, METHODS)
        if self.sensor is not None and not isinstance(self.sensor, Sensor):
            object.__setattr__(self, "sensor", find_preset(self.sensor))
        for name, section in _SECTIONS.items():
            check_instance(f"Config.{name}", getattr(self, name), section)
        if self.sensor is not None and self.tubes.noise is not None:
            raise ValueError("Config.sensor: expected a sensor without Tubes.noise, got both")

    @classmethod
    def published(cls) -> Config:
        """Return `Config(method="published")`.

        Returns
        -------
        Config
        """
        return cls(method="published")


_SECTIONS: dict[str, type[Any]] = {
    entry.name: type(entry.default_factory())
    for entry in dataclasses.fields(Config)
    if entry.default_factory is not dataclasses.MISSING
}


def load(path: str | os.PathLike[str]) -> Config:
    """Read a configuration from a TOML file with a table for each section.

    Sections and fields that the file does not name keep their defaults.

    Parameters
    ----------
    path : str or path-like
        The file, for example ``[tracing]`` followed by ``near = 0.8``. A camera's name may replace the
        sensor's section: ``sensor = "d435"``.

    Returns
    -------
    Config

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    strand.FileFormatError
        If it is not TOML, names an unknown section or field, or holds a value that is not accepted.
    """
    sections: dict[str, Any] = {}
    known_sections: dict[str, type[Any]] = {"sensor": Sensor, **_SECTIONS}
    for name, values in read_toml(path).items():
        if name == "method" or (name == "sensor" and not isinstance(values, dict)):
            sections[name] = values
            continue
        if name not in known_sections:
            raise FileFormatError(path, f"unknown section [{name}]; known are {', '.join(known_sections)}")
        section = known_sections[name]
        known = [entry.name for entry in dataclasses.fields(section)]
        if not isinstance(values, dict):
            raise FileFormatError(path, f"{name} is not a section; write [{name}]")
        for key in values:
            if key not in known:
                raise FileFormatError(path, f"[{name}] has no {key}; known are {', '.join(known)}")
        try:
            sections[name] = section(**values)
        except (TypeError, ValueError) as error:
            raise FileFormatError.from_error(path, error) from error
    try:
        return Config(**sections)
    except (TypeError, ValueError) as error:
        raise FileFormatError.from_error(path, error) from error
