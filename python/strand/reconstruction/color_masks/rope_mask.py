"""rope_mask(): a colour image in, the mask of ropes out, or the reason why there is none."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

import strand._core as _core
from strand.reconstruction.color_masks.color_choice import Choice, choose_ropes
from strand.reconstruction.color_masks.color_pieces import Mask, Piece, find_pieces
from strand.reconstruction.color_masks.known_color import find_known_ropes, split_by_color
from strand.reconstruction.color_masks.label_colors import split_labels
from strand.reconstruction.color_masks.near_table import NearTable, find_near_table
from strand.reconstruction.color_masks.refinement import refine_labels
from strand.support.checks import Array, check_colors, check_integer, check_intrinsics, to_array
from strand.views.pinhole import Pinhole

_MIN_SIDE = 32  # pixels: no rope is sought in smaller images
_MAX_COLORS = 8  # colours that are sought at once
_MAX_HUES = 6  # hues and chromas of ropes; more are a pattern
_MAX_LENGTH = 3.5  # diagonals of the image: ropes are no longer in all
_ONE_HUE = 18.0  # Lab: differences of one hue and chroma, of a and b
_MIN_SHARE = 0.03  # of the pixels: hues that fewer have do not count
_MAX_SAMPLES = 1500  # pixels whose hues are counted
_MAX_CENTERS = 60  # of these, tried as the middle of a hue
_MAX_GROWTH = 1.5  # a mask's pixels over those of its strips: it grows into a background of its colour
_MAX_GROUP_GROWTH = 2.5  # the same of one group among several
_MAX_ON_THINGS = 0.4  # share of a piece on things that are higher than ropes


@dataclass(frozen=True, eq=False)
class RopeMask:
    """The pixels of ropes in a colour image.

    Attributes
    ----------
    mask : (H, W) ndarray of bool
        Empty if no rope was found.
    labels : (H, W) ndarray of int32
        0 for no rope, otherwise the number of the rope's colour, from 1 on: in the order of `rope_color`, or
        the most conspicuous colour first. A colour of `rope_color` that no rope has is not in it.
    radius_px : float
        Half width of most ropes, pixels; NaN without a rope.
    why : str
        Why there is no mask; empty if there is one.
    left_out : tuple of str
        Why long strips that are not in the mask are no ropes, one entry for each.
    fragments : float
        Length of other strips over that of ropes; backgrounds with patterns have more than 0.7.
    radius : float or None
        The ropes' radius, metres; None without depth.
    scatter : float or None
        Standard deviation of the table's depths, metres; None without depth. Depth shows no height of ropes
        that are thinner.
    """

    mask: NDArray[np.bool_]
    labels: NDArray[np.int32]
    radius_px: float
    why: str = ""
    left_out: tuple[str, ...] = ()
    fragments: float = 0.0
    radius: float | None = None
    scatter: float | None = None

    def __post_init__(self) -> None:
        for array in (self.mask, self.labels):
            array.setflags(write=False)

    def __bool__(self) -> bool:
        return not self.why


def rope_mask(
    color: ArrayLike,
    depth: ArrayLike | None = None,
    intrinsics: ArrayLike | None = None,
    *,
    rope_color: ArrayLike | None = None,
    ropes: int | None = None,
) -> RopeMask:
    """Find the pixels of ropes in a colour image, without training.

    A rope is a strip of one width whose colour differs from both sides. Strips that are short, uneven,
    shadows or edges are no ropes. Where many strips are left, the background is patterned, and there is no
    mask but a reason.

    Parameters
    ----------
    color : (H, W, 3) array_like
        Red, green and blue in sRGB: uint8, or from 0 to 1.
    depth : (H, W) array_like of float, optional
        Depth of the same pixels, metres; 0 or NaN for no return. Ropes then lie on or near the plane that
        most depth shows, and strips that depth shows flat are no ropes.
    intrinsics : (3, 3) array_like, optional
        The pinhole matrix, pixels. Depth needs it, and it needs depth.
    rope_color : array_like, optional
        The ropes' colour, (3,), or several, (N, 3): whole numbers from 0 to 255, or floats from 0 to 1. Or
        an (H, W) mask of a few pixels that show rope, for instance clicked ones; 0 is none.
    ropes : int, optional
        The number of ropes, if it is known: at most this many colours are in the mask.

    Returns
    -------
    RopeMask
        It is false if no rope was found.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If a shape is wrong, a colour is out of range, or only one of depth and intrinsics is given.

    Examples
    --------
    >>> import numpy as np
    >>> import strand
    >>> color = np.full((120, 160, 3), 180, dtype=np.uint8)
    >>> color[57:62, 20:140] = (200, 30, 30)
    >>> found = strand.rope_mask(color)
    >>> bool(found), int(found.labels.max())
    (True, 1)
    """
    image = convert_colors(color)
    shape = (image.shape[0], image.shape[1])
    table = None
    if depth is None:
        if intrinsics is not None:
            raise ValueError("intrinsics: expected depth along with it, got None")
    else:
        if intrinsics is None:
            raise ValueError("intrinsics: expected the camera's along with depth, got None")
        metres = to_array("depth", depth)
        if metres.dtype.kind != "f":
            raise TypeError(
                f"depth: expected floats in metres, got dtype {metres.dtype}; multiply whole numbers by the "
                "metres of a unit, such as 0.001"
            )
        if metres.shape != shape:
            raise ValueError(f"depth: expected the image's shape {shape}, got {metres.shape}")
        metres = np.where(np.isfinite(metres) & (metres > 0), metres, 0.0).astype(np.float64)
        camera = Pinhole.from_matrix(check_intrinsics("intrinsics", intrinsics))
        table = find_near_table(metres, camera)
    known = None if rope_color is None else _convert_known(rope_color, color, image)
    count = None if ropes is None else check_integer("ropes", ropes, 1)
    return find_mask(image, table, known, count)


def convert_colors(color: ArrayLike) -> NDArray[np.uint8]:
    """Return an (H, W, 3) image of bytes, checked."""
    image = to_array("color", color)
    if image.dtype == np.uint8:
        if image.ndim != 3 or image.shape[2] != 3:
            raise ValueError(f"color: expected shape (H, W, 3), got {image.shape}")
        return np.ascontiguousarray(image)
    return np.rint(255.0 * check_colors("color", color, ("H", "W", 3))).astype(np.uint8)


def find_mask(
    image: NDArray[np.uint8], table: NearTable | None, known: NDArray[np.uint8] | None, ropes: int | None
) -> RopeMask:
    """Find ropes in an (H, W, 3) image, of (N, 3) known colours if there are some."""
    return search_mask(image, table, known, ropes)[0]


def search_mask(
    image: NDArray[np.uint8],
    table: NearTable | None,
    known: NDArray[np.uint8] | None,
    ropes: int | None,
    diagonal: float = 0.0,
) -> tuple[RopeMask, list[Piece]]:
    """Find ropes as `find_mask` does, and return their pieces too.

    The diagonal, pixels, is that of the whole image, of which `image` may be a part.
    """
    shape = (image.shape[0], image.shape[1])
    diagonal = max(diagonal, float(np.hypot(*shape)))
    if min(shape) < _MIN_SIDE:
        return _make_mask([], shape, f"color: the image is smaller than {_MIN_SIDE} pixels", None), []
    lab = _core.convert_to_lab(image)
    pieces = find_pieces(lab, None if table is None else table.near)
    if known is None:
        choice = _choose_low(pieces, lab, table, ropes, diagonal)
        found = _make_mask(list(enumerate(choice.groups, 1)), shape, "", table, [choice], lab)
        if found:
            found = replace(found, labels=split_labels(lab, found.labels, found.radius_px))
        return found, choice.pieces
    colors = _core.convert_to_lab(np.ascontiguousarray(known[None]))[:, 0].T.astype(np.float64)
    # what was found without the colours is as good where it has them
    plain = split_by_color(_choose_low(pieces, lab, table, ropes, diagonal), lab, colors)
    known_ropes = [find_known_ropes(lab, own, pieces, table, ropes) for own in colors]
    choices = [max(pair, key=lambda choice: choice.length) for pair in zip(known_ropes, plain, strict=True)]
    groups = [(k, choice.pieces) for k, choice in enumerate(choices, 1) if choice.groups]
    return _make_mask(groups, shape, "", table, choices, lab), [piece for _, own in groups for piece in own]


def _count_colors(lab: NDArray[np.float32], pieces: list[Piece]) -> int:
    """Return the number of hues and chromas that pieces in a (3, H, W) image have."""
    if not pieces:
        return 0
    own = [lab[(slice(1, None), *piece.places)] for piece in pieces]
    left = np.concatenate(own, axis=1).T
    left = left[:: max(len(left) // _MAX_SAMPLES, 1)]
    least, count = _MIN_SHARE * len(left), 0
    while len(left) > least:
        # the pixel with most others around it
        some = left[:: max(len(left) // _MAX_CENTERS, 1)]
        away = np.square(some[:, None] - left).sum(axis=2) < _ONE_HUE**2
        most = away[np.count_nonzero(away, axis=1).argmax()]
        if np.count_nonzero(most) < least:
            break
        left = left[~most]
        count += 1
    return count


def _choose_low(
    pieces: list[Piece],
    lab: NDArray[np.float32],
    table: NearTable | None,
    ropes: int | None,
    diagonal: float,
) -> Choice:
    """Choose ropes among pieces that do not belong to things higher than ropes."""
    shape = (lab.shape[1], lab.shape[2])
    choice = choose_ropes(pieces, shape, table, ropes)
    radius = None if table is None or not choice.groups else table.measure_radius(choice.pieces)
    things = None
    if table is not None and radius is not None:
        things = table.find_things(radius, _find_half_width(choice.pieces))
    if things is not None:
        high = {id(piece) for piece in pieces if piece.overlap(things) > _MAX_ON_THINGS}
        if high:
            choice = choose_ropes([piece for piece in pieces if id(piece) not in high], shape, table, ropes)
            choice.left_out += [("high", piece) for piece in pieces if id(piece) in high]
        choice.things = things
    why = "" if ropes is not None else _explain_pattern(choice, lab, diagonal)
    return replace(choice, groups=[], why=why) if why else choice


def _explain_pattern(choice: Choice, lab: NDArray[np.float32], diagonal: float) -> str:
    """Return why chosen pieces in a (3, H, W) image are those of a pattern; nothing if they are not."""
    colors = _count_colors(lab, choice.pieces)
    if colors > _MAX_HUES:
        found = f"strips have {colors} colours"
    elif _measure_length(choice.pieces, (lab.shape[1], lab.shape[2])) > _MAX_LENGTH * diagonal:
        found = "strips run all over it"
    else:
        return ""
    return f"the background is patterned: {found}; give a mask, rope_color or the number of ropes"


def _measure_length(pieces: list[Piece], shape: tuple[int, int]) -> float:
    """Return the length of pieces, pixels, of which some show the same strip at another width."""
    taken: Mask = np.zeros(shape, dtype=bool)
    length = 0.0
    for piece in pieces:
        length += piece.length * (1.0 - piece.overlap(taken))
        piece.add_to(taken)
    return length


def _convert_known(rope_color: ArrayLike, color: ArrayLike, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return (N, 3) known colours as bytes."""
    given = to_array("rope_color", rope_color)
    if given.dtype == np.bool_ or (given.dtype.kind in "iu" and given.shape == image.shape[:2]):
        if given.shape != image.shape[:2]:
            raise ValueError(f"rope_color: expected a mask of shape {image.shape[:2]}, got {given.shape}")
        if not given.any():
            raise ValueError("rope_color: expected a mask with pixels, got an empty one")
        return np.asarray(np.rint(np.median(image[given != 0], axis=0)), dtype=np.uint8)[None]
    rows = np.atleast_2d(given)
    if rows.ndim != 2 or rows.shape[1] != 3 or not 0 < len(rows) <= _MAX_COLORS:
        raise ValueError(
            f"rope_color: expected a colour (3,), up to {_MAX_COLORS} colours (N, 3), or a mask of shape "
            f"{image.shape[:2]}, got shape {given.shape}"
        )
    if rows.dtype.kind in "iu":
        if rows.min() < 0 or rows.max() > 255:
            raise ValueError(f"rope_color: expected 0 to 255, got {rows.min()} to {rows.max()}")
        return rows.astype(np.uint8)
    return np.rint(255.0 * check_colors("rope_color", rows, ("N", 3))).astype(np.uint8)


