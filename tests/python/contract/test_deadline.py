"""reconstruct(deadline=): an answer soon after it, and a doubt that names the skipped steps."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

import strand
from shared.ropes import find_warnings
from strand.reconstruction.stages import Run

SOON = 1e-9


@pytest.fixture(scope="module", params=["points", "masks", "scattered"])
def scene(request):
    if request.param == "points":
        return strand.synthetic.scene("overhand", seed=3)
    if request.param == "masks":
        return strand.synthetic.scene("loop", seed=5, camera=strand.synthetic.Camera("d405"), views=3)
    return strand.synthetic.scene("arc", seed=2, noise=strand.synthetic.Noise(depth=3.5e-3), views=2)


def test_after_the_deadline_the_first_answer_is_taken_and_doubted(scene):
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds, deadline=SOON)
    assert len(model.chains) >= 1
    for chain in model.chains:
        assert np.isfinite(chain.points).all()
        assert np.isfinite(chain.covariance).all()
    (doubt,) = (doubt for doubt in model.doubts if doubt.kind == "deadline")
    assert doubt.reason.startswith("skipped: ")
    assert model.confidence <= math.exp(-0.5 * doubt.amount)
    (warning,) = find_warnings(model, "deadline")
    assert warning.amount == doubt.amount


def test_a_deadline_that_is_met_changes_no_bit(scene):
    free = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    held = strand.reconstruct(scene.views, scene.radius, scene.bounds, deadline=1e6)
    assert [chain.points.tobytes() for chain in held.chains] == [c.points.tobytes() for c in free.chains]
    assert held.confidence == free.confidence
    assert not find_warnings(held, "deadline")


def test_the_models_of_hurried_answers_are_saved_and_used_as_others(tmp_path):
    scene = strand.synthetic.scene("loop", seed=1)
    model = strand.reconstruct(
        scene.views, scene.radius, scene.bounds, ropes=1, deadline=SOON, keep_stages=True
    )
    model.save(tmp_path / "model.json")
    loaded = strand.load_model(tmp_path / "model.json")
    assert loaded.doubts[0].kind == model.doubts[0].kind
    assert strand.reconstruct(scene.views, scene.radius, scene.bounds, previous=model).chains
    assert np.isfinite(model.next_view()[0].pose).all()


@pytest.mark.parametrize("given", [{"radius": 0.0042}, {}, {"radius": [0.0042, 0.003]}, {"length": 0.4}])
def test_there_is_an_answer_for_any_hints(given):
    scene = strand.synthetic.scene("figure8", seed=4)
    model = strand.reconstruct(
        scene.views, given.get("radius"), scene.bounds, length=given.get("length"), deadline=SOON
    )
    assert model.chains
    assert "deadline" in {doubt.kind for doubt in model.doubts}


def test_the_published_method_has_nothing_to_skip():
    scene = strand.synthetic.scene("arc", seed=3)
    config = strand.Config.published()
    hurried = strand.reconstruct(scene.views, scene.radius, scene.bounds, config=config, deadline=SOON)
    free = strand.reconstruct(scene.views, scene.radius, scene.bounds, config=config)
    assert hurried.chains[0].points.tobytes() == free.chains[0].points.tobytes()


@pytest.mark.parametrize(
    ("deadline", "error"),
    [(0.0, ValueError), (-1.0, ValueError), (math.nan, ValueError), (math.inf, ValueError), ("1", TypeError)],
)
def test_a_deadline_is_a_positive_number_of_seconds(deadline, error):
    scene = strand.synthetic.scene("straight", views=1)
    with pytest.raises(error, match="deadline: expected a"):
        strand.reconstruct(scene.views, scene.radius, scene.bounds, deadline=deadline)


def test_competing_answers_share_the_names_of_skipped_steps():
    run = Run(None, deadline=time.monotonic() - 1.0)
    other = run.fork()
    assert [run.skips("one"), other.skips("two"), run.skips("one")] == [True, True, True]
    assert run.skipped == ["one", "two"]
    assert other.warnings is not run.warnings
    assert not Run(None).skips("one")
