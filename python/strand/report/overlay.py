"""Draw the chains over a camera's depth image, as SVG."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from html import escape
from io import BytesIO

import numpy as np
from numpy.typing import NDArray

from strand.geometry.polyline import find_runs
from strand.report.cameras import Camera
from strand.report.drawing import pick_spread
from strand.report.drawn_chains import close_path, find_junctions
from strand.ropes.chain import Chain
from strand.ropes.model import Model, list_model_crossings
from strand.support.checks import Array
from strand.support.extras import import_extra

MAX_CHAINS = 50  # chains that are drawn
_MAX_NODES = 800  # nodes of all chains together
_MAX_DOUBTS = 20  # doubts, and crossings, that are drawn
_COLORS = 24  # different colours along the longest chain
_MAX_REASON = 150  # characters of a doubt
_MARGIN = 0.12  # around the ropes, of their extent
_MIN_MARGIN = 12  # around the ropes, pixels
_WIDTHS = (640, 480, 320, 200)  # pixels: the image gets the first width whose file is small enough
# shades of grey show the distance before the plane of most pixels
_DARKEST = -3.0  # radii before the plane
_BRIGHTEST = 6.0  # radii before the plane
_PLANE_ROUNDS = 4  # of the plane's fit
_PLANE_PIXELS = 20_000  # in the plane's fit, at most
_PLANE_CUTOFF = 2.5  # of the median distance: farther pixels leave the plane's fit
_MIN_COVER = 2.0  # radii before a rope's axis: something there hides the rope
_MAX_PIXEL = 1e5  # coordinates farther outside are clipped


def draw_overlay(camera: Camera, model: Model, max_bytes: int) -> str:
    """Draw a model's chains over one camera's depth image.

    Parameters
    ----------
    camera : Camera
    model : Model
    max_bytes : int
        Approximate limit for the embedded image, as text.

    Returns
    -------
    str
        An `svg` element. Brighter pixels are nearer, black ones have no return. Chains are dashed where
        they have no points, and thin where something hides them from this camera.
    """
    chains = model.chains[:MAX_CHAINS]
    drawn = [camera.project(close_path(chain)) for chain in chains]
    radius = float(np.median([chain.radius for chain in chains])) if chains else 0.005
    left, top, right, bottom = _find_window(camera, [pixels for pixels, _ in drawn])
    cut = camera.depth[top:bottom, left:right]
    image = _encode_image(_shade(cut, radius), max_bytes)
    width, height = right - left, bottom - top
    size = max(width, height) / 100
    parts = [
        f'<svg viewBox="{left} {top} {width} {height}" style="aspect-ratio:{width}/{height}" role="img">',
        f'<image x="{left}" y="{top}" width="{width}" height="{height}" '
        f'preserveAspectRatio="none" href="{image}"/>',
    ]
    longest = max((chain.length for chain in chains), default=1.0)
    every = max(-(-sum(len(pixels) for pixels, _ in drawn) // _MAX_NODES), 1)
    for i, (chain, (pixels, z)) in enumerate(zip(chains, drawn, strict=True)):
        kept = np.unique(np.append(np.arange(0, len(pixels), every), len(pixels) - 1))
        parts += _draw_strokes(camera, chain, pixels, z, kept, longest)
        # several edges of a harness start at a junction
        u, v = pixels[0 if model.harness is None else len(pixels) // 2]
        if left <= u <= right and top <= v <= bottom:
            parts.append(f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{0.8 * size:.2f}" fill="#fff"/>')
            parts.append(
                f'<text x="{u + size:.1f}" y="{v - size:.1f}" font-size="{4 * size:.1f}" '
                f'fill="#fff">{i}</text>'
            )
    for number, (u, v) in enumerate(camera.project(find_junctions(model))[0]):
        if left <= u <= right and top <= v <= bottom:
            parts.append(
                f'<circle class="junction" cx="{u:.1f}" cy="{v:.1f}" r="{1.2 * size:.2f}" fill="#fff" '
                f'stroke="#000"><title>junction {number}</title></circle>'
            )
    for crossing in (list_model_crossings(model) or ())[:_MAX_DOUBTS]:
        u, v = camera.project(crossing.place[None])[0][0]
        if left <= u <= right and top <= v <= bottom:
            arm, across = f"{2 * size:.1f}", f"M{u - size:.1f},{v - size:.1f}"
            ends = f"{across}l{arm},{arm}m0,-{arm}l-{arm},{arm}"
            parts.append(f'<path class="crossing" d="{ends}"><title>{escape(str(crossing))}</title></path>')
    for doubt in [doubt for doubt in model.doubts if doubt.place is not None][:_MAX_DOUBTS]:
        assert doubt.place is not None
        u, v = camera.project(doubt.place[None])[0][0]
        if left <= u <= right and top <= v <= bottom:
            reason = escape(str(doubt)[:_MAX_REASON])
            parts.append(
                f'<circle class="doubt" cx="{u:.1f}" cy="{v:.1f}" r="{2.5 * size:.2f}">'
                f"<title>{reason}</title></circle>"
            )
    return "".join([*parts, "</svg>"])


def _find_window(camera: Camera, drawn: Sequence[Array]) -> tuple[int, int, int, int]:
    """Return left, top, right and bottom of the part with the ropes; the whole image without ropes."""
    height, width = camera.depth.shape
    pixels = np.concatenate([np.empty((0, 2)), *drawn])
    u, v = pixels[np.isfinite(pixels).all(axis=1)].T
    inside = (u > -0.5) & (u < width - 0.5) & (v > -0.5) & (v < height - 0.5)
    if not inside.any():
        return 0, 0, width, height
    u, v = u[inside], v[inside]
    margin = max(_MARGIN * max(float(np.ptp(u)), float(np.ptp(v))), _MIN_MARGIN)
    left, top = max(int(u.min() - margin), 0), max(int(v.min() - margin), 0)
    return left, top, min(int(u.max() + margin) + 1, width), min(int(v.max() + margin) + 1, height)


def _shade(depth: Array, radius: float) -> NDArray[np.uint8]:
    """Return (H, W) shades of grey by the distance before the plane of most pixels."""
    rows, columns = np.nonzero(depth > 0)
    shades = np.zeros(depth.shape, dtype=np.uint8)
    if not len(rows):
        return shades
    z = depth[rows, columns]
    # the inverse depth of a plane is linear in columns and rows
    terms = np.column_stack([columns - columns.mean(), rows - rows.mean(), np.ones(len(rows))])
    kept = pick_spread(len(rows), _PLANE_PIXELS)
    nearer = np.zeros(len(rows))
    for _ in range(_PLANE_ROUNDS):
        plane = terms @ np.linalg.lstsq(terms[kept], 1.0 / z[kept], rcond=None)[0]
        nearer = z * (1.0 - z * plane)
        usual = np.median(np.abs(nearer[kept]))
        kept = kept[np.abs(nearer[kept]) <= _PLANE_CUTOFF * usual]
        if len(kept) < 3:
            break
    level = (nearer / radius - _DARKEST) / (_BRIGHTEST - _DARKEST)
    shades[rows, columns] = np.rint(60 + 195 * np.clip(level, 0.0, 1.0))
    return shades


def _encode_image(shades: NDArray[np.uint8], max_bytes: int) -> str:
    """Return an image as a data URI of about `max_bytes` at most."""
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


def _draw_strokes(
    camera: Camera, chain: Chain, pixels: Array, z: Array, kept: NDArray[np.intp], longest: float
) -> list[str]:
    """Draw one chain in the colours of its arc length, thin where hidden, dashed where it has no points."""
    bridged = np.append(chain.bridged, chain.bridged[:1]) if chain.closed else chain.bridged
    along = np.append(chain.arc_length, chain.length) if chain.closed else chain.arc_length
    pixels, z, bridged = pixels[kept].clip(-_MAX_PIXEL, _MAX_PIXEL), z[kept], bridged[kept]
    level = np.minimum(along[kept] / longest * _COLORS, _COLORS - 1).astype(int)
    visible = np.asarray(np.isfinite(pixels).all(axis=1))
    hidden = _find_hidden(camera, pixels, z, chain.radius)
    states: dict[str, NDArray[np.bool_]] = {
        "seen": visible & ~hidden & ~bridged,
        "hidden": visible & hidden & ~bridged,
        "bridged": visible & bridged,
    }
    scale = import_extra("plotly.colors").sample_colorscale("Viridis", _COLORS)
    strokes = []
    for kind, chosen in states.items():
        for color in np.unique(level[chosen]):
            for start, stop in find_runs(chosen & (level == color)):
                # extend each piece to the next node, so that pieces join
                to = stop + 1 if stop < len(pixels) and visible[stop] else stop
                line = "L".join(f"{u:.1f},{v:.1f}" for u, v in pixels[start:to])
                strokes.append(f'<path class="{kind}" d="M{line}" stroke="{scale[color]}"/>')
    return strokes


def _find_hidden(camera: Camera, pixels: Array, z: Array, radius: float) -> NDArray[np.bool_]:
    """Return (M,) whether the depth image shows something before each node of a rope."""
    height, width = camera.depth.shape
    whole = np.rint(np.nan_to_num(pixels, nan=-1.0, posinf=-1.0, neginf=-1.0).clip(-1, 1e6)).astype(int)
    columns, rows = whole.T
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    before = np.zeros(len(pixels), dtype=bool)
    seen = camera.depth[rows[inside], columns[inside]]
    before[inside] = (seen > 0) & (seen < z[inside] - _MIN_COVER * radius)
    return before
