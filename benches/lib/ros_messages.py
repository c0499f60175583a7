"""ROS 2 messages without ROS: types of strand_msgs beside those of rosbags, filled from dictionaries."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import get_types_from_msg

from lib.bag_files import STORES

FOLDER = Path(__file__).resolve().parents[2] / "ros" / "strand_msgs" / "msg"
STORE = STORES[False]
for _path in sorted(FOLDER.glob("*.msg")):
    STORE.register(get_types_from_msg(_path.read_text(encoding="utf-8"), f"strand_msgs/msg/{_path.stem}"))


def fill_message(kind: str, values: dict[str, Any]) -> Any:
    """Return a message filled from a dictionary; missing fields keep their defaults."""
    names = dict(STORE.fielddefs[kind][1])
    assert set(values) <= set(names), (kind, set(values) - set(names))
    return STORE.types[kind](**{name: _fill_field(names[name], values.get(name)) for name in names})


def _fill_field(description: Any, value: Any) -> Any:
    node, of = description
    kind = node.name
    if kind == "NAME":
        return fill_message(of, value or {})
    if kind == "BASE":
        plain = {"string": "", "bool": False}.get(of[0], 0.0 if "float" in of[0] else 0)
        return plain if value is None else value[0] if isinstance(value, bytes) else value
    inner = of[0]
    if inner[0].name == "NAME":
        return [fill_message(inner[1], one) for one in value or []]
    if inner[1][0] == "string":
        return value or []
    number = np.dtype({"byte": "u1", "octet": "u1"}.get(inner[1][0], inner[1][0]))
    if isinstance(value, list):
        return np.array(value, dtype=number)
    return np.frombuffer(value or b"", dtype=number)


def send(message: Any) -> Any:
    """Return a message as another program receives it."""
    kind = message.__msgtype__
    return STORE.deserialize_cdr(STORE.serialize_cdr(message, kind), kind)
