"""Arrays of returned values are read-only, and a caller's arrays are never shared."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from strand import Chain, View


def find_arrays(value, path="model"):
    """Yield all arrays of a value, with their places."""
    if isinstance(value, np.ndarray):
        yield path, value
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield from find_arrays(getattr(value, field.name), f"{path}.{field.name}")
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from find_arrays(item, f"{path}[{key!r}]")
    elif isinstance(value, (list, tuple)):
        for number, item in enumerate(value):
            yield from find_arrays(item, f"{path}[{number}]")


@pytest.mark.parametrize("config", [strand.Config(), strand.Config.published()])
def test_no_array_of_a_model_can_be_changed(config):
    scene = strand.synthetic.scene("loop", seed=2, views=2)
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds, config=config, keep_stages=True)
    found = dict(find_arrays(model))
    assert len(found) > 10
    assert [path for path, array in found.items() if array.flags.writeable] == []
    with pytest.raises(ValueError, match="read-only"):
        model.chains[0].points[0] = 0.0
    for name in ("tangents", "curvature", "arc_length"):
        assert not getattr(model.chains[0], name).flags.writeable


def test_no_array_of_a_view_can_be_changed():
    scene = strand.synthetic.scene("arc", views=1)
    (depth,) = scene.views
    cropped = depth.crop(scene.bounds)
    points = View(np.ones((4, 3)), np.eye(4), colors=np.zeros((4, 3)))
    moved = points.moved(np.eye(4))
    for view in (depth, cropped, points, moved, View.from_world(np.ones((4, 3)), (0, 0, 1))):
        for array in (view.points, view.pose):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 0.0
    for array in (points.colors, depth.image.depth):
        assert not array.flags.writeable


class Lent:
    """Lends its array, as tensors and data frames do."""

    def __init__(self, array):
        self.array = array

    def __array__(self, dtype=None, copy=None):
        return self.array


def give_as(kind, array, folder):
    if kind == "memmap":
        path = folder / "points.npy"
        np.save(path, array)
        lent = np.load(path, mmap_mode="r+")
        return lent, lent
    if kind == "subclass":
        return array.view(np.matrix) if array.ndim == 2 else array, array
    if kind == "lent":
        return Lent(array), array
    return array, array


@pytest.mark.parametrize("kind", ["array", "memmap", "subclass", "lent"])
def test_later_changes_of_a_callers_array_change_nothing(kind, tmp_path):
    points, theirs = give_as(kind, np.arange(12.0).reshape(4, 3), tmp_path)
    view, chain = View(points), Chain(points, 0.1)
    length = chain.length
    theirs[:] = 7.0
    assert np.array_equal(view.points, np.arange(12.0).reshape(4, 3))
    assert np.array_equal(chain.points, view.points)
    assert chain.length == length
    assert theirs.flags.writeable
