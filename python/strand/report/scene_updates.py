"""Show models in Foxglove: an MCAP file of scene updates, with lines, crossings and arrows of the ropes."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from strand._core import __version__
from strand.report.drawn_chains import close_path, pick_color
from strand.report.scene_arrows import draw_direction, draw_grasps, draw_pulls, make_point
from strand.report.tracks import TrackedRope, cut_rope
from strand.ropes.chain import Chain
from strand.ropes.crossings import Crossing
from strand.ropes.grasps import Gripper
from strand.ropes.model import Model, list_model_crossings
from strand.ropes.summary import format_confidence
from strand.support.checks import (
    Array,
    check_bool,
    check_instance,
    check_nonnegative,
    check_path,
    check_text,
)
from strand.support.files import check_suffix, replace_file
from strand.support.mcap_file import Channel, McapFile
from strand.support.stamps import SECOND, count_nanoseconds

Message = dict[str, Any]

_KIND = "foxglove.SceneUpdate"
_LINE_STRIP = 0  # type of a line
_MATCHING_ID = 0  # type of a deletion
_CROSSINGS = "crossings"
_CROSSING = {"r": 1.0, "g": 0.5, "b": 0.05, "a": 0.8}  # orange
_HIDDEN = {"r": 0.54, "g": 0.54, "b": 0.54, "a": 1.0}  # grey: predicted parts
_MARK = 1.5  # radius of the mark of a crossing, in the ropes' radii
_RAISED = 5.0  # of a crossing's text above it, in the ropes' radii
_FONT = 4.0  # height of a text, in the ropes' radii
_LATEST = 2**32  # seconds: messages have no later times
_FLAT = ("metadata", "arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")


def write_mcap(
    models: Iterable[Model],
    path: str | os.PathLike[str],
    *,
    frame_id: str = "world",
    topic: str = "/ropes",
    lifetime: float = 0.0,
    pulls: bool = False,
    gripper: Gripper | None = None,
) -> None:
    """Write models as `foxglove.SceneUpdate` messages in JSON to an MCAP file, one at each `Model.stamp`.

    Each rope is an entity such as `rope_0` with a line as thick as the rope, in its colour, or one of a
    palette where that is not known. The number is that of the chain, or of the tracked rope. What is
    predicted of a tracked rope is grey. An arrow in the middle of a rope points to its last node. The entity
    `crossings` has a sphere at each crossing, with the probability of its order. On request, `pulls` and
    `grasps` have arrows. A rope that the next model lacks is deleted.

    Parameters
    ----------
    models : iterable of Model
        They are written one by one. For tracks, `(track.model for track in tracks)`.
    path : str or path-like
        The `.mcap` file. An existing one is replaced when the new one is complete.
    frame_id : str
        The TF frame that is strand's world frame.
    topic : str
    lifetime : float
        Seconds from its stamp after which a viewer removes a rope; with 0 it stays until the next model.
    pulls : bool
        Whether red arrows show the moves of `Model.pull_plan`. All but the first are faint.
    gripper : Gripper, optional
        A green arrow shows the approach of its best grasp of each rope, see `Model.grasps`.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If the name does not end with `.mcap`, `lifetime` is negative, or a stamp is before 1970 or before
        that of the model before. A single model needs no stamp: its time is 0. Each of several needs one.
    OSError
        If the file cannot be written.
    """
    check_suffix(path, ("mcap",))
    if isinstance(models, (Model, str, bytes)) or not isinstance(models, Iterable):
        raise TypeError(f"models: expected an iterable of Model, got {type(models).__name__}")
    place, frame, topic = (
        check_path("path", path),
        check_text("frame_id", frame_id),
        check_text("topic", topic),
    )
    pulls = check_bool("pulls", pulls)
    if gripper is not None:
        check_instance("gripper", gripper, Gripper)
    lasting = _split(min(check_nonnegative("lifetime", lifetime), _LATEST))
    before: list[str] = []
    unstamped, last = False, 0.0
    with replace_file(place) as file:
        channel = Channel(topic, _KIND, json.dumps(_make_schema()).encode())
        written = McapFile(file, [channel], f"strand {__version__}")
        for number, model in enumerate(models):
            if not isinstance(model, Model):
                raise TypeError(f"models[{number}]: expected a Model, got {type(model).__name__}")
            if unstamped or (model.stamp is None and number):
                raise ValueError("models: expected a stamp in each of several models, got None")
            unstamped = model.stamp is None
            at = 0.0 if model.stamp is None else model.stamp
            if not 0.0 <= at < _LATEST:
                raise ValueError(f"models[{number}].stamp: expected seconds from 0 to {_LATEST}, got {at:g}")
            if at < last:
                raise ValueError(
                    f"models[{number}].stamp: expected models in the order of their stamps, got one "
                    f"{last - at:g} s before that of models[{number - 1}]"
                )
            last = at
            entities = [*_draw_ropes(model), *_draw_plans(model, pulls, gripper)]
            update = _make_update(entities, at, frame, lasting, before)
            before = [entity["id"] for entity in entities]
            written.add(count_nanoseconds(at), json.dumps(update, allow_nan=False).encode())
        written.end()


def _make_update(
    entities: list[Message], at: float, frame: str, lasting: Message, before: list[str]
) -> Message:
    """Return the message of a model's entities; `before` are the names of those of the last one."""
    common = {"timestamp": _split(at), "frame_id": frame, "lifetime": lasting, "frame_locked": False}
    common |= {name: [] for name in _FLAT}
    names = {entity["id"] for entity in entities}
    gone = [
        {"timestamp": _split(at), "type": _MATCHING_ID, "id": name} for name in before if name not in names
    ]
    return {"deletions": gone, "entities": [common | entity for entity in entities]}


