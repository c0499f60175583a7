"""Ropes in USD: files are loaded back by OpenUSD itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdPhysics, UsdShade

import strand
from shared.ropes import R, draw_circle
from strand import Chain, Model
from strand.cli import main

ROPE = Chain(strand.synthetic.shape("paper"), R, label=7)
RING = Chain(np.array([0.3, 0.0, 0.003]) + draw_circle(0.05, 60, True).points, 0.003, True)
SHORT = Chain(np.array([[0.2, 0.0, R], [0.2, 0.01, R]]), R)
MODEL = Model((ROPE, RING, SHORT), np.eye(4)[None])
DENSITY, YOUNG = 700.0, 2e6
STRETCH = 3e7


def load(folder, model=MODEL, name="ropes.usda", **more):
    path = folder / name
    model.save_usd(path, **more)
    # anonymous, as USD keeps layers by their paths
    return Usd.Stage.Open(Sdf.Layer.OpenAsAnonymous(str(path)))


def get(stage, path):
    prim = stage.GetPrimAtPath(path)
    assert prim, path
    return prim


def read(prim, name):
    value = prim.GetAttribute(name).Get()
    assert value is not None, name
    return value


def read_floats(prim, name):
    return np.array(read(prim, name), dtype=float)


@pytest.mark.parametrize("spacing", [None, 0.02])
def test_curves_are_where_the_ropes_are(tmp_path, spacing):
    stage = load(tmp_path, spacing=spacing)
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdPhysics.GetStageKilogramsPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
    assert stage.GetDefaultPrim().GetPath() == "/ropes"
    for number, chain in enumerate(MODEL.chains):
        curves = UsdGeom.BasisCurves(get(stage, f"/ropes/rope_{number}/curve"))
        assert curves.GetTypeAttr().Get() == UsdGeom.Tokens.linear
        wanted = UsdGeom.Tokens.periodic if chain.closed else UsdGeom.Tokens.nonperiodic
        assert curves.GetWrapAttr().Get() == wanted
        placed = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(curves.GetPrim()))
        np.testing.assert_array_equal(placed, np.eye(4))
        points = np.array(curves.GetPointsAttr().Get(), dtype=float)
        count = max(int(chain.length / (spacing or 3 * chain.radius)), 3 if chain.closed else 2)
        assert list(curves.ComputeSegmentCounts(Usd.TimeCode.Default())) == [count]
        meeting = chain.at(np.linspace(0.0, chain.length, count + 1))
        np.testing.assert_allclose(points, meeting[: len(points)], rtol=0, atol=1e-7)
        assert chain.nearest(points).distance.max() < 1e-4
        path = np.vstack([points, points[:1]]) if chain.closed else points
        length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
        # straight segments cut bends short, the more the longer they are
        assert chain.length * (0.98 if spacing is None else 0.95) < length < chain.length + 1e-6
        assert curves.GetWidthsInterpolation() == UsdGeom.Tokens.constant
        np.testing.assert_allclose(curves.GetWidthsAttr().Get(), [2 * chain.radius], rtol=1e-6)
        low, high = np.array(curves.GetExtentAttr().Get(), dtype=float)
        np.testing.assert_allclose(low, points.min(axis=0) - chain.radius, atol=1e-7)
        np.testing.assert_allclose(high, points.max(axis=0) + chain.radius, atol=1e-7)


def test_curves_deform_as_the_draft_says(tmp_path):
    stage = load(tmp_path, density=DENSITY, young=YOUNG, stretch=STRETCH)
    for number, chain in enumerate(MODEL.chains):
        body = get(stage, f"/ropes/rope_{number}")
        assert body.GetMetadata("apiSchemas").GetAppliedItems() == ["PhysicsDeformableBodyAPI"]
        prim = get(stage, f"/ropes/rope_{number}/curve")
        applied = prim.GetMetadata("apiSchemas").GetAppliedItems()
        assert {"PhysicsCurvesDeformableSimAPI", "PhysicsCollisionAPI"} <= set(applied)
        np.testing.assert_allclose(read(prim, "physics:thicknesses"), [2 * chain.radius], rtol=1e-6)
        assert read(prim, "physics:thicknesses:elementType") == "constant"
        # a simulator that derives the rest shape from the points keeps the measured one
        assert not prim.HasAttribute("physics:restShapePoints")
        bound, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")
        material = bound.GetPrim()
        assert material.GetPath() == f"/ropes/rope_{number}/material"
        applied = material.GetMetadata("apiSchemas").GetAppliedItems()
        assert applied == ["PhysicsMaterialAPI", "PhysicsCurvesDeformableMaterialAPI"]
        area, moment = np.pi * chain.radius**2, 0.25 * np.pi * chain.radius**4
        for name, wanted in [
            ("density", DENSITY),
            ("curvesStretchStiffness", STRETCH * area),
            ("curvesShearStiffness", 0.9 * STRETCH / 3 * area),
            ("curvesBendStiffness", YOUNG * moment),
            ("curvesTwistStiffness", YOUNG / 3 * 2 * moment),
        ]:
            assert read(material, f"physics:{name}") == pytest.approx(wanted, rel=1e-6)
        assert UsdPhysics.MaterialAPI(material).GetDynamicFrictionAttr().Get() > 0.0


@pytest.mark.parametrize("number", [0, 1, 2])
def test_normals_lie_across_the_segment_after_them(tmp_path, number):
    chain = MODEL.chains[number]
    stage = load(tmp_path)
    curves = UsdGeom.BasisCurves(get(stage, f"/ropes/rope_{number}/curve"))
    assert curves.GetNormalsInterpolation() == UsdGeom.Tokens.vertex
    points, normals = (
        np.array(one.Get(), dtype=float) for one in (curves.GetPointsAttr(), curves.GetNormalsAttr())
    )
    assert normals.shape == points.shape
    steps = np.roll(points, -1, axis=0) - points
    steps, normals = (rows if chain.closed else rows[:-1] for rows in (steps, normals))
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6)
    np.testing.assert_allclose((normals * steps).sum(axis=1), 0.0, atol=1e-7)
    # of neighbours they turn with the rope alone, over the end of a ring too
    after = np.roll(normals, -1, axis=0) if chain.closed else normals[1:]
    assert (normals[: len(after)] * after).sum(axis=1).min() > 0.4


def test_pinned_places_are_attached_to_the_world(tmp_path):
    pins = [(0, ROPE.length + 0.001), (0, 0.0), (1, 0.1)]  # as a rounded length may be
    stage = load(tmp_path, pinned=pins)
    for number, held in [(0, [0.0, ROPE.length]), (1, [0.1])]:
        pin = get(stage, f"/ropes/rope_{number}/pins")
        assert pin.GetTypeName() == "PhysicsAttachment"
        curve = f"/ropes/rope_{number}/curve"
        assert pin.GetRelationship("physics:src0").GetTargets() == [Sdf.Path(curve)]
        assert pin.GetRelationship("physics:src1").GetTargets() == [Sdf.Path("/ropes")]
        assert (read(pin, "physics:type0"), read(pin, "physics:type1")) == ("point", "xform")
        points = read_floats(get(stage, curve), "points")[list(read(pin, "physics:indices0"))]
        np.testing.assert_array_equal(read_floats(pin, "physics:coords1"), points)
        chain = MODEL.chains[number]
        assert np.linalg.norm(points - chain.at(held), axis=1).max() < 1.5 * chain.radius + 1e-6
    assert not stage.GetPrimAtPath("/ropes/rope_2/pins")
    assert not load(tmp_path).GetPrimAtPath("/ropes/rope_0/pins")


def test_the_tube_follows_the_curve(tmp_path):
    stage = load(tmp_path, tube=True)
    for number, chain in enumerate(MODEL.chains):
        # beneath the deformable body, without a collider: graphics in the draft
        mesh = UsdGeom.Mesh(get(stage, f"/ropes/rope_{number}/tube"))
        vertices, triangles = chain.tube()
        np.testing.assert_allclose(mesh.GetPointsAttr().Get(), vertices, atol=1e-6)
        assert set(mesh.GetFaceVertexCountsAttr().Get()) == {3}
        np.testing.assert_array_equal(
            np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3), triangles
        )
        assert mesh.GetSubdivisionSchemeAttr().Get() == UsdGeom.Tokens.none
        curve = UsdGeom.Imageable(get(stage, f"/ropes/rope_{number}/curve"))
        assert curve.ComputePurpose() == UsdGeom.Tokens.guide  # drawn once
    plain = load(tmp_path)
    assert not plain.GetPrimAtPath("/ropes/rope_0/tube")
    assert UsdGeom.Imageable(get(plain, "/ropes/rope_0/curve")).ComputePurpose() == UsdGeom.Tokens.default_


def test_gravity_pulls_to_the_table_of_a_camera_without_a_pose(tmp_path):
    assert not load(tmp_path).GetPrimAtPath("/ropes/scene")
    up = np.array([0.0, -0.6, -0.8])
    stage = load(tmp_path, replace(MODEL, up=up))
    scene = UsdPhysics.Scene(get(stage, "/ropes/scene"))
    np.testing.assert_allclose(scene.GetGravityDirectionAttr().Get(), -up, atol=1e-6)
    assert scene.GetGravityMagnitudeAttr().Get() == pytest.approx(9.81)
    stage = load(tmp_path, gravity=(0.0, 0.0, 0.0))
    assert UsdPhysics.Scene(get(stage, "/ropes/scene")).GetGravityMagnitudeAttr().Get() == 0.0


def test_odd_names_and_a_model_without_ropes_load(tmp_path):
    stage = load(tmp_path, name="7 Seile, schön & lang.usda", tube=True, pinned=[(0, 0.0)])
    prims = list(stage.Traverse())
    assert len(prims) == 1 + 4 * 3 + 1
    assert all(Sdf.Path.IsValidIdentifier(prim.GetName()) for prim in prims)
    empty = load(tmp_path, Model((), np.eye(4)[None]))
    assert [str(prim.GetPath()) for prim in empty.Traverse()] == ["/ropes"]


def test_files_are_written_whole_or_not_at_all(tmp_path):
    path = tmp_path / "ropes.usda"
    MODEL.save_usd(path)
    before = path.read_bytes()
    for error, wrong, said in [
        (ValueError, {"spacing": 2 * R}, r"spacing: expected at least 2\.5 radii"),
        (TypeError, {"spacing": "1 cm"}, "spacing: expected a number"),
        (ValueError, {"density": 0.0}, "density: expected a positive number"),
        (ValueError, {"young": float("nan")}, "young: expected a positive number"),
        (ValueError, {"stretch": 1e39}, r"stretch: expected at most 1e\+30"),
        (TypeError, {"tube": 16}, "tube: expected"),
        (TypeError, {"pinned": 3}, "pinned: expected a sequence of pairs"),
        (TypeError, {"pinned": [3]}, "pinned: expected a sequence of pairs"),
        (ValueError, {"pinned": [(0, 0.0, 1.0)]}, "pinned: expected pairs .* got 3 values"),
        (ValueError, {"pinned": [(3, 0.0)]}, "pinned: expected at most 2, got 3"),
        (ValueError, {"pinned": [(0, float("nan"))]}, "pinned: expected a finite number"),
        (ValueError, {"pinned": [(0, 150.0)]}, "pinned: expected an arc length of chain 0, .*, got 150"),
        (ValueError, {"pinned": [(1, -0.1)]}, "pinned: expected an arc length of chain 1, .*, got -0.1"),
        (ValueError, {"gravity": (0.0, 1.0)}, "gravity"),
    ]:
        with pytest.raises(error, match=said):
            MODEL.save_usd(path, **wrong)
    with pytest.raises(ValueError, match="pinned: expected none, as the model has no chains"):
        Model((), np.eye(4)[None]).save_usd(path, pinned=[(0, 0.0)])
    assert path.read_bytes() == before
    with pytest.raises(ValueError, match=r"ropes\.usd: expected a name that ends with \.usda"):
        MODEL.save_usd(tmp_path / "ropes.usd")
    assert [one.name for one in tmp_path.iterdir()] == ["ropes.usda"]
    MODEL.save_usd(str(path), young=2e6)  # a path as text; what exists is replaced
    assert path.read_bytes() != before


def test_save_and_the_command_line_write_usd_by_suffix(tmp_path, data):
    MODEL.save(tmp_path / "one.usda")
    MODEL.save_usd(tmp_path / "two.usda")
    assert (tmp_path / "one.usda").read_bytes() == (tmp_path / "two.usda").read_bytes()
    out = tmp_path / "found.usda"
    assert main(["reconstruct", str(data / "scenes" / "paper_mid.npz"), "-o", str(out)]) == 0
    stage = Usd.Stage.Open(str(out))
    assert len(read_floats(get(stage, "/ropes/rope_0/curve"), "points")) > 20
