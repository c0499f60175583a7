"""Plots in notebooks."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest

import strand
from shared.ropes import draw_circle
from strand.ropes.doubt import Doubt

ATTACK = "<script>alert(1)</script>"


def parse_svg(html):
    """Return the parsed plot; raise if it is not well-formed."""
    return ElementTree.fromstring(html.replace("<br>", "<br/>")).find("svg")


def test_a_chain_is_drawn_in_the_plane_in_which_it_lies():
    line = np.array([[0.0, 0.1, 0.0], [0.0, 0.3, 0.0], [0.0, 0.3, 0.1]])
    html = strand.Chain(line, 0.004)._repr_html_()
    svg = parse_svg(html)
    assert svg.find("title").text == "y to the right, z up; 200 mm across"
    points = [tuple(map(float, p.split(","))) for p in svg.find("polyline").get("points").split()]
    assert points == [(12.0, 130.0), (248.0, 130.0), (248.0, 12.0)]
    assert "Chain(300.0 mm" in html


def test_a_camera_without_a_pose_is_drawn_as_it_sees():
    line = np.array([[0.0, 0.0, 0.5], [0.2, 0.0, 0.5], [0.2, 0.1, 0.5]])
    model = strand.Model((strand.Chain(line, 0.004),), np.eye(4)[None], up=(0.0, 0.0, -1.0))
    svg = parse_svg(model._repr_html_())
    assert svg.find("title").text == "x to the right, y down; 200 mm across"
    points = [tuple(map(float, p.split(","))) for p in svg.find("polyline").get("points").split()]
    assert points == [(12.0, 12.0), (248.0, 12.0), (248.0, 130.0)]


def test_a_model_is_drawn_with_its_doubts():
    doubts = tuple(Doubt("end", 0.1, ATTACK, ATTACK, [0.0, 0.01 * i, 0.0]) for i in range(7))
    chains = (draw_circle(0.05, 40, True), draw_circle(0.03, 40, False))
    html = strand.Model(chains, np.eye(4)[None], doubts=doubts, confidence=0.5)._repr_html_()
    assert len(parse_svg(html).findall("polyline")) == 2
    assert len(parse_svg(html).findall("circle")) == 7
    assert "<script" not in html
    assert html.count("&lt;script") == 10
    assert "and 2 more doubts" in html
    assert "confidence: 0.50" in html


@pytest.mark.parametrize(
    "chains",
    [
        (),
        (strand.Chain([[0.0, 0, 0], [1e-9, 0, 0]], 1e-3),),
        (strand.Chain([[-1e75, 0, 0], [1e75, 0, 0]], 1e-3),),
        (strand.Chain(np.random.default_rng(0).normal(size=(50_000, 3)), 1e-3),),
        (draw_circle(0.05, 40, True),) * 100,
    ],
)
def test_odd_models_are_shown_too(chains):
    html = strand.Model(chains, np.empty((0, 4, 4)))._repr_html_()
    assert len(html) < 60_000
    assert "nan" not in html
    assert ("<svg" in html) == bool(chains)