def _draw_ropes(model: Model) -> Iterator[Message]:
    for i, chain in enumerate(model.chains):
        number = chain.number if isinstance(chain, TrackedRope) else i
        facts = {"length": f"{chain.length:.4f} m", "radius": f"{chain.radius:.5f} m"}
        if not math.isnan(chain.confidence):
            facts["confidence"] = format_confidence(chain.confidence)
        color = _choose_color(chain, number)
        yield {
            "id": f"rope_{number}",
            "metadata": [{"key": key, "value": value} for key, value in facts.items()],
            "lines": _draw_lines(chain, color),
            "arrows": [draw_direction(chain, color)],
        }


def _draw_plans(model: Model, pulls: bool, gripper: Gripper | None) -> Iterator[Message]:
    """Yield the entities that need crossings; nothing is drawn if there are too many to list."""
    crossings = list_model_crossings(model)
    yield {"id": _CROSSINGS, **_draw_crossings(model, crossings or ())}
    if pulls and crossings is not None:
        yield {"id": "pulls", "arrows": draw_pulls(model, crossings)}
    if gripper is not None and crossings is not None:
        yield {"id": "grasps", "arrows": draw_grasps(model, crossings, gripper)}


def _choose_color(chain: Chain, number: int) -> Message:
    shares = chain.color
    if shares is None:
        shares = np.array(tuple(bytes.fromhex(pick_color(number)[1:]))) / 255.0
    red, green, blue = np.round(shares, 3).tolist()
    return {"r": red, "g": green, "b": blue, "a": 1.0}


def _draw_lines(chain: Chain, color: Message) -> list[Message]:
    shown, hidden = [close_path(chain)], list[Array]()
    if isinstance(chain, TrackedRope):
        shown, hidden = cut_rope(chain, False), cut_rope(chain, True)
    return [
        {
            "type": _LINE_STRIP,
            "pose": _make_pose(np.zeros(3)),
            "thickness": 2.0 * chain.radius,
            "scale_invariant": False,
            "points": [make_point(node) for node in path],
            "color": own,
            "colors": [],
            "indices": [],
        }
        for paths, own in ((shown, color), (hidden, _HIDDEN))
        for path in paths
    ]


def _draw_crossings(model: Model, crossings: Sequence[Crossing]) -> dict[str, list[Message]]:
    spheres, texts = [], []
    for crossing in crossings:
        radius = model.chains[crossing.over[0]].radius
        size = dict.fromkeys("xyz", 2.0 * _MARK * radius)
        spheres.append({"pose": _make_pose(crossing.place), "size": size, "color": _CROSSING})
        sure = crossing.probability
        texts.append(
            {
                "pose": _make_pose(crossing.place + _RAISED * radius * model.up),
                "billboard": True,
                "font_size": _FONT * radius,
                "scale_invariant": False,
                "color": _CROSSING,
                "text": "?" if math.isnan(sure) else format_confidence(sure),
            }
        )
    return {"spheres": spheres, "texts": texts}


def _split(seconds: float) -> Message:
    sec, nsec = divmod(count_nanoseconds(seconds), SECOND)
    return {"sec": sec, "nsec": nsec}


def _make_pose(place: Array) -> Message:
    return {"position": make_point(place), "orientation": dict.fromkeys("xyz", 0.0) | {"w": 1.0}}


def _make_schema() -> Message:
    """Return the JSON Schema of the messages; lists that strand leaves empty have entries of any kind."""
    point, color = dict.fromkeys("xyz", "number"), dict.fromkeys("rgba", "number")
    pose = {"position": point, "orientation": dict.fromkeys("xyzw", "number")}
    time = {"sec": "integer", "nsec": "integer"}
    line: Message = {"type": "integer", "pose": pose, "thickness": "number", "scale_invariant": "boolean"}
    line |= {"points": [point], "color": color, "colors": [color], "indices": ["integer"]}
    text: Message = {
        "pose": pose,
        "billboard": "boolean",
        "font_size": "number",
        "scale_invariant": "boolean",
    }
    arrow: Message = {"pose": pose, "color": color}
    arrow |= {f"{part}_{size}": "number" for part in ("shaft", "head") for size in ("length", "diameter")}
    entity: Message = {"timestamp": time, "frame_id": "string", "id": "string", "lifetime": time}
    entity |= {"frame_locked": "boolean"} | {name: [{}] for name in _FLAT}
    entity |= {
        "metadata": [{"key": "string", "value": "string"}],
        "arrows": [arrow],
        "spheres": [{"pose": pose, "size": point, "color": color}],
        "lines": [line],
        "texts": [text | {"color": color, "text": "string"}],
    }
    deletion: Message = {"timestamp": time, "type": "integer", "id": "string"}
    return {"title": _KIND} | _describe({"deletions": [deletion], "entities": [entity]})


def _describe(fields: Any) -> Message:
    """Return the JSON Schema of a value: the name of a type, a list of one kind, or an object of fields."""
    if isinstance(fields, str):
        return {"type": fields}
    if isinstance(fields, list):
        return {"type": "array", "items": _describe(fields[0])}
    described = {name: _describe(kind) for name, kind in fields.items()}
    return {"type": "object", "properties": described, "required": list(fields)}
