"""Tests of counts, accuracies and tables of text."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from shared.ropes import make_zigzags
from strand import Chain, Model
from strand.report import tables
from strand.ropes.crossings import NOT_LISTED
from strand.ropes.doubt import Doubt

LINE = np.stack([np.linspace(0.0, 0.2, 41), np.zeros(41), np.zeros(41)], axis=1)
# no point is at the camera, which would be a pixel without a return
SEEN = strand.View(LINE + np.array([0.0, 0.0, 1.0]))
RADIUS = 0.004


def make_model(*lines, **stages):
    chains = tuple(Chain(line, RADIUS) for line in lines)
    method, branch = ("default", "tubes") if "arcs" in stages else ("published", None)
    timings = dict.fromkeys(tables.STAGE_ARRAYS[branch or method], 0.0015)
    return Model(chains, np.eye(4)[None], timings, (), stages, method=method, branch=branch)


def test_accuracy_of_a_shifted_chain():
    found = tables.measure_accuracy(Chain(LINE + np.array([0, 0.001, 0]), RADIUS), LINE)
    assert found.rms == pytest.approx(0.001)
    assert found.length_error == pytest.approx(0)


def test_accuracy_of_a_chain_with_a_part_missing():
    found = tables.measure_accuracy(Chain(LINE[10:], RADIUS), LINE[::-1].astype(np.float32))
    assert found.rms == pytest.approx(0, abs=1e-8)
    assert found.length_error == pytest.approx(-0.25)


def test_accuracy_samples_every_millimetre():
    # one node far from the truth, most nodes on it
    few = np.array([[0.0, 0, 0], [0.1, 0.1, 0], [0.2, 0, 0]])
    uneven = np.vstack([np.linspace(0, 1e-3, 500)[:, None] * few[1] * 10, few[1:]])
    want = tables.measure_accuracy(Chain(few, RADIUS), LINE).rms
    assert tables.measure_accuracy(Chain(uneven, RADIUS), LINE).rms == pytest.approx(want, rel=1e-6)
    # straight up to 0.1 m and down again: the mean of s squared is a third of 0.1 squared
    assert want == pytest.approx(0.1 / np.sqrt(3), rel=0.01)


@pytest.mark.parametrize(
    ("truth", "named"), [(LINE[:1], "points"), (LINE[:, :2], "truth"), (LINE * np.nan, "truth")]
)
def test_accuracy_refuses_wrong_centrelines(truth, named):
    with pytest.raises(ValueError, match=f"^{named}:"):
        tables.measure_accuracy(Chain(LINE, RADIUS), truth)


def test_stages_and_counts():
    stages = {
        "raw": (LINE, LINE[:9]),
        "filtered": (LINE, LINE[:5]),
        "normals": (LINE, LINE[:5]),
        "registered": (LINE, LINE[:5]),
        "axis_points": LINE[:40],
        "traced": (LINE[:12], LINE[:7]),
        "segments": (LINE[:6], LINE[:5], LINE[:4]),
    }
    model = make_model(LINE[:9], **stages)
    counts = tables.count_stages([SEEN, SEEN], model)
    assert [count.points_out for count in counts] == [50, 46, 46, 46, 40, 19, 15, 9]
    assert [count.points_in for count in counts] == [82, 50, 46, 46, 46, 40, 19, 15]
    assert {count.seconds for count in counts} == {0.0015}
    assert tables.count_chains(model) == (2, 3, 1)
    assert tables.describe_stages([strand.View(LINE)], model).splitlines()[-1].split() == ["total", "12.0"]


def test_stages_and_counts_of_the_default_method():
    stages = {
        "raw": (LINE, LINE[:9]),
        "filtered": (LINE, LINE[:5]),
        "registered": (LINE, LINE[:5]),
        "arcs": (LINE[:12], LINE[:7]),
        "fit": object(),
    }
    model = make_model(LINE[:9], **stages)
    assert tables.find_branch(model) == "tubes"
    assert tables.describe_stages([SEEN, SEEN], model).splitlines() == [
        "stage     points in  points out    ms",
        "extract          82          50   1.5",
        "radius                            1.5",
        "filter           50          46   1.5",
        "register         46          46   1.5",
        "arcs             46          19   1.5",
        "link                              1.5",
        "fit                               1.5",
        "ends             19           9   1.5",
        "total                            12.0",
    ]
    assert tables.describe_counts(model).splitlines() == [
        "             here",
        "arcs seen       2",
        "whole ropes     1",
    ]
    del model.timings["radius"]
    assert "radius" not in [count.name for count in tables.count_stages([], model)]


@pytest.mark.parametrize(
    ("settings", "method"), [(strand.Config(), "tubes"), (strand.Config.published(), "published")]
)
def test_every_stage_that_runs_is_known(settings, method):
    scene = strand.synthetic.scene("arc", views=3)
    radius = scene.radius if settings.method == "published" else None
    names = []
    model = strand.reconstruct(
        scene.views, radius, scene.bounds, config=settings, keep_stages=True, progress=names.append
    )
    assert tables.find_branch(model) == method
    assert names == list(model.timings) == list(tables.STAGE_ARRAYS[method])
    assert [count.name for count in tables.count_stages(scene.views, model)] == names
    assert tables.count_chains(model)[-1] == len(model.chains)


def test_stages_are_needed():
    for describe in (
        tables.find_branch,
        tables.count_chains,
        tables.describe_counts,
        lambda model: tables.count_stages([], model),
    ):
        with pytest.raises(ValueError, match="model: expected one with its stages"):
            describe(make_model(LINE))


def test_accuracy_lines_pair_the_longest_with_the_longest():
    lines = tables.describe_accuracy(make_model(LINE, LINE[:11]), [LINE[:11], LINE]).splitlines()
    assert lines == [
        "rope 0: length 200.0 mm, truth 200.0 mm (+0.00%), RMS distance from truth 0.00 mm",
        "rope 1: length 50.0 mm, truth 50.0 mm (+0.00%), RMS distance from truth 0.00 mm",
    ]


def test_tables_line_up():
    model = Model(
        (Chain(LINE, RADIUS), Chain(LINE[:9], RADIUS, closed=True)), np.eye(4)[None], {"extract": 1.0}
    )
    assert tables.describe_chains(model).splitlines() == [
        "chain  length / mm  nodes  radius / mm    ends",
        "0            200.0     41         4.00    open",
        "1             80.0      9         4.00  closed",
    ]
    assert tables.describe_timings(model).splitlines() == [
        "stage        ms",
        "extract  1000.0",
        "total    1000.0",
    ]


def test_chains_with_confidence():
    doubts = [Doubt(kind, 0.1, "it", "why") for kind in ("left out", "end", "end", "join", "range")]
    chains = (
        Chain(LINE, RADIUS, confidence=0.5, doubts=doubts),
        Chain(LINE[:9], RADIUS, closed=True, confidence=0.987, doubts=doubts[1:4]),
        Chain(LINE[:3], RADIUS, confidence=0.99),
    )
    model = Model(chains, np.eye(4)[None], confidence=0.49)
    assert tables.describe_chains(model).splitlines() == [
        "chain  length / mm  nodes  radius / mm    ends  confidence  doubts",
        "0            200.0     41         4.00    open        0.50  left out, end, +2",
        "1             80.0      9         4.00  closed        0.98  end, join",
        "2             10.0      3         4.00    open        0.99",
    ]
    assert tables.describe_confidence(model) == (
        "Do not act on it: the ropes run as the chains say with probability 0.49."
    )
    assert tables.describe_confidence(make_model(LINE)).startswith("Check it: ")


def test_crossings_that_are_too_many_to_list_are_not_passed_over_in_silence():
    assert tables.describe_crossings(make_zigzags(200)) == NOT_LISTED
