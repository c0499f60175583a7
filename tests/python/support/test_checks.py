"""Tests that invalid arguments of public functions raise errors that name them."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

import strand
from strand import synthetic
from strand._core import EndObservation, fit_spline
from strand.ropes.doubt import Alternative, Doubt, Join, ModelWarning

R = 0.0042
LINE = np.stack([np.linspace(-0.08, 0.08, 161), np.zeros(161), np.full(161, R)], axis=1)
SCENE = synthetic.scene(chains=[LINE], views=3, camera=synthetic.Camera(size=(160, 120)), seed=5)
CLOUDS = [view.crop(SCENE.bounds) for view in SCENE.views]
CHAIN = strand.Chain(LINE, R)
WRONG = ["a", None, float("nan"), float("inf"), -1.5, [], np.zeros((2, 5)), np.zeros((2, 2, 2)), object(), 1j]
FIT = {
    "points": [view.world_points for view in CLOUDS],
    "viewpoints": np.array([view.viewpoint for view in CLOUDS]),
    "curves": [fit_spline(LINE, 1.5 * R, 0.0)],
    "motions": np.tile(np.eye(4), (3, 1, 1)),
    "radius": R,
    "pose_sd": (0.01, 0.002),
    "reference": 1,
    "radius_prior": (R, 1e-4),
    "band": (0.6, 0.4),
    "iterations": 3,
    "tolerance": 0.1,
    "previous": None,
    "min_bend": 1.5,
    "noise": 7e-4,
    "end_observations": (EndObservation(0, 0, LINE[0], np.array([-1.0, 0.0, 0.0]), 1e-3),),
    "fit_curves": True,
    "along_ray": False,
    "uncertainty": True,
}
FUNCTIONS = {
    "fit_tubes": (strand.fit_tubes, FIT),
    "EndObservation": (
        EndObservation,
        {"view": 0, "end": 0, "place": LINE[0], "outward": np.eye(3)[0], "sd": 1e-3},
    ),
    "Chain": (strand.Chain, {"points": LINE, "radius": R, "closed": False, "radius_sd": 1e-5}),
    "Join": (Join, {"place": LINE[0], "chains": (0,), "margin": 1.0}),
    "Doubt": (Doubt, {"kind": "end", "amount": 0.1, "about": "where", "reason": "hidden"}),
    "ModelWarning": (
        ModelWarning,
        {"kind": "branch", "message": "where", "place": LINE[0], "amount": 0.1, "chains": (0, 1), "view": 0},
    ),
    "Alternative": (Alternative, {"cost": 1.0, "chains": (LINE,)}),
    "Model": (
        strand.Model,
        {
            "chains": (CHAIN,),
            "poses": SCENE.poses,
            "timings": {},
            "joins": (),
            "doubts": (),
            "alternatives": (),
        },
    ),
    "Curve": (strand.geometry.curve.Curve, {"control": LINE[::10].copy(), "start": 0.0, "stop": 3.0}),
    "estimate_radius": (strand.estimate_radius, {"views": CLOUDS}),
    "register_views": (strand.register_views, {"views": CLOUDS, "radius": R}),
    "reconstruct": (strand.reconstruct, {"views": CLOUDS, "keep_stages": False}),
    "turntable_pose": (strand.turntable_pose, {"camera": np.eye(4), "angle": 0.1}),
    "rotation_xyz": (strand.rotation_xyz, {"rx": 0.1, "ry": 0.1, "rz": 0.1}),
    "random_ropes": (synthetic.random_ropes, {"crossings": 1, "ropes": 1, "radius": R, "seed": 0}),
    "camera_pose": (synthetic.camera_pose, {"azimuth": 0.1, "distance": 0.5, "elevation": 0.7}),
    "render_depth": (
        synthetic.render_depth,
        {"chains": [LINE], "radius": R, "intrinsics": SCENE.intrinsics, "pose": np.eye(4), "size": (16, 12)},
    ),
    "scene": (synthetic.scene, {"name": "straight", "seed": 0, "radius": R, "views": 1}),
    "Camera": (synthetic.Camera, {"device": "d435", "size": (32, 24), "depth_scale": 1e-4}),
    "Noise": (synthetic.Noise, {"depth": 0.0, "flying": 0.05, "turn": 0.01, "shift": 1e-3}),
    "Layout": (synthetic.Layout, {"distance": 0.5, "elevation": 0.7, "wall": 0.4, "bars": ()}),
    "sense": (
        partial(synthetic.sense, SCENE.depth[0] * 1e-4, step=R, depth_scale=1e-4),
        {"noise": 1e-3, "flying": 0.05, "rng": np.random.default_rng(0)},
    ),
}
SIGNED = (
    ("Join", "margin"),
    ("ModelWarning", "amount"),
    ("Alternative", "cost"),
    ("turntable_pose", "angle"),
    *(("rotation_xyz", angle) for angle in ("rx", "ry", "rz")),
    ("camera_pose", "azimuth"),
    ("camera_pose", "elevation"),
    ("Layout", "elevation"),
)
# these mean something only to their own function
ACCEPTED = {
    ("fit_tubes", "reference", "None"),
    ("fit_tubes", "radius_prior", "None"),
    ("fit_tubes", "noise", "None"),
    ("fit_tubes", "end_observations", "[]"),
    ("fit_tubes", "previous", "None"),
    ("Join", "chains", "[]"),
    ("Model", "chains", "[]"),
    ("Model", "joins", "[]"),
    ("Model", "doubts", "[]"),
    ("Model", "alternatives", "[]"),
    ("Doubt", "about", "'a'"),
    ("Doubt", "place", "None"),
    ("ModelWarning", "message", "'a'"),
    ("ModelWarning", "chains", "[]"),
    *(("ModelWarning", argument, "None") for argument in ("place", "amount", "view")),
    ("Doubt", "reason", "'a'"),
    ("Alternative", "chains", "[]"),
    ("render_depth", "chains", "[]"),
    ("scene", "name", "None"),
    ("Camera", "device", "None"),
    *(("Noise", argument, "None") for argument in ("depth", "flying")),
    *(("Layout", argument, "None") for argument in ("distance", "elevation", "wall")),
    ("Layout", "bars", "[]"),
    *((name, argument, "-1.5") for name, argument in SIGNED),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_errors_name_the_argument(name):
    function, usual = FUNCTIONS[name]
    for argument in usual:
        refused = [wrong for wrong in WRONG if (name, argument, repr(wrong)) not in ACCEPTED]
        assert len(refused) > len(WRONG) - 3
        for wrong in refused:
            with pytest.raises((TypeError, ValueError)) as caught:
                function(**{**usual, argument: wrong})
            # pyo3 puts the name of an argument that it refuses in a note
            said = str(caught.value) + " ".join(getattr(caught.value, "__notes__", ()))
            assert argument in said, f"{argument} = {wrong!r}: {said}"


@pytest.mark.parametrize(
    ("argument", "value", "match"),
    [
        ("outward", np.array([2.0, 0.0, 0.0]), "outward.*unit length"),
        ("view", -1, "view.*>= 0"),
        ("end", -1, "end.*>= 0"),
        ("sd", 0.0, "sd.*positive"),
    ],
)
def test_end_observations_are_checked(argument, value, match):
    with pytest.raises(ValueError, match=match):
        EndObservation(**{**FUNCTIONS["EndObservation"][1], argument: value})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Doubt("end", -0.1, "where", "hidden"), "amount: expected a number >= 0"),
        (lambda: Doubt("end", 0.1, 5, "hidden"), "about: expected text, got int"),
        (lambda: Doubt("end", 0.1, "where", b"hidden"), "reason: expected text, got bytes"),
        (lambda: Doubt("end", 0.1, "where", "hidden", LINE), r"place: expected shape \(3,\)"),
        (
            lambda: Doubt("ends", 0.1, "where", "hidden"),
            "kind: expected one of join, rival, end, .*ring, deadline, color, junction, wires, got 'ends'",
        ),
        (lambda: ModelWarning("magic", "where"), "kind: expected one of join, .*unused view, got 'magic'"),
        (lambda: ModelWarning("branch", "where", chains=(0, -1)), "chains: expected at least 0"),
        (lambda: ModelWarning("unused view", "where", view=1.5), "view: expected an integer"),
        (
            lambda: strand.Model((), SCENE.poses, warnings=("a",)),
            r"warnings\[0\]: expected type ModelWarning",
        ),
        (lambda: Alternative(np.inf, (LINE,)), "cost: expected a finite number"),
        (lambda: Alternative(1.0, (LINE, LINE[:, :2])), r"chains\[1\]: expected shape \(N, 3\)"),
        (lambda: Alternative(1.0, (np.full((2, 3), np.nan),)), r"chains\[0\]: expected finite"),
        (lambda: strand.Model((), SCENE.poses, doubts=("a",)), r"doubts\[0\]: expected type Doubt, got str"),
        (
            lambda: strand.Model((), SCENE.poses, alternatives=[LINE]),
            r"alternatives\[0\]: expected type Alternative, got ndarray",
        ),
    ],
)
def test_doubts_and_alternatives_that_make_no_sense_are_refused(make, message):
    with pytest.raises((TypeError, ValueError), match=message):
        make()


def test_doubts_and_alternatives_are_kept_as_tuples_of_float_arrays():
    doubt = Doubt("end", np.float64(0.5), "where", "hidden", LINE[0].tolist())
    other = Alternative(2, [LINE.tolist()])
    model = strand.Model((), SCENE.poses, doubts=[doubt], alternatives=[other])
    assert (model.doubts, model.alternatives) == ((doubt,), (other,))
    assert type(doubt.amount) is float
    assert other.cost == 2.0
    for found, given in ((doubt.place, LINE[0]), (other.chains[0], LINE)):
        np.testing.assert_array_equal(found, given)


def test_an_end_observed_by_a_view_that_is_not_there_is_refused():
    beyond = EndObservation(**{**FUNCTIONS["EndObservation"][1], "view": 3})
    with pytest.raises(ValueError, match=r"end_observations\[0\].*3 views"):
        strand.fit_tubes(**{**FIT, "end_observations": [beyond]})


def test_extraction_ranges_may_be_whole_numbers():
    radii, _ = strand.estimate_radius(CLOUDS, ([-1, -1, -1], [1, 1, 1]))
    assert radii.tolist() == strand.estimate_radius(CLOUDS)[0].tolist()


@pytest.mark.filterwarnings("error")
def test_numbers_at_the_limits_of_their_kind_raise_no_warning():
    signalling = np.full((4, 3), 0x7F800001, np.uint32).view(np.float32)
    with pytest.raises(ValueError, match="points: expected finite"):
        strand.View(signalling)
    with pytest.raises(ValueError, match="points: expected finite"):
        strand.View(np.full((4, 3), np.finfo(np.longdouble).max))
    far = Doubt("end", 0.1, "where the rope ends", "it is far", (1e308, -1e308, 0.12345))
    assert "[1e+308, -1e+308, 0.123]" in str(far)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: strand.Chain(LINE, R, color=(255, 0, 0)), "color"),
        (lambda: strand.View(LINE, colors=np.zeros(LINE.shape, dtype=int)), "colors"),
        (lambda: strand.rope_mask(np.zeros((40, 40, 3), dtype=np.uint16)), "color"),
    ],
)
def test_whole_numbers_as_colors_are_refused_with_the_ranges(make, name):
    with pytest.raises(TypeError, match=f"^{name}: expected uint8, or floats from 0 to 1, got dtype u?int"):
        make()


def mask_one(array):
    """Return a masked array with one masked element."""
    return np.ma.masked_array(array, mask=np.arange(np.size(array)).reshape(np.shape(array)) == 1)


class Quantity(np.ndarray):
    """Has units, which NumPy drops."""

    units = "mm"


RNG = np.random.default_rng(0)
CAMERA = np.diag([9.0, 9.0, 1.0])
TAKE_ARRAYS = [
    (lambda wrap: strand.View(wrap(np.ones((4, 3)))), "points"),
    (lambda wrap: strand.View(wrap(np.ones((4, 5, 3)))), "points"),
    (lambda wrap: strand.View(np.ones((4, 3)), wrap(np.eye(4))), "pose"),
    (lambda wrap: strand.View(np.ones((4, 3)), colors=wrap(np.ones((4, 3)))), "colors"),
    (lambda wrap: strand.View(np.ones((4, 3))).select(wrap(np.ones(4, dtype=bool))), "chosen"),
    (lambda wrap: strand.View(np.ones((4, 3))).crop((wrap(np.zeros(3)), np.ones(3))), "bounds"),
    (lambda wrap: strand.View.from_depth(wrap(np.ones((4, 5))), CAMERA), "depth"),
    (lambda wrap: strand.View.from_depth(np.ones((4, 5)), wrap(CAMERA)), "intrinsics"),
    (lambda wrap: strand.View.from_depth(np.ones((4, 5)), CAMERA, mask=wrap(np.ones((4, 5), int))), "mask"),
    (lambda wrap: strand.View.from_world(wrap(np.ones((4, 3))), (0, 0, 1)), "points"),
    (lambda wrap: strand.View.from_world(np.ones((4, 3)), wrap(np.ones(3))), "viewpoint"),
    (lambda wrap: strand.Box(np.zeros(3), np.ones(3)).holds(wrap(np.ones((4, 3)))), "points"),
    (lambda wrap: strand.Box(np.zeros(3), np.ones(3)).express_pose(wrap(np.eye(4))), "pose"),
    (lambda wrap: strand.Chain(wrap(LINE), R), "points"),
    (lambda wrap: CHAIN.at(wrap(np.array([0.0, 0.05]))), "s"),
    (lambda wrap: CHAIN.nearest(wrap(LINE)), "points"),
    (lambda wrap: strand.Model((CHAIN,), SCENE.poses).signed_distance(wrap(LINE)), "points"),
    (lambda wrap: strand.Model((CHAIN,), SCENE.poses).contacts(0.1, wrap(np.ones(3))), "direction"),
    (lambda wrap: strand.knot(wrap(LINE)), "points"),
    (lambda wrap: strand.reconstruct(CLOUDS, wrap(np.array([R, R]))), "radius"),
    (lambda wrap: strand.reconstruct(CLOUDS, R, length=wrap(np.array([0.4, 0.4]))), "length"),
    (lambda wrap: strand.fit_tubes(**(FIT | {"radius": wrap(np.array([R, R]))})), "radius"),
    (lambda wrap: synthetic.render_depth([LINE, LINE], wrap(np.array([R, R])), CAMERA, np.eye(4)), "radius"),
    (lambda wrap: synthetic.scene(chains=[LINE, LINE], radius=wrap(np.array([R, R]))), "radius"),
    (lambda wrap: synthetic.Noise().misplace(wrap(SCENE.poses), RNG), "poses"),
    (
        lambda wrap: synthetic.Segmentation().make_mask(
            wrap(np.ones((4, 5), bool)), np.random.default_rng(0)
        ),
        "ropes",
    ),
]


@pytest.mark.parametrize(("call", "name"), TAKE_ARRAYS)
def test_masked_arrays_are_refused_wherever_arrays_are_taken(call, name):
    for wrap in (mask_one, np.ma.masked_array, lambda array: list(mask_one(array))):
        with pytest.raises(TypeError, match=f"^{name}.*expected an array without a mask; fill or drop"):
            call(wrap)
    with pytest.raises(TypeError, match=f"^{name}.*expected plain numbers in SI units, got Quantity"):
        call(lambda array: array.view(Quantity))


def test_numbers_without_a_dimension_have_no_mask_either():
    for number in (np.ma.masked, np.ma.masked_array(0.5)):
        with pytest.raises(TypeError, match=r"^radius: expected a"):
            strand.Chain(LINE, number)


def test_matrices_count_as_their_numbers():
    found = strand.Chain(np.asmatrix(LINE), R).points
    assert type(found) is np.ndarray
    np.testing.assert_array_equal(found, LINE)
