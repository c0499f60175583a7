"""The numbers of both methods, in rope radii where that makes them carry over to other ropes.

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

from strand.support.checks import check_choice
from strand.support.files import FileFormatError, read_toml
from strand.views.sensor import Sensor, preset


def _check(section: object) -> None:
    """Refuse fields of the wrong type, not finite, or negative; only floats may be fractions.

    NumPy's numbers become Python's.

    Raises
    ------
    TypeError
        If a value is not a number of its field's kind.
    ValueError
        If a value is not finite or not above 0 (whole numbers: below 0).
    """
    where = type(section).__name__
    for entry in dataclasses.fields(section):  # type: ignore[arg-type]
        value = getattr(section, entry.name)
        if (value is None and entry.default is None) or entry.type == "str":
            continue
        if isinstance(value, (np.integer, np.floating)) or (
            isinstance(value, np.ndarray) and value.ndim == 0
        ):
            value = value.item()
            object.__setattr__(section, entry.name, value)
        whole = entry.type == "int"
        if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)):
            kind = "a whole number" if whole else "a number"
            raise TypeError(f"{where}.{entry.name}: expected {kind}, got {value!r}")
        if not abs(value) <= sys.float_info.max or value < 0 or (value == 0 and not whole):
            bound = "at least 0" if whole else "above 0"
            raise ValueError(f"{where}.{entry.name}: expected a number {bound}, got {value!r}")


@dataclass(frozen=True)
class Filter:
    """The outlier filter of both methods (section IV-A of the paper).

    Parameters
    ----------
    radius : float
        The searching radius, in rope radii.
    min_fraction : float
        Points with fewer neighbours than this share of their view's median are dropped: density, and with
        it the paper's count, varies from camera to camera.
    min_neighbors : int
        The count below which a point is dropped in any case.
    widen_below : float
        Where the median count is below this, the default method widens the searching radius until the median
        should reach it: a coarse camera gives few neighbours, and edges would be dropped with outliers. The
        published method keeps its searching radius.
    """

    radius: float = 1.0
    min_fraction: float = 0.25
    min_neighbors: int = 4
    widen_below: float = 10.0

    def __post_init__(self) -> None:
        _check(self)


@dataclass(frozen=True)
class Normals:
    """Plane normals of the published method (section IV-B, eq. 10-14).

    Parameters
    ----------
    radius : float
        The neighbourhood that a plane is fitted to, in rope radii.
    """

    radius: float = 1.0

    def __post_init__(self) -> None:
        _check(self)


@dataclass(frozen=True)
class Registration:
    """ICP of the views in the published method (section IV-C, eq. 15).

    Parameters
    ----------
    max_correspondence_distance : float
        Pairs farther apart do not count, in rope radii. Short, so that a view stays near the pose that
        the stage reports where the data let it slide.
    max_iterations : int
        Most updates of a view's pose.
    tolerance : float
        Change of fitness, and of inlier RMSE over the correspondence distance, that ends the iterations.
    """

    max_correspondence_distance: float = 0.5
    max_iterations: int = 30
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        _check(self)


@dataclass(frozen=True)
class Centerline:
    """Axis points of the published method (section IV-D, eq. 16-18); it averages within two rope radii.

    Parameters
    ----------
    min_neighbors : int
        N_lim: how many points must lie within two rope radii of a surface point, itself included.
    """

    min_neighbors: int = 20

    def __post_init__(self) -> None:
        _check(self)


@dataclass(frozen=True)
class Tracing:
    """Chains through the axis points of the published method (section V-A, fig. 9-10).

    Parameters
    ----------
    near : float
        r_n, the least distance between nodes, in rope radii.
    far : float
        r_f > r_n, the reach to the next node, in rope radii.
    min_length : float
        Chains shorter than this are left out, in rope radii.

    Raises
    ------
    ValueError
        If `far` is not above `near`.
    """

    near: float = 1.0
    far: float = 2.5
    min_length: float = 1.0

    def __post_init__(self) -> None:
        _check(self)
        if self.far <= self.near:
            raise ValueError(f"Tracing.far: expected more than near = {self.near}, got {self.far}")


@dataclass(frozen=True)
class Splitting:
    """Cuts of the published method at minima of d*, a node's distance from the rest of the rope.

    Section V-B, eq. 19-20, fig. 11-12.

    Parameters
    ----------
    neighborhood : float
        Nodes this near along a chain do not count for d*, in rope radii of arc length. Above `threshold`, or
        every node would seem to cross.
    threshold : float
        Minima above this are no crossings, in rope radii. Strands in contact are 2 apart.
    closure : float
        A chain whose ends are this near to each other goes round and has no ends, in rope radii.
    prominence : float
        How much d* must rise on both sides of a minimum, in rope radii, so that noise is not cut at.

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
        _check(self)
        if self.neighborhood <= self.threshold:
            raise ValueError(
                f"Splitting.neighborhood: expected more than threshold = {self.threshold}, "
                f"got {self.neighborhood}"
            )


@dataclass(frozen=True)
class Reconnection:
    """Ends grouped by four, one group for a crossing, and paired by direction, in the published method.

    Section V-B, fig. 13.

    Parameters
    ----------
    reach : float
        Ends farther apart than this do not meet at one crossing, in rope radii.
    loop : float
        Both ends of one segment meet at a crossing only if it is longer than this, in rope radii.
    skip : float
        Nodes this near to an end do not count for its direction, in rope radii of arc length: where
        strands cross, eq. 17-18 mixes them.
    span : float
        The stretch over which the direction is taken, in rope radii of arc length.
    min_agreement : float
        Cosine between the directions of two ends below which a group of fewer than four is not joined.
    trim : float
        The stretch left out at ends that meet others, in rope radii of arc length, before a cubic
        bridges the gap.
    gap : float
        With the number of ropes given: the longest gap that is bridged away from crossings, in rope
        radii.
    """

    reach: float = 5.0
    loop: float = 10.0
    skip: float = 1.5
    span: float = 3.0
    min_agreement: float = 0.25
    trim: float = 2.0
    gap: float = 12.0

    def __post_init__(self) -> None:
        _check(self)