def _make_mask(
    groups: list[tuple[int, list[Piece]]],
    shape: tuple[int, int],
    why: str,
    table: NearTable | None,
    choices: list[Choice] | None = None,
    lab: NDArray[np.float32] | None = None,
) -> RopeMask:
    """Draw groups of pieces, each with its label."""
    choices = choices or []
    labels = np.zeros(shape, dtype=np.int32)
    pieces = [piece for _, group in groups for piece in group]
    if pieces and lab is not None:
        things = [choice.things for choice in choices if choice.things is not None]
        high = np.any(things, axis=0) if things else None
        labels, groups = _refine_groups(lab, groups, high)
        pieces = [piece for _, group in groups for piece in group]
        if not pieces:
            why = "the background has the ropes' colours in places; give a mask"
    if not pieces:
        why = why or "; ".join(dict.fromkeys(choice.why for choice in choices if choice.why))
        radius_px = float("nan")
    else:
        why, radius_px = "", _find_half_width(pieces)
    return RopeMask(
        labels > 0,
        labels,
        radius_px,
        why,
        tuple(reason for choice in choices for reason, _ in choice.left_out),
        max((choice.fragments for choice in choices), default=0.0),
        None if table is None or not pieces else table.measure_radius(pieces),
        None if table is None else table.scatter,
    )


