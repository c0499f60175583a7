"""URDF: MuJoCo places its shapes where the capsules are."""

from __future__ import annotations

from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

import strand
from shared.ropes import R, draw_circle
from strand import Chain, Model

ROPE = Chain(strand.synthetic.shape("paper"), R)
# straight down: the turn of its cylinder is half a circle
DOWN = Chain(np.array([[0.3, 0.1, 0.2], [0.3, 0.1, 0.1]]), 0.006)
MODEL = Model((ROPE, draw_circle(0.05, 60, True), DOWN), np.eye(4)[None])


@pytest.mark.parametrize("error", [5e-4, 2e-3])
def test_mujoco_places_cylinders_and_balls_as_the_capsules_are(tmp_path, error):
    path = tmp_path / "ropes.urdf"
    MODEL.save_urdf(path, error)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert model.nv == 0  # all is fixed to the world
    capsules = MODEL.capsules(error)
    tubes = model.geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER
    assert tubes.sum() == len(capsules)
    np.testing.assert_allclose(data.geom_xpos[tubes], capsules.poses[:, :3, 3], atol=1e-9)
    along = data.geom_xmat[tubes].reshape(-1, 3, 3)[:, :, 2]
    np.testing.assert_allclose(along, capsules.poses[:, :3, 2], atol=1e-9)
    np.testing.assert_allclose(model.geom_size[tubes, 0], capsules.radius, rtol=1e-9)
    np.testing.assert_allclose(2.0 * model.geom_size[tubes, 1], capsules.lengths, rtol=1e-9)
    balls = model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE
    assert tubes.sum() + balls.sum() == model.ngeom
    # a ball at both ends of every cylinder
    for ends, radius in zip(np.stack([capsules.start, capsules.stop], 1), capsules.radius, strict=True):
        off = np.linalg.norm(data.geom_xpos[balls] - ends[:, None], axis=2)
        np.testing.assert_allclose(off.min(axis=1), 0.0, atol=1e-9)
        np.testing.assert_allclose(model.geom_size[balls, 0][off.argmin(axis=1)], radius)


def test_a_link_for_each_rope_with_shapes_to_see_and_to_touch(tmp_path):
    MODEL.save_urdf(tmp_path / "ropes.urdf")
    tree = ElementTree.parse(tmp_path / "ropes.urdf").getroot()
    assert [link.get("name") for link in tree.iter("link")] == ["world", "rope_0", "rope_1", "rope_2"]
    assert {joint.get("type") for joint in tree.iter("joint")} == {"fixed"}
    for link in tree.findall("link")[1:]:
        assert len(link.findall("visual")) == len(link.findall("collision")) > 2
    names = [one.get("name") for one in tree.iter("collision")]
    assert len(names) == len(set(names))


def test_wrong_names_and_errors_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"a\.xml: expected a name that ends with \.urdf"):
        MODEL.save_urdf(tmp_path / "a.xml")
    with pytest.raises(ValueError, match="error: expected a positive number"):
        MODEL.save_urdf(tmp_path / "a.urdf", 0.0)
    assert list(tmp_path.iterdir()) == []
    Model((), np.eye(4)[None]).save_urdf(tmp_path / "a.urdf")
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "a.urdf")).ngeom == 0
