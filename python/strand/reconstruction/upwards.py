"""Find which way is up: the normal of the table or of flat ropes, or else the side that cameras look from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import strand._core as _core
from strand.geometry.plane import Plane
from strand.reconstruction.images.table_plane import find_table, recall_table
from strand.reconstruction.observing import Scene
from strand.reconstruction.stages import Found, SoughtTable
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.ropes.model import Model
from strand.ropes.seen_side import USUAL_UP, find_seen_side
from strand.support.checks import Array
from strand.views.rope_images import make_rope_images
from strand.views.view import View

_MAX_POINTS = 20_000  # of a view without an image, in which a table is sought
_LEVEL_COSINE = np.cos(np.radians(2.0))  # of the angle between a normal and z: a smaller angle is an error
_MIN_FACING = 0.1  # cosine between the table's normal and the side that the cameras look from
_MAX_FLATNESS = 0.25  # extent of flat ropes across their plane, over the smaller one along it
_MIN_FLAT_FACING = 0.5  # cosine between the normal of flat ropes and the side that the cameras look from
_MAX_DEPTH = 3.0  # radii: nodes may lie this deep below their table
_MAX_SHARE_BELOW = 0.1  # of the nodes may lie deeper

# poses by which the cameras look from beneath
_UNDER_LEVEL_COSINE = np.cos(np.radians(20.0))  # of the angle between a table's normal and -z
_UNDER_COSINE = np.cos(np.radians(60.0))  # of the angle between the cameras' side and -z, without a table
_MAX_ORIGIN_HEIGHT = 0.1  # of the cameras' distance: the origin of a frame on the table is this near to it
_MAX_RIG_TURN = np.radians(20.0)  # radians from the frame of another camera beside this one
_MAX_RIG_SHIFT = 0.5  # of the ropes' distance: the way to that camera
_UPTURNED_DOUBT = 0.7  # doubt where a level table is seen from beneath
_UNSEEN_DOUBT = 0.3  # doubt where no table is seen
_DOWNWARD_DOUBT = 0.05  # doubt where the frame seems to be one on the table, with z down


@dataclass(frozen=True, eq=False)
class Upwards:
    """Which way is up.

    Attributes
    ----------
    up : (3,) ndarray
        Unit vector, world frame.
    table : Plane or None
        The table, its normal towards the cameras.
    doubts : list of Doubt
        The doubt of poses by which the cameras look from beneath.
    """

    up: Array
    table: Plane | None
    doubts: list[Doubt]


def find_up(scene: Scene, found: Found, chains: Sequence[Chain], previous: Model | None) -> Upwards:
    """Find which way is up in an answer.

    Parameters
    ----------
    scene : Scene
    found : Found
    chains : sequence of Chain
        The chains of the answer.
    previous : Model or None
        An earlier model of the same ropes: its table counts where the views show none.
    """
    nodes = np.vstack([chain.points for chain in chains])
    seen_side = find_seen_side(nodes, np.array(found.poses)[:, :3, 3])
    tables = (_find_table(scene, found), None if previous is None else previous.table)
    fitting = [table for table in tables if table is not None and _carries(table, chains, seen_side)]
    table = fitting[0] if fitting else None
    up = _find_flat_normal(nodes, seen_side) if table is None else table.normal
    poses = np.array([view.pose for view in scene.extract.whole])
    doubts = _doubt_poses(poses, nodes.mean(axis=0), up, table)
    return Upwards(USUAL_UP if up @ USUAL_UP > _LEVEL_COSINE else up, table, doubts)


def _find_flat_normal(nodes: Array, seen_side: Array) -> Array:
    """Return the normal of the plane that ropes lie in, towards the cameras; else the cameras' side."""
    from_middle = nodes - nodes.mean(axis=0)
    squares, axes = np.linalg.eigh(from_middle.T @ from_middle)
    normal = axes[:, 0] * np.copysign(1.0, axes[:, 0] @ seen_side)
    flat = squares[0] < _MAX_FLATNESS**2 * squares[1]
    return np.asarray(normal if flat and normal @ seen_side > _MIN_FLAT_FACING else seen_side)


def _doubt_poses(poses: Array, middle: Array, up: Array, table: Plane | None) -> list[Doubt]:
    """Return the doubt of poses by which cameras look at the ropes' middle from beneath, if z is up.

    Worlds with z along a camera's view are usual: the frame of one of the cameras, or one on the table with z
    down. The first shows in a pose, the second in a table through the origin.
    """
    if -up @ USUAL_UP < (_UNDER_COSINE if table is None else _UNDER_LEVEL_COSINE):
        return []
    distances = np.linalg.norm(poses[:, :3, 3] - middle, axis=1)
    turns = np.arccos(np.clip(0.5 * (np.trace(poses[:, :3, :3], axis1=1, axis2=2) - 1.0), -1.0, 1.0))
    shifts = np.linalg.norm(poses[:, :3, 3], axis=1)
    if ((turns < _MAX_RIG_TURN) & (shifts < _MAX_RIG_SHIFT * distances)).any():
        return []
    amount = _UNSEEN_DOUBT if table is None else _UPTURNED_DOUBT
    height = float(middle @ USUAL_UP) if table is None else table.offset
    if abs(height) < _MAX_ORIGIN_HEIGHT * _core.find_median(distances):
        amount = _DOWNWARD_DOUBT
    reason = (
        "by the poses the cameras look at the ropes from beneath; are poses camera-to-world, with x right, "
        "y down, z forward, and is z up in the world?"
    )
    return [Doubt("beneath", amount, "which way is up", reason)]


def _carries(table: Plane, chains: Sequence[Chain], seen_side: Array) -> bool:
    """Tell whether the cameras see the table's top, and the ropes lie above it."""
    heights = np.concatenate([table.measure_heights(chain.points) / chain.radius for chain in chains])
    faces = float(table.normal @ seen_side) > _MIN_FACING
    return faces and int(np.count_nonzero(heights <= -_MAX_DEPTH)) <= _MAX_SHARE_BELOW * len(heights)


def _find_table(scene: Scene, found: Found) -> Plane | None:
    """Return the table in one of the views that were used, by its registered pose: the held view's first."""
    observed = scene.observed
    masked = [place for place, has_mask in enumerate(observed.masked) if has_mask]
    first = masked[len(masked) // 2] if masked else observed.held
    places = sorted(range(len(observed.views)), key=lambda place: place != first)
    for place in places:
        number = observed.numbers[place]
        table = scene.tables[number] if scene.tables else None
        if table is None and place == first:
            table = _find_in_view(observed.views[place], observed.whole[place], scene, found.sought)
        if table is not None:
            given = observed.views[place].pose
            return table.moved(found.poses[place] @ np.linalg.inv(given))
    return None


def _find_in_view(view: View, whole: View, scene: Scene, sought: SoughtTable | None) -> Plane | None:
    """Return the table beside the ropes in a depth image, or the table that most points of a cloud lie on."""
    if whole.image is None:
        points = whole.points[:: max(len(whole.points) // _MAX_POINTS, 1)]
        table = find_table(points)
        return None if table is None else table.moved(whole.pose)
    observed = scene.observed
    (image,) = make_rope_images([view], [whole], observed.bounds)
    return recall_table(image, observed.radius, sought) if image.mask.any() else None