@dataclass(frozen=True)
class Poses:
    """How well the default method takes the reported poses to be known: as of a stage read off by hand.

    Parameters
    ----------
    rotation_sd : float
        Standard deviation of each component of the rotation vector, radians.
    translation_sd : float
        Standard deviation of each component of the translation, metres.
    """

    rotation_sd: float = math.radians(0.5)
    translation_sd: float = 1.5e-3

    def __post_init__(self) -> None:
        _check(self)


@dataclass(frozen=True)
class Tubes:
    """Tubes of the default method: traced through the points and fitted together with the poses.

    Parameters
    ----------
    spacing : float
        Length of a spline's spans, in rope radii; at least 0.5.
    rounds : int
        How often arcs are traced in all views and fitted, at most, before they are linked; at least 1. They
        are traced again only where the fit moved the poses much.
    min_arc : float
        Arcs shorter than this are left out, in rope radii.
    node_spacing : float
        Distance between a chain's nodes, in rope radii; at least 0.01.
    min_bend : float
        The tightest bend of a rope's axis: its radius of curvature, in rope radii; at least 1.
    noise : float, optional
        Standard deviation of the sensor's noise along the viewing rays, metres; estimated from the data if
        not given.
    """

    spacing: float = 2.5
    rounds: int = 2
    min_arc: float = 1.0
    node_spacing: float = 0.25
    min_bend: float = 1.5
    noise: float | None = None

    def __post_init__(self) -> None:
        _check(self)
        for name, least in (("rounds", 1), ("spacing", 0.5), ("node_spacing", 0.01), ("min_bend", 1.0)):
            value = getattr(self, name)
            if value < least:
                raise ValueError(f"Tubes.{name}: expected at least {least}, got {value}")


RINGS = ("maybe", "never", "always")


@dataclass(frozen=True)
class Linking:
    """Arcs joined to ropes by the default method: by the matching of their ends that costs least.

    Parameters
    ----------
    free_end : float
        Cost of an end that is joined to none.
    seen_through : float
        Cost of a join for each radius of it that lies in free space.
    gap : float
        The longest gap that is bridged, in rope radii, unless the number of ropes is given; somewhat longer
        ones where no camera could have seen the rope.
    margin : float
        A join is warned of if the next best way costs less than this more.
    loop : float
        An arc's two ends are joined to a ring only if it is longer than this, in rope radii.
    contact : float
        An arc's end nearer than this to the inside of another cuts it, in rope radii: two strands are 2
        apart.
    contact_gap : float
        How much is cut out on each side, in rope radii of arc length.
    min_length : float
        Ropes shorter than this are left out, in rope radii.
    rings : {"maybe", "never", "always"}
        `"maybe"`: as the data show. `"never"`: no rope is a ring, all have ends. `"always"`: all are rings;
        the ends that are left are joined over gaps of any length, but not through free space.
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
        _check(self)
        check_choice("Linking.rings", self.rings, RINGS)


METHODS = ("default", "published")


@dataclass(frozen=True)
class Config:
    """All numbers of a reconstruction, one section for each stage.

    Parameters
    ----------
    method : {"default", "published"}
        The method that finds the ropes: strand's own, or the published one.
    sensor : Sensor or str, optional
        The default method: the camera's errors, as a `strand.Sensor` or a camera's name, a key of
        `strand.views.sensor.PRESETS`; measured in the data if not given. Not together with `Tubes.noise`.
    filter : Filter
        Both methods: the outlier filter.
    poses : Poses
        The default method: how well poses are known.
    tubes : Tubes
        The default method: how tubes are traced and fitted.
    linking : Linking
        The default method: how arcs are joined.
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
    """

    method: str = "default"
    sensor: Sensor | str | None = None
    filter: Filter = field(default_factory=Filter)
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
            object.__setattr__(self, "sensor", preset(self.sensor))
        for name, section in _SECTIONS.items():
            if not isinstance(getattr(self, name), section):
                raise TypeError(f"Config.{name}: expected a {section.__name__}, got {getattr(self, name)!r}")
        if self.sensor is not None and self.tubes.noise is not None:
            raise ValueError("Config.sensor: says how large the noise is; leave out Tubes.noise")

    @classmethod
    def published(cls) -> Config:
        """Return the published method with its numbers, the same as `Config(method="published")`.

        Returns
        -------
        Config
        """
        return cls(method="published")


_SECTIONS: dict[str, type[Any]] = {
    "filter": Filter,
    "poses": Poses,
    "tubes": Tubes,
    "linking": Linking,
    "normals": Normals,
    "registration": Registration,
    "centerline": Centerline,
    "tracing": Tracing,
    "splitting": Splitting,
    "reconnection": Reconnection,
}


def load(path: str | os.PathLike[str]) -> Config:
    """Read a configuration from a TOML file with a table for each section.

    Sections and fields that it does not name keep their values.

    Parameters
    ----------
    path : str or path-like
        The file, for example ``[tracing]`` followed by ``near = 0.8``. A camera's name may stand for the
        section of the sensor: ``sensor = "d435"``.

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
