"""Calls of reconstruction, models, chains and curves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import strand
from shared.harnesses import make_harness, make_rope_graph
from shared.public.scenes import (
    CHAIN,
    COLORS,
    CUBE,
    DEPTH,
    GRIPPER,
    LINE,
    MODEL,
    ON_TABLE,
    OVER,
    K,
    R,
    make_model,
    make_scene,
    make_track,
)
from shared.public.surface import Call
from strand.geometry.curve import Curve
from strand.ropes.doubt import Alternative, Doubt, Join, ModelWarning
from strand.ropes.harness import Harness, HarnessEdge, HarnessNode

UP = np.array([0.0, 0.0, 1.0])
S = np.array([0.01, 0.05])
BRANCHES = [("plug", "J", 0.3), ("J", "ecu", 0.1), ("J", "lamp", 0.2)]
NET = strand.Netlist(BRANCHES)
PLACES = LINE[::20] + 0.01
KNOTTED = np.stack(
    [np.sin(t := np.linspace(0, 6, 60)) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)],
    axis=1,
)


def list_calls(folder: Path) -> dict[str, Call]:
    """Return the calls by their names."""
    return (
        _list_functions()
        | _list_chain()
        | _list_model(folder)
        | _list_harness(folder)
        | _list_curve()
        | _list_doubts()
    )


def _list_functions() -> dict[str, Call]:
    scene, model = make_scene(), make_model()
    tabled = [strand.View.from_depth(ON_TABLE, K)]
    bounds = tuple(np.array(corner) for corner in scene.bounds)
    knots = {"points": KNOTTED, "closed": False, "direction": UP}
    return {
        "reconstruct": Call(
            strand.reconstruct,
            {
                "views": scene.views,
                "radius": R,
                "bounds": bounds,
                "ropes": 1,
                "config": strand.Config(),
                "length": 0.16,
                "previous": model,
                "keep_stages": False,
                "progress": print,
            },
            {
                "views": scene.views,
                "bounds": bounds,
                "radius": np.array([R]),
                "length": np.array([0.16]),
                "deadline": 60.0,
            },
            {"views": scene.views, "radius": R, "bounds": bounds, "branches": True, "wire": R},
        ),
        "estimate_radius": Call(strand.estimate_radius, {"views": scene.views, "bounds": bounds}),
        "find_ropes": Call(
            strand.find_ropes,
            {"views": tabled, "radius": 0.005, "bounds": CUBE},
            {"views": tabled, "radius": np.array([0.005])},
        ),
        "rope_mask": Call(
            strand.rope_mask,
            {
                "color": COLORS,
                "depth": DEPTH,
                "intrinsics": K,
                "rope_color": np.array([0.8, 0.1, 0.1]),
                "ropes": 1,
            },
        ),
        "register_views": Call(
            strand.register_views,
            {"views": scene.views, "radius": R, "bounds": bounds, "config": strand.Config()},
        ),
        "knot": Call(strand.knot, knots | {"crossings": np.empty((0, 3))}, knots),
        "knot_diagram": Call(strand.knot_diagram, knots),
        "linking_number": Call(strand.linking_number, {"a": KNOTTED, "b": KNOTTED + 0.1, "closed": True}),
        "Gripper": Call(
            strand.Gripper,
            {"opening": 0.04, "width": 0.01, "thickness": 0.008, "depth": 0.04, "clearance": 0.001},
        ),
        **{
            f"{kind}.{name}": Call(getattr(answer, name), {})
            for kind, answer in (("Knot", strand.knot(**knots)), ("Diagram", strand.knot_diagram(**knots)))
            for name in ("dt_code", "gauss_code", "pd_code", "writhe")
        },
    }


def _list_chain() -> dict[str, Call]:
    chain = make_model().chains[0]
    assert chain.curve is not None
    places = ("at", "tangent_at", "frames_at", "curvature_vector_at", "torsion_at")
    return {
        "Chain": Call(
            strand.Chain,
            {
                "points": LINE,
                "radius": R,
                "closed": False,
                "curve": None,
                "covariance": np.tile(1e-6 * np.eye(3), (len(LINE), 1, 1)),
                "points_seen": np.ones(len(LINE), int),
                "views_seen": np.ones(len(LINE), int),
                "radius_sd": 1e-5,
                "confidence": 0.5,
                "doubts": (),
                "up": UP,
                "label": 1,
                "color": np.array([0.5, 0.5, 0.5]),
                "hidden_ends": (False, False),
            },
            {"points": chain.points, "radius": R, "curve": chain.curve},
        ),
        **{f"Chain.{name}": Call(getattr(chain, name), {"s": S}, {"s": 0.05}) for name in places},
        **{
            f"Chain.{name}": Call(getattr(chain, name), {"points": PLACES})
            for name in ("nearest", "signed_distance")
        },
        "Chain.crossings": Call(CHAIN.crossings, {"direction": UP}),
        "Chain.diagram": Call(strand.Chain(KNOTTED, 0.1).diagram, {"direction": UP}),
        "Chain.interpolated": Call(
            chain.interpolated, {"values": chain.points, "s": S}, {"values": chain.points, "s": 0.05}
        ),
        "Chain.knot": Call(CHAIN.knot, {"crossings": np.empty((0, 3)), "direction": UP}),
        "Chain.min_bend_radius": Call(chain.min_bend_radius, {}),
        "Chain.resample": Call(chain.resample, {"n": 20}),
        "Chain.reversed": Call(chain.reversed, {}),
        "TrackedRope.reversed": Call(make_track().ropes[0].reversed, {}),
        "Chain.shape_error": Call(chain.shape_error, {"target": LINE}, {"target": CHAIN}),
        "Chain.tube": Call(chain.tube, {"sides": 8}),
    }


def _list_model(folder: Path) -> dict[str, Call]:
    model = make_model()
    places = {"points": PLACES}
    starts = np.tile(np.eye(4), (2, 1, 1))
    starts[:, :3, 3] = [[0.0, 0.0, 0.3], [0.1, 0.0, 0.3]]
    ends = starts.copy()
    ends[:, 2, 3] = -0.1

    def saved(name: str, suffix: str, options: dict[str, Any]) -> Call:
        def save(**given: Any) -> bytes:
            getattr(MODEL, name)(**given)
            return Path(given["path"]).read_bytes()

        return Call(save, {"path": folder / f"{name}.{suffix}", **options})

    return {
        "Model": Call(
            strand.Model,
            {
                "chains": model.chains,
                "poses": model.poses,
                "timings": {},
                "warnings": model.warnings,
                "stages": {},
                "pose_sd": model.pose_sd,
                "confidence": 0.5,
                "joins": model.joins,
                "doubts": model.doubts,
                "alternatives": model.alternatives,
                "method": "default",
                "branch": "tubes",
                "sensor": model.sensor,
                "up": UP,
                "table": (UP, 0.0),
                "stamp": 1.5,
                "harness": make_rope_graph(model.chains[0]),
            },
        ),
        "Model.nearest": Call(model.nearest, places),
        "Model.signed_distance": Call(model.signed_distance, places),
        "Model.ray_hits": Call(model.ray_hits, {"origins": PLACES, "directions": -PLACES}),
        "Model.swept_spheres": Call(
            model.swept_spheres,
            {"starts": PLACES, "ends": PLACES - 0.1, "radius": 0.01},
            {"starts": PLACES, "ends": PLACES - 0.1, "radius": np.full(len(PLACES), 0.01)},
        ),
        "Model.swept_boxes": Call(
            model.swept_boxes, {"starts": starts, "ends": ends, "half_sizes": np.array([0.01, 0.02, 0.03])}
        ),
        "Model.crossings": Call(MODEL.crossings, {"direction": UP}),
        "Model.contacts": Call(MODEL.contacts, {"distance": 0.01, "direction": UP}),
        "Model.segment_between_crossings": Call(
            MODEL.segment_between_crossings, {"chain": 0, "s": 0.02, "direction": UP}
        ),
        "Model.grasps": Call(MODEL.grasps, {"gripper": GRIPPER, "table": (UP, 0.0), "direction": UP}),
        "Model.pull_plan": Call(MODEL.pull_plan, {"direction": UP}),
        "Model.capsules": Call(MODEL.capsules, {"error": 1e-3}),
        "Model.spheres": Call(MODEL.spheres, {"error": 1e-3}),
        "Model.next_view": Call(
            model.next_view, {"workspace": strand.Box(*CUBE), "min_distance": 0.1, "count": 2}
        ),
        "Model.summary": Call(model.summary, {}),
        "Model.save": saved("save", "json", {"max_bytes": 10**8}),
        "Model.save_tube": saved("save_tube", "ply", {"sides": 8}),
        "Model.save_urdf": saved("save_urdf", "urdf", {"error": 1e-3}),
        "Model.save_usd": saved(
            "save_usd",
            "usda",
            {
                "spacing": 0.02,
                "density": 1000.0,
                "young": 1e6,
                "stretch": 1e7,
                "pinned": [(0, 0.1)],
                "tube": False,
                "gravity": np.array([0.0, 0.0, -9.81]),
            },
        ),
        "Model.save_mjcf": saved(
            "save_mjcf",
            "xml",
            {
                "version": 4,
                "spacing": 0.02,
                "density": 1000.0,
                "young": 1e6,
                "gravity": np.array([0.0, 0.0, -9.81]),
            },
        ),
        "export.curobo": Call(strand.export.curobo, {"spheres": MODEL.spheres(1e-3)}),
        "export.dismech": Call(strand.export.dismech, {"chains": MODEL.chains, "spacing": 0.02}),
        "export.elastica": Call(strand.export.elastica, {"chain": CHAIN, "spacing": 0.02}),
    }


def _list_harness(folder: Path) -> dict[str, Call]:
    harness = make_harness([(0, 1), (1, 2), (1, 3)])
    return {
        "Harness": Call(Harness, {"nodes": harness.nodes, "edges": harness.edges}),
        "Harness.path": Call(harness.path, {"a": 0, "b": 2}),
        "Harness.length": Call(harness.length, {"a": 0, "b": 2}),
        "Harness.branches_at": Call(harness.branches_at, {"node": 1}),
        "Harness.save": Call(harness.save, {"path": folder / "harness.graphml"}),
        "Harness.save_urdf": Call(harness.save_urdf, {"path": folder / "harness.urdf", "error": 1e-3}),
        "Harness.save_mjcf": Call(
            harness.save_mjcf,
            {"path": folder / "harness.xml", "spacing": 0.02, "density": 1000.0, "young": 1e6},
        ),
        "Harness.match": Call(harness.match, {"net": NET, "tolerance": 0.05}),
        "Netlist": Call(strand.Netlist, {"edges": BRANCHES, "wires": (1, 2, 3)}),
        "Harness.tree": Call(harness.tree, {"root": 1}),
        "HarnessNode": Call(
            HarnessNode,
            {"id": 0, "position": LINE[0], "covariance": 1e-6 * np.eye(3), "degree": 3, "confidence": 0.5},
        ),
        "HarnessEdge": Call(HarnessEdge, {"id": 0, "start": 1, "stop": 2, "chain": CHAIN, "wires": 2}),
        "HarnessEdge.reversed": Call(harness.edges[0].reversed, {}),
    }


def _list_curve() -> dict[str, Call]:
    curve = make_model().chains[0].curve
    assert curve is not None
    return {
        "Curve": Call(Curve, {"control": LINE[::10].copy(), "start": 0.0, "stop": 3.0}),
        "Curve.whole": Call(Curve.whole, {"control": LINE[::10].copy()}),
        "Curve.at": Call(curve.at, {"s": S}, {"s": 0.05}),
        "Curve.place_at": Call(curve.place_at, {"s": S}, {"s": 0.05}),
        "Curve.parameter_at": Call(curve.parameter_at, {"s": S}),
        "Curve.arc_length_at": Call(curve.arc_length_at, {"parameter": np.array([0.5, 1.5])}),
        "Curve.closest": Call(curve.closest, {"points": PLACES, "s": np.full(len(PLACES), 0.05)}),
        "Curve.spaced": Call(curve.spaced, {"spacing": 0.01}),
        "Curve.trimmed": Call(curve.trimmed, {"start": 0.01, "stop": 0.02}),
        "Curve.reversed": Call(curve.reversed, {}),
    }


def _list_doubts() -> dict[str, Call]:
    place = {"place": LINE[0]}
    return {
        "Join": Call(Join, place | {"chains": (0, 1), "margin": 1.0, "alternative": LINE[1]}),
        "Alternative": Call(Alternative, {"cost": 1.0, "chains": (LINE, OVER), "probability": 0.5}),
        "Doubt": Call(Doubt, place | {"kind": "end", "amount": 0.1, "about": "where", "reason": "hidden"}),
        "ModelWarning": Call(
            ModelWarning,
            place | {"kind": "branch", "message": "where", "amount": 0.1, "chains": (0, 1), "view": 0},
        ),
    }
