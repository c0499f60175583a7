"""Convert ropes to messages of strand_msgs and diagnostic_msgs, without ROS.

Messages are nested dictionaries, as those of `strand.msgs`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand import Chain, Model
from strand.ropes.crossings import Crossing, list_crossings
from strand.ropes.doubt import Doubt, ModelWarning
from strand.support.stamps import SECOND, count_nanoseconds
from strand.tracking.events import Event
from strand.tracking.track import Track, TrackedRope

Message = dict[str, Any]

# constants of Rope.msg
RECONSTRUCTED = 0
_STATES = {"tentative": 1, "tracking": 2, "coasting": 3, "lost": 4}
_BRIDGED = 1
_PREDICTED = 2
_NO_LABEL = -1
_UPPER = np.triu_indices(3)  # the places in a covariance that messages hold


def make_header(stamp: Any, frame_id: str) -> Message:
    """Return a std_msgs/Header with the time of another message's stamp."""
    return {"stamp": {"sec": int(stamp.sec), "nanosec": int(stamp.nanosec)}, "frame_id": frame_id}


def make_ropes(model: Model, header: Message, track: Track | None = None) -> Message:
    """Return a strand_msgs/Ropes of a model, or of the model of a track."""
    chains = model.chains
    ids = [chain.number if isinstance(chain, TrackedRope) else i for i, chain in enumerate(chains)]
    crossings = list_crossings(chains, model.up, model.doubts, model.confidence)
    return {
        "header": header,
        "ropes": [_make_rope(chain, number) for chain, number in zip(chains, ids, strict=True)],
        "crossings": [_make_crossing(one, ids) for one in crossings or ()],
        "crossings_listed": crossings is not None,
        "up": _make_place(model.up),
        "confidence": float(model.confidence),
        "unexplained": math.nan if track is None else track.unexplained,
        "doubts": [_make_doubt(one, []) for one in model.doubts],
        "warnings": [_make_warning(one, ids) for one in model.warnings],
        "events": [_make_event(one) for one in (() if track is None else track.events)],
    }


def make_no_ropes(header: Message, reason: str) -> Message:
    """Return a strand_msgs/Ropes of an image that gave no answer, with the reason."""
    doubt = {"kind": "no rope", "amount": math.nan, "text": reason}
    return {"header": header, "confidence": math.nan, "unexplained": math.nan, "warnings": [doubt]}


def make_status(level: int, message: str, values: Sequence[tuple[str, object]]) -> Message:
    """Return a diagnostic_msgs/DiagnosticStatus."""
    pairs = [{"key": key, "value": str(value)} for key, value in values]
    return {"level": bytes([level]), "name": "strand: ropes", "message": message, "values": pairs}


def _make_rope(chain: Chain, number: int) -> Message:
    rows, columns = _UPPER
    covariance = [] if chain.covariance is None else chain.covariance[:, rows, columns].ravel().tolist()
    made = {
        "id": number,
        "label": _NO_LABEL if chain.label is None else chain.label,
        "state": RECONSTRUCTED,
        "closed": chain.closed,
        "radius": float(chain.radius),
        "radius_sd": float(chain.radius_sd),
        "length": float(chain.length),
        "confidence": float(chain.confidence),
        "first_hidden": chain.hidden_ends[0],
        "last_hidden": chain.hidden_ends[1],
        "points": [_make_place(node) for node in chain.points],
        "s": chain.arc_length.tolist(),
        "covariance": covariance,
        "seen": _describe_nodes(chain).tolist(),
        "doubts": [_make_doubt(one, [number]) for one in chain.doubts],
    }
    if isinstance(chain, TrackedRope):
        made |= {
            "state": _STATES[chain.state],
            "generation": chain.generation,
            "length_sd": float(chain.length_sd),
            "s": chain.s.tolist(),
            "velocity": chain.velocity.ravel().tolist(),
        }
    return made


def _describe_nodes(chain: Chain) -> NDArray[np.uint8]:
    """Return SEEN, BRIDGED or PREDICTED for each node."""
    seen = np.where(chain.bridged, _BRIDGED, 0).astype(np.uint8)
    if isinstance(chain, TrackedRope):
        seen[chain.predicted] = _PREDICTED
    return seen


def _make_crossing(crossing: Crossing, ids: Sequence[int]) -> Message:
    return {
        "over": ids[crossing.over[0]],
        "over_s": crossing.over[1],
        "under": ids[crossing.under[0]],
        "under_s": crossing.under[1],
        "probability": crossing.probability,
        "over_point": _make_place(crossing.point_over),
        "under_point": _make_place(crossing.point_under),
    }


def _make_doubt(doubt: Doubt, ids: Sequence[int]) -> Message:
    text = f"unsure {doubt.about}: {doubt.reason}"
    made = {"kind": doubt.kind, "amount": doubt.amount, "text": text, "ropes": list(ids)}
    return made | _make_optional_place(doubt.place)


def _make_warning(warning: ModelWarning, ids: Sequence[int]) -> Message:
    amount = math.nan if warning.amount is None else warning.amount
    about = [ids[chain] for chain in warning.chains if chain < len(ids)]
    made = {"kind": warning.kind, "amount": amount, "text": warning.message, "ropes": about}
    return made | _make_optional_place(warning.place)


def _make_event(event: Event) -> Message:
    sec, nanosec = divmod(count_nanoseconds(event.time), SECOND)
    under, under_s = event.under or (0, 0.0)
    return {
        "kind": event.kind,
        "stamp": {"sec": sec, "nanosec": nanosec},
        "rope": event.rope,
        "s": math.nan if event.s is None else event.s,
        "has_under": event.under is not None,
        "under": under,
        "under_s": under_s,
        "doubtful": event.doubtful,
    }


def _make_optional_place(place: NDArray[np.float64] | None) -> Message:
    return {"has_place": False} if place is None else {"has_place": True, "place": _make_place(place)}


def _make_place(place: NDArray[np.float64]) -> Message:
    return dict(zip("xyz", place.tolist(), strict=True))
