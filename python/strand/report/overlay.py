"""The chains drawn over what each camera saw, as SVG with the depth image inside."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from html import escape
from io import BytesIO

import numpy as np
from numpy.typing import NDArray

from strand.geometry.polyline import find_runs
from strand.report.cameras import Camera
from strand.report.sheet import pick_spread
from strand.ropes.chain import Chain
from strand.ropes.model import Model
from strand.ropes.notebook import PALETTE
from strand.support.checks import Array
from strand.support.extras import import_extra

# pixels around the ropes that an image shows beside them, as a part of their extent, and at least
_MARGIN, _LEAST_MARGIN = 0.12, 12
# widths in which an image may be drawn, pixels: the first whose file is small enough is taken
_WIDTHS = (640, 480, 320, 200)
# grey says how far a place is before the plane that most of the image lies in, in radii
_FARTHEST, _NEAREST = -3.0, 6.0
_ROUNDS, _FITTED = 4, 20_000  # rounds of the fit of that plane, and pixels in it
# a place of a rope is hidden if something stands so many radii before its axis
_HIDDEN = 2.0
# an image may say so much of a model: nodes of all chains together, chains, doubts, characters of a doubt
_MOST_NODES, MAX_CHAINS, _MOST_DOUBTS, _LONGEST = 800, 50, 20, 150
# pixels far outside are not told apart
_OUTSIDE = 1e5


def draw_overlay(camera: Camera, model: Model, max_bytes: int) -> str:
    """Draw a model's chains over one camera's depth image.

    Parameters
    ----------
    camera : Camera
        In its corrected pose.
    model : Model
        Its chains, and its doubts.
    max_bytes : int
        About how large the image may be, as text.

    Returns
    -------
    str
        An `svg` element. Brighter is nearer; black is no return. What a rope bridges without points is
        dashed, what something hides from this camera thin.

    Raises
    ------
    ImportError
        If Pillow is not installed.
    """
    chains = model.chains[:MAX_CHAINS]
    drawn = [camera.projected(_path(chain)) for chain in chains]
    radius = float(np.median([chain.radius for chain in chains])) if chains else 0.005
    left, top, right, bottom = _window(camera, [pixels for pixels, _ in drawn])
    cut = camera.depth[top:bottom, left:right]
    image = _embedded(_grey(cut, radius), max_bytes)
    width, height = right - left, bottom - top
    size = max(width, height) / 100
    parts = [
        f'<svg viewBox="{left} {top} {width} {height}" style="aspect-ratio:{width}/{height}" role="img">',
        f'<image x="{left}" y="{top}" width="{width}" height="{height}" '
        f'preserveAspectRatio="none" href="{image}"/>',
    ]
    every = max(-(-sum(len(pixels) for pixels, _ in drawn) // _MOST_NODES), 1)
    for i, (chain, (pixels, z)) in enumerate(zip(chains, drawn, strict=True)):
        colour = PALETTE[i % len(PALETTE)]
        kept = np.unique(np.append(np.arange(0, len(pixels), every), len(pixels) - 1))
        parts += _strokes(camera, chain, pixels, z, kept, colour)
        u, v = pixels[0]
        if left <= u <= right and top <= v <= bottom:
            parts.append(f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{0.8 * size:.2f}" fill="{colour}"/>')
            parts.append(
                f'<text x="{u + size:.1f}" y="{v - size:.1f}" font-size="{4 * size:.1f}" '
                f'fill="{colour}">{i}</text>'
            )
    for doubt in [doubt for doubt in model.doubts if doubt.place is not None][:_MOST_DOUBTS]:
        assert doubt.place is not None
        u, v = camera.projected(doubt.place[None])[0][0]
        if left <= u <= right and top <= v <= bottom:
            reason = escape(str(doubt)[:_LONGEST])
            parts.append(
                f'<circle class="doubt" cx="{u:.1f}" cy="{v:.1f}" r="{2.5 * size:.2f}">'
                f"<title>{reason}</title></circle>"
            )
    return "".join([*parts, "</svg>"])


def _path(chain: Chain) -> Array:
    return np.vstack([chain.points, chain.points[:1]]) if chain.closed else chain.points


def _window(camera: Camera, drawn: Sequence[Array]) -> tuple[int, int, int, int]:
    """Columns and rows of the part of an image that is around the ropes; all of it if none is in it."""
    height, width = camera.depth.shape
    pixels = np.concatenate([np.empty((0, 2)), *drawn])
    u, v = pixels[np.isfinite(pixels).all(axis=1)].T
    inside = (u > -0.5) & (u < width - 0.5) & (v > -0.5) & (v < height - 0.5)
    if not inside.any():
        return 0, 0, width, height
    u, v = u[inside], v[inside]
    margin = max(_MARGIN * max(float(np.ptp(u)), float(np.ptp(v))), _LEAST_MARGIN)
    left, top = max(int(u.min() - margin), 0), max(int(v.min() - margin), 0)
    return left, top, min(int(u.max() + margin) + 1, width), min(int(v.max() + margin) + 1, height)


def _grey(depth: Array, radius: float) -> NDArray[np.uint8]:
    """(H, W) Shades of an image: how far each place is before the plane that most of them lie in."""
    rows, columns = np.nonzero(depth > 0)
    shades = np.zeros(depth.shape, dtype=np.uint8)
    if not len(rows):
        return shades
    z = depth[rows, columns]
    # the inverse depth of a plane is linear in columns and rows
    terms = np.column_stack([columns - columns.mean(), rows - rows.mean(), np.ones(len(rows))])
    kept = pick_spread(len(rows), _FITTED)
    nearer = np.zeros(len(rows))
    for _ in range(_ROUNDS):
        plane = terms @ np.linalg.lstsq(terms[kept], 1.0 / z[kept], rcond=None)[0]
        nearer = z * (1.0 - z * plane)
        usual = np.median(np.abs(nearer[kept]))
        kept = kept[np.abs(nearer[kept]) <= 2.5 * usual]
        if len(kept) < 3:
            break
    level = (nearer / radius - _FARTHEST) / (_NEAREST - _FARTHEST)
    shades[rows, columns] = np.rint(60 + 195 * np.clip(level, 0.0, 1.0))
    return shades


def _embedded(shades: NDArray[np.uint8], max_bytes: int) -> str:
    """Return an image as a data URI of about so many bytes at most."""
    image = import_extra("PIL.Image").fromarray(shades)
    text = ""
    for width in _WIDTHS:
        scale = min(width / max(image.size), 1.0)
        size = [max(round(scale * side), 1) for side in image.size]
        data = BytesIO()
        image.resize(size).save(data, "JPEG", quality=80)
        text = "data:image/jpeg;base64," + b64encode(data.getvalue()).decode()
        if len(text) <= max_bytes:
            break
    return text


def _strokes(
    camera: Camera, chain: Chain, pixels: Array, z: Array, kept: NDArray[np.intp], colour: str
) -> list[str]:
    """Lines of one chain: plain, thin where something hides it, dashed where no point supports it."""
    bridged = np.append(chain.bridged, chain.bridged[:1]) if chain.closed else chain.bridged
    pixels, z, bridged = pixels[kept].clip(-_OUTSIDE, _OUTSIDE), z[kept], bridged[kept]
    visible = np.asarray(np.isfinite(pixels).all(axis=1))
    hidden = _hidden(camera, pixels, z, chain.radius)
    states: dict[str, NDArray[np.bool_]] = {
        "seen": visible & ~hidden & ~bridged,
        "hidden": visible & hidden & ~bridged,
        "bridged": visible & bridged,
    }
    strokes = []
    for kind, chosen in states.items():
        pieces = []
        for start, stop in find_runs(chosen):
            # to the next node, so that the pieces join
            to = stop + 1 if stop < len(pixels) and visible[stop] else stop
            pieces.append("M" + "L".join(f"{u:.1f},{v:.1f}" for u, v in pixels[start:to]))
        if pieces:
            strokes.append(f'<path class="{kind}" d="{"".join(pieces)}" stroke="{colour}"/>')
    return strokes


def _hidden(camera: Camera, pixels: Array, z: Array, radius: float) -> NDArray[np.bool_]:
    """(M,) Whether the image shows something well before a place of a rope."""
    height, width = camera.depth.shape
    whole = np.rint(np.nan_to_num(pixels, nan=-1.0, posinf=-1.0, neginf=-1.0).clip(-1, 1e6)).astype(int)
    columns, rows = whole.T
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    before = np.zeros(len(pixels), dtype=bool)
    seen = camera.depth[rows[inside], columns[inside]]
    before[inside] = (seen > 0) & (seen < z[inside] - _HIDDEN * radius)
    return before
