"""Random sequences of public calls: only documented exceptions, no NaN, no contradictions.

`STRAND_CALLS=100000 pytest tests/python/contract/test_state_machine.py` makes that many calls instead.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable

import numpy as np
import pytest

import strand
from strand import View

CALLS = int(os.environ.get("STRAND_CALLS", "150"))
SIZE = (96, 72)  # pixels
DOCUMENTED = (strand.StrandError, ValueError, TypeError)


class Calls:
    """The views and models so far, and the calls that may follow."""

    def __init__(self, rng: np.random.Generator, folder) -> None:
        self.rng, self.folder = rng, folder
        self.scene = strand.synthetic.scene(
            "straight", views=2, camera=strand.synthetic.Camera(size=SIZE), seed=0
        )
        self.views: list[View] = list(self.scene.views)
        self.models: list[strand.Model] = []
        self.refused = 0

    def any(self, values):
        return values[int(self.rng.integers(len(values)))]

    def new_scene(self) -> None:
        shape = self.any(strand.synthetic.SHAPES)
        views = int(self.rng.integers(1, 4))
        seed = int(self.rng.integers(1000))
        self.scene = strand.synthetic.scene(
            shape, views=views, camera=strand.synthetic.Camera(size=SIZE), seed=seed
        )
        self.views = list(self.scene.views)

    def view_from_depth(self) -> None:
        number = int(self.rng.integers(len(self.scene.depth)))
        depth = self.scene.depth[number].copy()
        if self.rng.random() < 0.3:
            depth[self.rng.random(depth.shape) < self.rng.random()] = 0
        mask = None if self.rng.random() < 0.7 else self.rng.random(depth.shape) < self.rng.random()
        pose = self.scene.poses[number]
        scale = self.scene.depth_scale
        self.views.append(View.from_depth(depth, self.scene.intrinsics, pose, depth_scale=scale, mask=mask))

    def view_from_points(self) -> None:
        view = self.any(self.views)
        points = view.world_points[:: int(self.rng.integers(1, 50))]
        self.views.append(View.from_world(points, view.viewpoint))
        assert np.allclose(self.views[-1].world_points, points, atol=1e-12)

    def empty_view(self) -> None:
        self.views.append(View(np.empty((0, 3))))

    def crop(self) -> None:
        number = int(self.rng.integers(len(self.views)))
        self.views[number] = view = self.views[number].crop(self.scene.bounds)
        low, high = self.scene.bounds
        assert ((view.world_points >= low - 1e-9) & (view.world_points <= high + 1e-9)).all()

    def drop_views(self) -> None:
        self.views = self.views[-3:]

    def reconstruct(self) -> None:
        rng, scene = self.rng, self.scene
        arguments = {
            "radius": self.any([scene.radius, scene.radius, [scene.radius, 0.6 * scene.radius], None]),
            "bounds": self.any([scene.bounds, scene.bounds, scene.bounds, None]),
            "ropes": self.any([None, 1, 2, 5]),
            "length": self.any([None, None, 0.4, 0.1]),
            "config": self.any([None, None, strand.Config.published()]),
            "previous": self.any([None, *self.models[-1:]]),
            "deadline": self.any([None, None, 1e-9, 0.02, 10.0]),
            "keep_stages": bool(rng.random() < 0.3),
        }
        if arguments["bounds"] is None:
            arguments["deadline"] = 1e-9
        model = strand.reconstruct(self.views[-4:], **arguments)
        check_model(model)
        self.models.append(model)
        del self.models[:-5]

    def save_and_load(self) -> None:
        if self.models:
            model = self.any(self.models)
            model.save(self.folder / "model.json")
            loaded = strand.load_model(self.folder / "model.json")
            assert is_equal(model, loaded)

    def next_view(self) -> None:
        if self.models:
            assert all(np.isfinite(view.pose).all() for view in self.any(self.models).next_view())

    def ask_chains(self) -> None:
        for chain in self.any(self.models).chains if self.models else ():
            s = self.rng.uniform(-0.1, 1.1) * chain.length
            place = chain.at([s])
            near = chain.nearest(place)
            assert np.isfinite(place).all()
            assert 0.0 <= near.s[0] <= chain.length
            assert near.distance[0] < 1e-3 * chain.radius + 1e-6
            back = chain.reversed()
            assert np.allclose(back.points, chain.points[::-1])
            assert back.length == pytest.approx(chain.length, rel=1e-9)

    def threads(self) -> None:
        strand.set_num_threads(int(self.rng.integers(0, 5)))

    def wrong_call(self) -> None:
        wrong: list[Callable[[], object]] = [
            lambda: strand.reconstruct([]),
            lambda: strand.reconstruct(self.views[:1], radius=-1.0),
            lambda: strand.reconstruct(self.views[:1], 0.004, ropes=0),
            lambda: View(np.full((3, 3), np.nan)),
            lambda: View(np.zeros((3, 2))),
            lambda: strand.reconstruct(self.views[:1], 0.004, deadline=0),
        ]
        with pytest.raises((ValueError, TypeError)):
            self.any(wrong)()

    def step(self) -> str:
        kinds = [
            (self.new_scene, 2),
            (self.view_from_depth, 2),
            (self.view_from_points, 1),
            (self.empty_view, 1),
            (self.crop, 1),
            (self.drop_views, 2),
            (self.reconstruct, 5),
            (self.save_and_load, 2),
            (self.next_view, 1),
            (self.ask_chains, 2),
            (self.threads, 1),
            (self.wrong_call, 1),
        ]
        weights = np.array([weight for _, weight in kinds], dtype=float)
        call = kinds[int(self.rng.choice(len(kinds), p=weights / weights.sum()))][0]
        try:
            call()
        except DOCUMENTED:
            # only what asks for an answer may be refused
            if call not in (self.reconstruct, self.new_scene):
                raise
            self.refused += 1
        return call.__name__


def check_model(model: strand.Model) -> None:
    """Check that a model has no undocumented NaN, and that its parts agree."""
    assert model.chains
    for chain in model.chains:
        for array in (chain.points, chain.tangents, chain.curvature, chain.arc_length):
            assert np.isfinite(array).all()
            assert not array.flags.writeable
        assert chain.covariance is None or np.isfinite(chain.covariance).all()
        assert min(chain.length, chain.radius) > 0
    assert np.isfinite(model.poses).all()
    assert math.isnan(model.confidence) == (model.method == "published")
    for join in model.joins:
        assert max(join.chains) < len(model.chains)
    for warning in model.warnings:
        assert "nan" not in str(warning).lower().split()
    if not math.isnan(model.confidence):
        every = [model.confidence, *(other.probability for other in model.alternatives)]
        assert min(every) > 0.0
        assert sum(every) <= 1.0


def is_equal(some, other) -> bool:
    """Tell whether a model and its loaded copy are equal."""
    if len(some.chains) != len(other.chains):
        return False
    same = all(
        np.array_equal(a.points, b.points) and a.radius == b.radius and a.closed == b.closed
        for a, b in zip(some.chains, other.chains, strict=True)
    )
    return bool(
        same
        and np.array_equal(some.poses, other.poses)
        and np.array_equal(some.confidence, other.confidence, equal_nan=True)
        and [str(w) for w in some.warnings] == [str(w) for w in other.warnings]
        and [d.kind for d in some.doubts] == [d.kind for d in other.doubts]
    )


@pytest.mark.parametrize("seed", range(2))
def test_random_sequences_of_calls_only_do_what_is_documented(seed, tmp_path, threads):
    calls = Calls(np.random.default_rng(seed), tmp_path)
    threads(0)
    done = [calls.step() for _ in range(CALLS // 2)]
    answered = done.count("reconstruct") - calls.refused
    assert answered > 2, (answered, done)
