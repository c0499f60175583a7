"""Parameters are checked when the node starts."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from strand_ros.parameters import PARAMETERS, read_settings

README = Path(__file__).resolve().parents[3] / "ros" / "README.md"


def test_defaults_are_accepted_and_mean_unknown():
    settings = read_settings({})
    assert settings.known == {"radius": None, "ropes": None, "length": None}
    assert (settings.needed, settings.bounds, settings.depth_scale) == (("color",), None, None)


def test_what_is_given_reaches_strand():
    settings = read_settings(
        {
            "mode": "reconstruct",
            "radius": 0.004,
            "ropes": 2,
            "lengths": [0.5, 0.7],
            "bounds": [0.0, 0.0, 0.0, 1.0, 1.0, 0.1],
            "rope_color": [255, 0, 0],
            "use_occluders": True,
        }
    )
    assert settings.known == {"radius": 0.004, "ropes": 2, "length": [0.5, 0.7]}
    assert settings.bounds.high.tolist() == [1.0, 1.0, 0.1]
    assert (settings.needed, settings.rope_color) == (("color", "occluders"), (255, 0, 0))
    assert read_settings({"lengths": [0.5]}).known["length"] == 0.5


@pytest.mark.parametrize(
    ("changed", "error"),
    [
        ({"mode": "follow"}, "mode: expected track or reconstruct, got 'follow'"),
        ({"radius": -0.1}, "radius: expected 0 to 0.1, got -0.1"),
        ({"radius": float("nan")}, "radius: expected 0 to 0.1, got nan"),
        ({"queue": 0}, "queue: expected 1 to 300, got 0"),
        ({"bounds": [0.0]}, "bounds: expected 6 numbers, got 1"),
        ({"bounds": [1.0] * 6}, "bounds: expected low < high"),
        ({"bounds": [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]}, "bounds: expected reconstruct along with it"),
        ({"rope_color": [1, 2]}, r"rope_color: expected 3 numbers from 0 to 255, got \[1, 2\]"),
        ({"rope_color": [1, 2, 3], "use_color": False, "use_mask": True}, "rope_color: expected use_color"),
        ({"rope_color": [1, 2, 3], "use_mask": True}, "rope_color: expected no use_mask"),
        ({"use_color": False}, "mode: expected use_color or use_mask along with track"),
        ({"ropes": 3, "lengths": [0.5, 0.7]}, "lengths: expected one length or 3"),
        ({"lengths": [-0.5]}, "lengths: expected a positive number, got -0.5"),
        ({"nodes": 3}, "nodes: no such parameter"),
    ],
)
def test_nonsense_is_refused(changed, error):
    with pytest.raises(ValueError, match=error):
        read_settings(changed)


@pytest.mark.parametrize("one", PARAMETERS, ids=lambda one: one.name)
def test_parameters_have_a_type_and_a_range_that_holds_the_default(one):
    # ROS tells the type of a list by its entries
    assert isinstance(one.default, (bool, str, int, float)) or len(one.default) > 0
    assert (one.least is None) == (one.most is None)
    if one.least is not None:
        assert one.least <= one.default <= one.most


def test_the_page_lists_all_parameters_with_their_defaults_and_ranges():
    rows = re.findall(r"^\| `(\w+)` \| `(.+?)`(.*?) \| (.*) \|$", README.read_text("utf-8"), re.MULTILINE)
    assert {name: said for name, *said in rows} == {
        one.name: [
            json.dumps(one.default).strip('"') or '""',
            "" if one.least is None else f", {one.least:g} to {one.most:g}",
            one.description,
        ]
        for one in PARAMETERS
    }
