"""The camera position of the next view."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import strand
from shared.ropes import R
from strand import synthetic
from strand.ropes.doubt import Join

LINE = np.stack([np.linspace(-0.08, 0.08, 161), np.zeros(161), np.full(161, R)], axis=1)
SCENE = synthetic.scene(chains=[LINE], views=3, camera=synthetic.Camera(size=(160, 120)), seed=5)
CHAIN = strand.Chain(LINE, R)


def test_the_next_view_leaves_out_a_camera_at_the_place():
    place = LINE[80]
    poses = SCENE.poses.copy()
    poses[0, :3, 3] = place
    model = strand.Model((CHAIN,), poses, joins=(Join(place, (0,), 1.0),))
    assert np.isfinite(model.next_view()).all()
    with pytest.raises(ValueError, match="poses"):
        replace(model, poses=poses[:1]).next_view()


def test_the_next_view_sees_what_is_least_certain(paper, paper_model):
    camera = paper_model.next_view()
    place = paper_model.joins[0].place
    cameras = paper_model.poses[:, :3, 3]
    assert np.linalg.norm(camera - place) == pytest.approx(
        np.median(np.linalg.norm(cameras - place, axis=1)), rel=1e-6
    )
    assert camera[2] > 0.05, "above the table, as the other cameras are"
    # no strand within a radius of the line of sight, but for the two that cross there
    nodes = np.concatenate([chain.points for chain in paper_model.chains])
    ray = (camera - place) / np.linalg.norm(camera - place)
    along = (nodes - place) @ ray
    aside = np.linalg.norm(nodes - place - along[:, None] * ray, axis=1)
    assert (aside[along > 4.0 * R] > R).all()


def test_the_next_view_is_never_from_under_the_table(collected):
    for name in ("arc_0.3mm", "arc_0.7mm"):
        scene = collected(name)
        model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
        assert model.next_view()[2] > 0.0