def _refine_groups(
    lab: NDArray[np.float32], groups: list[tuple[int, list[Piece]]], things: Mask | None
) -> tuple[NDArray[np.int32], list[tuple[int, list[Piece]]]]:
    """Return labels of groups, and the groups that do not grow into a background of their colour."""
    shape = (lab.shape[1], lab.shape[2])
    while groups:
        pieces = [piece for _, group in groups for piece in group]
        labels = refine_labels(lab, groups, _find_half_width(pieces), things)
        growth = [float(np.sum(labels == label) / np.sum(_draw(group, shape))) for label, group in groups]
        worst = int(np.argmax(growth))
        whole = np.count_nonzero(labels) / np.count_nonzero(_draw(pieces, shape))
        if whole <= _MAX_GROWTH and (worst == 0 or growth[worst] <= _MAX_GROUP_GROWTH):
            return labels, groups
        if worst == 0:
            break  # the best group itself does
        groups = [*groups[:worst], *groups[worst + 1 :]]
    return np.zeros(shape, dtype=np.int32), []


def _draw(pieces: list[Piece], shape: tuple[int, int]) -> Mask:
    mask: Mask = np.zeros(shape, dtype=bool)
    for piece in pieces:
        piece.add_to(mask)
    return mask


def _find_half_width(pieces: list[Piece]) -> float:
    """Return the half width that most of the ropes' length has, pixels."""
    order = sorted(pieces, key=lambda piece: piece.half_width)
    total: Array = np.cumsum([piece.length for piece in order])
    return float(order[int(np.searchsorted(total, 0.5 * total[-1]))].half_width)
