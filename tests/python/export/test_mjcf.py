"""Ropes in MuJoCo: models of the installed version are loaded and stepped, others compared as text."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

import strand
from shared.ropes import R, draw_circle
from strand import Chain, Model

HERE = int(mujoco.__version__.partition(".")[0])
DENSITY = 700.0
ROPE = Chain(strand.synthetic.shape("paper"), R)
RING = Chain(np.array([0.3, 0.0, R]) + draw_circle(0.05, 60, True).points, R, True)
SHORT = Chain(np.array([[0.2, 0.0, R], [0.2, 0.01, R]]), R)
MODEL = Model((ROPE, RING, SHORT), np.eye(4)[None])


def write_model(folder, model=MODEL, version=HERE, **more):
    path = folder / "ropes.xml"
    model.save_mjcf(path, version, density=DENSITY, **more)
    return path


def load_mujoco(path):
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def find_axes(model, data, number):
    """Return both ends of a rope's capsules in MuJoCo's world, and their radii."""
    name = f"rope_{number}"
    if HERE >= 4:
        rod = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_FLEX, name)
        edges = model.flex_edge[model.flex_edgeadr[rod] :][: model.flex_edgenum[rod]].tolist()
        # along the rope; the edge that closes a ring comes last
        pairs = np.array(sorted(map(sorted, edges), key=lambda pair: (pair[1] - pair[0] > 1, pair)))
        if pairs[-1, 0] == 0:
            pairs[-1] = pairs[-1, ::-1]
        places = data.flexvert_xpos[model.flex_vertadr[rod] :]
        return places[pairs[:, 0]], places[pairs[:, 1]], np.full(len(pairs), model.flex_radius[rod])
    bodies = [model.body(k).name.startswith(f"{name}_") for k in model.geom_bodyid]
    mine = np.flatnonzero(bodies)
    assert (model.geom_type[mine] == mujoco.mjtGeom.mjGEOM_CAPSULE).all()
    # their z goes against the rope
    half = -data.geom_xmat[mine].reshape(-1, 3, 3)[:, :, 2] * model.geom_size[mine, 1:2]
    return data.geom_xpos[mine] - half, data.geom_xpos[mine] + half, model.geom_size[mine, 0]


@pytest.mark.parametrize("spacing", [None, 0.02])
def test_capsules_are_where_the_ropes_are(tmp_path, spacing):
    model, data = load_mujoco(write_model(tmp_path, spacing=spacing))
    for number, chain in enumerate(MODEL.chains):
        one, other, radii = find_axes(model, data, number)
        np.testing.assert_allclose(radii, chain.radius, rtol=1e-9)
        count = max(int(chain.length / (spacing or 3 * chain.radius)), 3 if chain.closed or HERE < 4 else 2)
        assert len(one) == count
        # every capsule goes from place to place on the centreline, in order; MuJoCo 3 reads single precision
        meeting = chain.at(np.linspace(0.0, chain.length, count + 1))
        np.testing.assert_allclose(one, meeting[:-1], rtol=0, atol=1e-7)
        np.testing.assert_allclose(other, meeting[1:], rtol=0, atol=1e-7)


def test_the_mass_is_that_of_the_ropes(tmp_path):
    model, _ = load_mujoco(write_model(tmp_path))
    want = sum(DENSITY * np.pi * chain.radius**2 * chain.length for chain in MODEL.chains)
    # MuJoCo gives the bodies that carry twist a millionth of a gram each
    assert model.body_mass.sum() == pytest.approx(want, rel=1e-4)


@pytest.mark.parametrize("young", [1e5, 1e7])
def test_ropes_settle_on_a_table(tmp_path, young):
    path = write_model(tmp_path, young=young)
    scene = tmp_path / "scene.xml"
    scene.write_text(
        f'<mujoco><include file="{path.name}"/>'
        '<worldbody><geom type="plane" size="1 1 0.1"/></worldbody></mujoco>'
    )
    model, data = load_mujoco(scene)
    before = [np.concatenate(find_axes(model, data, number)[:2]) for number in range(3)]
    for _ in range(300):
        mujoco.mj_step(model, data)
    assert not any(warning.number for warning in data.warning), "unstable"
    for number, places in enumerate(before):
        after = np.concatenate(find_axes(model, data, number)[:2])
        # all lie on it already, and hardly move
        assert np.linalg.norm(after - places, axis=1).max() < 0.5 * R
        assert after[:, 2].min() > 0.8 * R
    if HERE < 4:  # its ends are two bodies: they stay together
        one, other, _ = find_axes(model, data, 1)
        np.testing.assert_allclose(one[0], other[-1], atol=0.1 * R)


def test_a_rope_rests_in_the_shape_in_which_it_was_seen(tmp_path):
    """Without weight and self-contact a rope keeps its shape, however it is bent."""
    path = write_model(tmp_path, Model((ROPE,), np.eye(4)[None]), young=1e6)
    model, data = load_mujoco(path)
    model.opt.gravity[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    places = np.concatenate(find_axes(model, data, 0)[:2])
    for _ in range(200):
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(np.concatenate(find_axes(model, data, 0)[:2]), places, atol=1e-5)


def test_version_3_has_cables_of_capsules(tmp_path):
    tree = ElementTree.parse(write_model(tmp_path, version=3)).getroot()
    assert [one.get("prefix") for one in tree.iter("composite")] == ["rope_0_", "rope_1_", "rope_2_"]
    for chain, cable in zip(MODEL.chains, tree.iter("composite"), strict=True):
        places = np.array(cable.get("vertex").split(), dtype=float).reshape(-1, 3)
        np.testing.assert_allclose(
            places, chain.at(np.linspace(0, chain.length, len(places))), rtol=0, atol=1e-11
        )
        geom = cable.find("geom")
        assert float(geom.get("size")) == pytest.approx(chain.radius)
        mass = DENSITY * np.pi * chain.radius**2 * chain.length
        assert float(geom.get("mass")) * (len(places) - 1) == pytest.approx(mass)
    (ring,) = tree.iter("connect")
    assert (ring.get("body1"), ring.get("body2")) == ("rope_1_B_first", "rope_1_B_last")
    left_out = {(one.get("body1"), one.get("body2")) for one in tree.iter("exclude")}
    assert {("rope_0_B_first", "rope_0_B_2"), ("rope_1_B_first", "rope_1_B_last")} <= left_out
    assert len(left_out) == len(list(tree.iter("exclude")))


def test_version_4_has_rods_that_keep_their_lengths(tmp_path):
    tree = ElementTree.parse(write_model(tmp_path, version=4)).getroot()
    rods = list(tree.iter("flexcomp"))
    assert [rod.get("name") for rod in rods] == ["rope_0", "rope_1", "rope_2"]
    assert {rod.get("dim") for rod in rods} == {"1"}
    assert {rod.find("edge").get("equality") for rod in rods} == {"true"}
    assert tree.find("option").get("integrator") == "discrete"
    pairs = np.array(rods[1].get("element").split(), dtype=int).reshape(-1, 2)
    assert pairs[-1].tolist() == [len(pairs) - 1, 0]
    assert (
        np.array(rods[0].get("element").split(), dtype=int).reshape(-1, 2)[-1, 1]
        == len(rods[0].get("point").split()) // 3 - 1
    )


def test_a_model_without_ropes_loads(tmp_path):
    model, _ = load_mujoco(write_model(tmp_path, Model((), np.eye(4)[None])))
    assert model.nbody == 1


def test_files_are_written_whole_or_not_at_all(tmp_path):
    path = write_model(tmp_path)
    before = path.read_bytes()
    for wrong, said in [
        ({"version": 5}, "version: expected at most 4, got 5"),
        ({"version": 2}, "version: expected at least 3, got 2"),
        ({"spacing": 2 * R}, r"spacing: expected at least 2\.5 radii, 0\.0105 m, got 0\.0084"),
        ({"spacing": -1.0}, "spacing: expected a positive number"),
        ({"density": 0.0}, "density: expected a positive number"),
        ({"young": float("nan")}, "young: expected a positive number"),
    ]:
        with pytest.raises(ValueError, match=said):
            MODEL.save_mjcf(path, **wrong)
    with pytest.raises(TypeError, match="spacing: expected a number"):
        MODEL.save_mjcf(path, spacing="1 cm")
    assert path.read_bytes() == before
    with pytest.raises(ValueError, match=r"ropes\.mjcf: expected a name that ends with \.xml"):
        MODEL.save_mjcf(tmp_path / "ropes.mjcf")
    assert [one.name for one in tmp_path.iterdir()] == ["ropes.xml"]
    MODEL.save_mjcf(str(path), young=2e6)  # a path as text; what exists is replaced
    assert path.read_bytes() != before


def test_gravity_pulls_to_the_table_of_a_camera_without_a_pose(tmp_path):
    up = np.array([0.0, -0.6, -0.8])
    level = ElementTree.parse(write_model(tmp_path)).find("option")
    assert "gravity" not in level.attrib
    # before a wall z is still up
    wall = ElementTree.parse(write_model(tmp_path, replace(MODEL, up=(1.0, 0.0, 0.0)))).find("option")
    assert "gravity" not in wall.attrib
    model, _ = load_mujoco(write_model(tmp_path, replace(MODEL, up=up)))
    assert model.opt.gravity == pytest.approx(-9.81 * up)
    # a table in a world with y up
    tabled = replace(MODEL, up=(0.0, 1.0, 0.0), table=((0.0, 1.0, 0.0), 0.0))
    model, _ = load_mujoco(write_model(tmp_path, tabled))
    assert model.opt.gravity == pytest.approx([0.0, -9.81, 0.0])
    model, _ = load_mujoco(write_model(tmp_path, gravity=(0.0, -1.6, 0.0)))
    assert model.opt.gravity == pytest.approx([0.0, -1.6, 0.0])
    with pytest.raises(ValueError, match="gravity"):
        write_model(tmp_path, gravity=(0.0, 1.0))
