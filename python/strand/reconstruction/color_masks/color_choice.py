"""Pieces of strips chosen as ropes, or a reason why none is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

import strand._core as _core
from strand.reconstruction.color_masks.color_pieces import Mask, Piece
from strand.reconstruction.color_masks.near_table import NearTable
from strand.support.checks import Array

_MAX_HALF_WIDTH = 0.5 / 18.0  # of the image's shorter side
_MIN_HALF_WIDTH = 0.9  # pixels
_MIN_LENGTH = 20.0  # half widths, of a piece that is a rope by itself
_MIN_EXTENT = 8.0  # half widths
_MIN_EVEN = 0.55  # share of the middle with the half width of the piece
_MIN_RESPONSE = 1.6  # of a piece that is a rope by itself
_MIN_KNOWN_RESPONSE = 1.2  # the same, where the colour is known
_MAX_WIDEST = 3.2  # half widths, and 1.5 pixels: crossings are no wider
_FITTING = 2.0  # half widths of a piece over those of its strips, at most; and its inverse
_MAX_ASIDE = 0.45  # of the contrast: difference of a rope's sides
_MAX_SCATTER = 1.1  # of the contrast, and 6 Lab: standard deviation of a rope's colours
_MIN_CONTRAST = 7.0  # Lab
_SAME_HUE = 4.0  # Lab: difference of hue of a shadow, and a tenth of its darkening
_MIN_LIGHT = 0.45  # of the table's light in a shadow
_MIN_SOFT = 3.0  # pixels: width of a shadow's edge
_RELATIVE = 0.4  # of the contrast of the best piece
_LONG_RELATIVE = 0.2  # the same of long pieces that respond strongly
_LONG = 30.0  # half widths of such a piece
_STRONG = 2.0  # response of such a piece
_MIN_RELATIVE_LENGTH = 0.12  # of the best piece's length, both in half widths
_MAX_WIDTH_RATIO = 0.8  # logarithm of half widths of ropes in one image
_AGAIN = 0.3  # share of a piece that a better one has taken
_MIN_PURE = 0.9  # share of pixels that differ from the background: such pieces go on beyond better ones
_MIN_INNER_ASIDE = 0.2  # of the contrast: sides of strips within others differ more
_MUCH_WIDER = 1.7  # half widths: strips that hold others are wider
_MIN_LONG = 0.6  # of their length
_MIN_HELD = 0.7  # share of their pixels
_MIN_OUTER_PURE = 0.85  # share of its pixels that differ from the background
_MIN_OUTER_EVEN = 0.65  # share of an outer strip's middle with its half width
_MIN_REST = 8.0  # half widths of its rest
_REST_WIDTH = 0.4  # logarithm of its half width over the best piece's
_BESIDE = 1.5  # half widths around a rope, and two pixels, in which pieces belong to it
_NEAR = 30.0  # half widths: pieces this near to a rope of their colour may be part of it
_MIN_PART_LENGTH = 7.0  # half widths, of such a part
_MIN_PART_EVEN = 0.5  # of such a part
_MAX_PART_OVERLAP = 0.2  # share of such a part that is taken
_PART_COLOR = 10.0  # Lab: difference of such a part's colour
_PART_WIDTH = 0.3  # logarithm of half widths of such a part
_MAX_FRAGMENTS = 0.7  # length of fragments over that of ropes, in half widths: above it is a pattern
_MAX_GROUPS = 3  # colours and widths of ropes; more are a pattern
_KNOWN_COLOR = 25.0  # Lab: fragments of other colours do not count where the colour is known
_SAME_COLOR = 16.0  # Lab: ropes of one label
_SAME_WIDTH = 0.5  # logarithm of half widths of one label
_PART_LIGHT = 0.6  # weight of light in differences of parts' colours
_LABEL_LIGHT = 0.5  # the same of labels
_COARSE = 4  # pixels: distances between pieces are measured on every fourth


@dataclass(eq=False)
class Choice:
    """Pieces that are ropes.

    Attributes
    ----------
    groups : list of list of Piece
        Pieces of each colour and width, the best first.
    why : str
        Why there is none; empty if there are some.
    left_out : list of (str, Piece)
        Long pieces that are no ropes, and why.
    fragments : float
        Length of other strips over that of the ropes.
    things : (H, W) ndarray of bool or None
        Pixels of things that are higher than ropes.
    """

    groups: list[list[Piece]] = field(default_factory=list)
    why: str = ""
    left_out: list[tuple[str, Piece]] = field(default_factory=list)
    fragments: float = 0.0
    things: Mask | None = None

    @property
    def pieces(self) -> list[Piece]:
        """All pieces."""
        return [piece for group in self.groups for piece in group]

    @property
    def length(self) -> float:
        """Length of all pieces, pixels."""
        return sum(piece.length for piece in self.pieces)


def choose_ropes(
    pieces: Sequence[Piece],
    shape: tuple[int, int],
    table: NearTable | None,
    ropes: int | None,
    known: Array | None = None,
) -> Choice:
    """Choose ropes among pieces of strips in an image of a shape, (H, W).

    Parameters
    ----------
    pieces : sequence of Piece
    shape : (int, int)
    table : NearTable or None
    ropes : int or None
        The number of ropes, if it is known.
    known : (3,) ndarray or None
        The rope's colour in Lab, if it is known.
    """
    choice = Choice()
    good = []
    for piece in pieces:
        if not _is_strip(piece, shape, known is not None):
            continue
        reason = _explain_no_rope(piece, table, known is not None)
        if reason:
            choice.left_out.append((reason, piece))
        else:
            good.append(piece)
    good = _drop_inner(good, shape, choice)
    kept, taken = _keep_alike(good, shape, choice, known is not None)
    if not kept:
        found = f"none of {len(pieces)} strips is long, of one width and of one colour"
        if known is not None and not pieces:
            found = "no strip has a colour near rope_color"
        choice.why = f"nothing in the image looks like a rope: {found}"
        return choice
    used = {id(piece) for piece in (*good, *(piece for _, piece in choice.left_out))}
    others = [piece for piece in pieces if id(piece) not in used]
    parts, fragments = _sort_others(others, kept, taken, shape, known)
    total = sum(piece.half_widths for piece in kept + parts)
    choice.fragments = fragments / total
    if choice.fragments > _MAX_FRAGMENTS:
        choice.why = (
            f"the background is patterned: strips in fragments are {choice.fragments:.1f} times as long as "
            f"ropes; give a mask{'' if known is not None else ' or rope_color'}"
        )
        return choice
    groups = _group(kept + parts if ropes is None else _keep_number(kept, parts, ropes, shape))
    if ropes is None and known is None and len(groups) > _MAX_GROUPS:
        choice.why = (
            f"the background is patterned: strips have {len(groups)} colours or widths; give a mask, "
            "rope_color or the number of ropes"
        )
        return choice
    choice.groups = groups
    return choice


def _drop_inner(good: list[Piece], shape: tuple[int, int], choice: Choice) -> list[Piece]:
    """Drop strips within wider ones, such as highlights on ropes."""
    kept = []
    for piece in good:
        outer = [
            other
            for other in good
            if piece.aside > max(_MIN_INNER_ASIDE, other.aside)
            and other.half_width > _MUCH_WIDER * piece.half_width
            and other.pure > _MIN_OUTER_PURE
            and other.even > _MIN_OUTER_EVEN
        ]
        if sum(other.length for other in outer) > _MIN_LONG * piece.length:
            mask: Mask = np.zeros(shape, dtype=bool)
            for other in outer:
                other.add_to(mask)
            if piece.overlap(mask) > _MIN_HELD:
                choice.left_out.append(("within a wider strip", piece))
                continue
        kept.append(piece)
    return kept


def _is_strip(piece: Piece, shape: tuple[int, int], known: bool) -> bool:
    """Tell whether a piece is long, even and thin."""
    half = piece.half_width
    low, high = piece.band_half_width / _FITTING, piece.band_half_width * _FITTING
    return (
        low <= half + 0.5 <= high + 0.5
        and _MIN_HALF_WIDTH <= half < _MAX_HALF_WIDTH * min(shape)
        and piece.response > (_MIN_KNOWN_RESPONSE if known else _MIN_RESPONSE)
        and piece.even > _MIN_EVEN
        and piece.length > _MIN_LENGTH * half
        and piece.extent > _MIN_EXTENT * half
        and piece.widest < _MAX_WIDEST * half + 1.5
    )


def _explain_no_rope(piece: Piece, table: NearTable | None, known: bool) -> str:
    """Return why a strip is no rope; nothing if it may be one."""
    if not known:
        if piece.aside > _MAX_ASIDE or piece.scatter > _MAX_SCATTER * piece.contrast + 6.0:
            return "an edge"
        if _is_shadow(piece):
            return "a shadow"
        if piece.contrast < _MIN_CONTRAST:
            return "faint"
    return "flat" if table is not None and table.shows_flat(piece) else ""


def _is_shadow(piece: Piece) -> bool:
    """Tell whether a piece is a soft darkening of one hue."""
    own, table = piece.color, piece.background
    turned = math.hypot(own[1] - table[1], own[2] - table[2])
    light = ((own[0] + 16.0) / (table[0] + 16.0)) ** 3
    same = turned < _SAME_HUE + 0.1 * abs(own[0] - table[0])
    return bool(own[0] < table[0] and same and light > _MIN_LIGHT and piece.soft >= _MIN_SOFT)


def _keep_alike(
    good: list[Piece], shape: tuple[int, int], choice: Choice, known: bool
) -> tuple[list[Piece], Mask]:
    """Return pieces that may be ropes of one image, each once, and the pixels on and beside them."""
    good = sorted(good, key=lambda piece: -piece.score)
    taken: Mask = np.zeros(shape, dtype=bool)
    kept: list[Piece] = []
    for piece in good:
        best = good[0]
        if piece.half_widths < _MIN_RELATIVE_LENGTH * best.half_widths:
            reason = "short"
        elif not known and piece.contrast < _find_relative(piece) * best.contrast:
            reason = "faint"
        elif abs(math.log(piece.half_width / best.half_width)) > _MAX_WIDTH_RATIO:
            reason = "of another width"
        elif (share := piece.overlap(taken)) > _AGAIN and not _goes_on(piece, share, best):
            reason = "the same at another width"
        else:
            kept.append(piece)
            _take(taken, piece, 2.0)
            continue
        choice.left_out.append((reason, piece))
    for piece in kept:
        _take(taken, piece, _BESIDE * piece.half_width + 2.0)
    return kept, taken


def _goes_on(piece: Piece, share: float, best: Piece) -> bool:
    """Tell whether a piece, partly taken, shows more of a rope about as wide as the best."""
    return (
        piece.pure > _MIN_PURE
        and (1.0 - share) * piece.half_widths > _MIN_REST
        and abs(math.log(piece.half_width / best.half_width)) < _REST_WIDTH
    )


def _find_relative(piece: Piece) -> float:
    """Return the least contrast of a piece, in that of the best one."""
    return _LONG_RELATIVE if piece.half_widths > _LONG and piece.response > _STRONG else _RELATIVE


def _take(taken: Mask, piece: Piece, reach: float) -> None:
    """Add the pixels at most `reach` from a piece to a mask."""
    margin = math.ceil(reach)
    rows, columns = piece.slices
    top, left = max(rows.start - margin, 0), max(columns.start - margin, 0)
    around = taken[top : rows.stop + margin, left : columns.stop + margin]
    own: Mask = np.full(around.shape, True)
    inner = own[rows.start - top :, columns.start - left :][: piece.pixels.shape[0], : piece.pixels.shape[1]]
    inner[...] = ~piece.pixels
    around |= np.asarray(_core.measure_edge_distances(own, margin + 1) < reach)


def _sort_others(
    others: list[Piece], kept: list[Piece], taken: Mask, shape: tuple[int, int], known: Array | None
) -> tuple[list[Piece], float]:
    """Return other pieces that are parts of ropes, and the length of the rest, in half widths."""
    strongest, best = max(piece.contrast for piece in kept[:1]), max(piece.response for piece in kept)
    reaches = [_find_reach(piece.make_mask(shape), _NEAR * piece.half_width) for piece in kept]
    parts, fragments = [], 0.0
    for piece in sorted(others, key=lambda piece: -piece.score):
        if piece.half_width > _MAX_HALF_WIDTH * min(shape) or piece.contrast < _RELATIVE * strongest:
            continue
        if piece.overlap(taken) > _MAX_PART_OVERLAP:
            continue
        if _may_be_part(piece) and any(
            _differ(piece, rope, _PART_LIGHT) < _PART_COLOR
            and abs(math.log(piece.half_width / rope.half_width)) < _PART_WIDTH
            and _meets(piece, reach)
            for rope, reach in zip(kept, reaches, strict=True)
        ):
            parts.append(piece)
        elif known is None or _measure_difference(piece.color, known, _PART_LIGHT) < _KNOWN_COLOR:
            fragments += piece.half_widths * min(piece.response / best, 1.0)
        else:
            continue
        piece.add_to(taken)
    return parts, fragments


def _may_be_part(piece: Piece) -> bool:
    return (
        piece.half_widths > _MIN_PART_LENGTH
        and piece.even > _MIN_PART_EVEN
        and piece.aside < _MAX_ASIDE
        and piece.response > 1.0
    )


def _find_reach(mask: Mask, reach: float) -> Mask:
    """Return which cells of a coarse image are at most `reach` pixels from a mask."""
    height, width = (side // _COARSE * _COARSE for side in mask.shape)
    cells = mask[:height, :width].reshape(height // _COARSE, _COARSE, width // _COARSE, _COARSE)
    far = reach / _COARSE
    return np.asarray(
        _core.measure_edge_distances(np.asarray(~cells.any(axis=(1, 3))), math.ceil(far) + 1) < far
    )


def _meets(piece: Piece, reach: Mask) -> bool:
    """Tell whether a piece has pixels in cells of a coarse image."""
    rows, columns = np.nonzero(piece.pixels)
    rows = np.minimum((rows + piece.slices[0].start) // _COARSE, reach.shape[0] - 1)
    columns = np.minimum((columns + piece.slices[1].start) // _COARSE, reach.shape[1] - 1)
    return bool(reach[rows, columns].any())


def _measure_difference(a: Array, b: Array, light: float) -> float:
    """Return the difference of two colours in Lab, with a weight of light."""
    return float(np.linalg.norm((a - b) * (light, 1.0, 1.0)))


def _differ(a: Piece, b: Piece, light: float) -> float:
    return _measure_difference(a.color, b.color, light)


def _are_alike(a: Piece, b: Piece) -> bool:
    """Tell whether two pieces have one colour and one width."""
    ratio = abs(math.log(a.half_width / b.half_width))
    return _differ(a, b, _LABEL_LIGHT) < _SAME_COLOR and ratio < _SAME_WIDTH


def _keep_number(kept: list[Piece], parts: list[Piece], ropes: int, shape: tuple[int, int]) -> list[Piece]:
    """Return the best piece of each of so many colours, with what is near it and alike."""
    heads: list[Piece] = []
    for piece in sorted(kept, key=lambda piece: -piece.score):
        if not any(_are_alike(piece, head) for head in heads):
            heads.append(piece)
    found: list[Piece] = []
    for head in heads[:ropes]:
        rest = [piece for piece in kept + parts if piece is not head and _are_alike(piece, head)]
        mask = head.make_mask(shape)
        found.append(head)
        while rest:
            reach = _find_reach(mask, _NEAR * head.half_width)
            near = [piece for piece in rest if _meets(piece, reach)]
            if not near:
                break
            for piece in near:
                piece.add_to(mask)
            found += near
            rest = [piece for piece in rest if not any(piece is other for other in near)]
    return found


def _group(kept: list[Piece]) -> list[list[Piece]]:
    """Return groups of pieces of one colour and width, the best first."""
    groups: list[list[Piece]] = []
    for piece in sorted(kept, key=lambda piece: -piece.score):
        group = next((group for group in groups if _are_alike(piece, group[0])), None)
        if group is None:
            groups.append([piece])
        else:
            group.append(piece)
    return groups
