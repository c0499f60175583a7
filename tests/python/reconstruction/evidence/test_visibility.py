"""What cameras saw of places."""

from __future__ import annotations

import numpy as np

import strand
from shared.ropes import R
from strand.reconstruction.evidence.visibility import sort_rays

UP = np.array([0.0, 0.0, 5.0 * R])


def test_cameras_see_ropes_where_they_are_and_nothing_above_them(paper):
    visibility = sort_rays(paper.views, paper.poses_true, paper.views)
    truth = paper.truth[0][::10]
    assert not visibility.free(truth, R).any()
    assert visibility.occluded(truth, R).mean() < 0.1
    above = truth + UP
    assert visibility.free(above, R).all()
    under_the_table = truth - UP
    assert visibility.occluded(under_the_table, R).all()


def test_rays_through_some_pixels_of_huge_images_show_the_same(paper, monkeypatch):
    truth = paper.truth[0][::10]
    pixels = {view.image.depth.size for view in paper.views}
    monkeypatch.setattr("strand.reconstruction.evidence.visibility._MAX_PIXELS", max(pixels) // 3)
    visibility = sort_rays(paper.views, paper.poses_true, paper.views)
    assert not visibility.free(truth, R).any()
    assert visibility.free(truth + UP, R).all()
    whole = sort_rays(
        [strand.View(view.points, view.pose) for view in paper.views], paper.poses_true, paper.views
    )
    places = np.concatenate([truth, truth + UP, truth - UP])
    assert 0.95 < (visibility.states(places, R) == whole.states(places, R)).mean() < 1.0


def test_what_cameras_saw_does_not_depend_on_the_world_frame(paper):
    motion = strand.pose_from_angles(0.4, -0.7, 2.0, [3.0, -1.0, 0.5])
    places = np.concatenate([paper.truth[0][::10], paper.truth[0][::10] + UP])
    there = sort_rays(paper.views, paper.poses_true, paper.views).states(places, R)
    poses = [motion @ pose for pose in paper.poses_true]
    moved = sort_rays(paper.views, poses, paper.views).states(places @ motion[:3, :3].T + motion[:3, 3], R)
    assert (there == moved).mean() > 0.995


def test_a_view_without_points_knows_nothing():
    view = strand.View(np.empty((0, 3)))
    visibility = sort_rays([view], [view.pose], [view])
    assert not visibility.free(np.zeros((3, 3)), R).any()
    assert visibility.occluded(np.zeros((3, 3)), R).all()
