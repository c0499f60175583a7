"""Images, readings and fits that the kernels refuse."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.reconstruction.images.prepare import prepare_images
from strand.synthetic import Camera, Segmentation, scene
from strand.views.rope_images import make_rope_images

SCENE = scene("loop", seed=2, views=3, camera=Camera("zed"), mask=Segmentation())


@pytest.mark.parametrize(
    ("change", "kind", "named"),
    [
        ({"masks": []}, ValueError, "masks"),
        ({"poses": []}, ValueError, "poses"),
        ({"cameras": []}, ValueError, "cameras"),
        ({"masks": [np.ones((5, 6), dtype=bool)]}, ValueError, "masks"),
        ({"masks": [np.zeros((40, 50), dtype=bool)]}, strand.NotEnoughDataError, "masks"),
        ({"depths": [np.zeros((40, 50))]}, strand.NotEnoughDataError, "masks"),
        ({"depths": [np.full((40, 50), 1e300)]}, strand.NotEnoughDataError, "masks"),
        ({"depths": [np.ones(50)]}, ValueError, "depths"),
        ({"poses": [np.ones((4, 4))]}, ValueError, "poses"),
    ],
)
def test_wrong_images_are_refused(change, kind, named):
    arguments = {
        "depths": [np.ones((40, 50))],
        "masks": [np.ones((40, 50), dtype=bool)],
        "cameras": [((50.0, 50.0), (24.5, 19.5))],
        "poses": [np.eye(4)],
    }
    with pytest.raises(kind, match=f"^{named}"):
        strand._core.RopeImages(**{**arguments, **change}, radius=0.05)


def test_views_and_polylines_that_are_none_are_refused():
    image = prepare_images(make_rope_images(SCENE.views, SCENE.views, None), SCENE.radius)
    line = np.array([[100.0, 100.0], [150.0, 120.0]])
    with pytest.raises(ValueError, match="no view 3"):
        image.price_reading(3, [line])
    with pytest.raises(ValueError, match="no view 7"):
        image.fit([(7, [line])], None, 1, (0.01, 0.01), (None, 3.0, 0.3, 0.0), 2, False)
    for wrong in (line[:1], np.ones((4, 3))):
        with pytest.raises(ValueError, match=r"\(M, 2\)"):
            image.fit([(0, [wrong])], None, 1, (0.01, 0.01), (None, 3.0, 0.3, 0.0), 2, False)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({0: [(0, [np.array([[0.0, 0.0], [1e300, 0.0]])])]}, "hypotheses"),
        ({0: [(0, [np.array([[0.0, 0.0], [np.nan, 0.0]])])]}, "hypotheses"),
        ({0: [(0, [np.tile([[0.0, 0.0], [9e4, 0.0]], (2, 1))])]}, "hypotheses"),
        ({1: ((0.0, 0.0, 9.0), 0.5)}, "plane"),
        ({1: ((0.0, 0.0, 1.0), np.inf)}, "plane"),
        ({3: (0.0, 0.01)}, "pose_sd"),
        ({4: (None, 3.0, np.nan, 0.0)}, "errors"),
        ({4: (None, 3.0, 0.3, np.inf)}, "errors"),
        ({5: 10**9}, "iterations"),
    ],
)
def test_fits_of_mad_numbers_are_refused(change, named):
    images = prepare_images(make_rope_images(SCENE.views, SCENE.views, None), SCENE.radius)
    line = np.array([[100.0, 100.0], [150.0, 120.0]])
    given = [[(0, [line])], None, 1, (0.01, 0.01), (None, 3.0, 0.3, 0.0), 2, False]
    for place, value in change.items():
        given[place] = value
    with pytest.raises(ValueError, match=f"^{named}"):
        images.fit(*given)


def test_readings_whose_depth_jumps_to_and_fro_are_no_ropes():
    mask = np.zeros((96, 256), bool)
    mask[44:52, 20:236] = True
    depth = np.where(mask, 0.49, 0.5)
    camera, errors = ((400.0, 400.0), (128.0, 48.0)), (None, 4.0, 0.5, 0.0)
    table, sd = ((0.0, 0.0, -1.0), -0.5), (0.01, 0.01)

    def fitted(depth):
        images = strand._core.RopeImages([depth], [mask], [camera], [np.eye(4)], 0.005)
        readings = images.find_readings(1, 2, [0])
        return images.fit([(0, chains) for _, _, chains, _ in readings], table, 0, sd, errors, 5, False)

    assert fitted(depth)[0] is not None
    far = mask & (np.arange(256) // 24 % 2 == 1)
    assert set(fitted(np.where(far, 2.0, depth))) == {None}
