"""reconstruct(): what it promises on simulated ropes, and how it refuses what it cannot do."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from shared.ropes import R, find_warnings, sample_tube
from strand import View, config

STAGES = {
    "default": ["extract", "filter", "register", "arcs", "link", "fit", "ends"],
    "published": [
        "extract",
        "filter",
        "normals",
        "register",
        "centerline",
        "trace",
        "split",
        "reconnect",
    ],
}
# how well scaled, turned or shuffled input must give the same answer, relative to length or radius
SAME = 2e-3


@pytest.fixture(scope="module")
def scene():
    return strand.synthetic.scene("arc", seed=3)


@pytest.fixture(scope="module", params=["default", "published"])
def numbers(request):
    return strand.Config(method=request.param)


@pytest.fixture(scope="module")
def model(scene, numbers):
    return strand.reconstruct(
        scene.views, scene.radius, scene.bounds, ropes=1, config=numbers, keep_stages=True
    )


def distance_to(truth: np.ndarray, points: np.ndarray) -> np.ndarray:
    return strand.Chain(truth, 0.001).nearest(points).distance


def test_the_rope_is_found_from_end_to_end(scene, model):
    (chain,) = model.chains
    (truth,) = scene.truth
    assert chain.length == pytest.approx(strand.Chain(truth, 0.001).length, rel=0.01)
    assert distance_to(truth, chain.points).max() < 0.3 * scene.radius
    assert not chain.closed
    assert chain.radius == pytest.approx(scene.radius, rel=0.01)
    assert model.warnings == ()


def test_the_model_says_what_found_its_ropes(model, numbers, tmp_path):
    answered = numbers.method, "tubes" if numbers.method == "default" else None
    assert (model.method, model.branch) == answered
    model.save(tmp_path / "model.json")
    loaded = strand.load_model(tmp_path / "model.json")
    assert (loaded.method, loaded.branch) == answered


def test_bounds_and_radius_may_be_whole_numbers(scene, numbers):
    # in units of a radius
    views = [View.from_world(view.world_points / R, view.viewpoint / R) for view in scene.views[2:5]]
    views = [view.crop((scene.bounds[0] / R, scene.bounds[1] / R)) for view in views]
    box = [-100, -100, -100], np.array([100, 100, 100])
    answers = [
        strand.reconstruct(views, radius, bounds, ropes=1, config=numbers).chains[0].points.tobytes()
        for radius, bounds in ((1, box), (np.int32(1), box), (1.0, tuple(np.array(c, float) for c in box)))
    ]
    assert answers[0] == answers[1] == answers[2]


def test_stages_and_timings_are_all_there(scene, model, numbers):
    assert list(model.timings) == STAGES[numbers.method]
    assert all(seconds >= 0 for seconds in model.timings.values())
    stages = model.stages
    names = ("raw", "filtered", "registered") + (("normals",) if numbers.method == "published" else ())
    assert [len(stages[name]) for name in names] == [7] * len(names)
    for name in names[1:]:
        assert [rows.shape for rows in stages[name]] == [rows.shape for rows in stages["filtered"]]
    assert ("traced" in stages) == ("separation" in stages) == (numbers.method == "published")
    if numbers.method == "published":
        assert stages["traced"]
        assert list(map(len, stages["traced"])) == list(map(len, stages["separation"]))
    low, high = scene.bounds
    raw = np.concatenate(stages["raw"])
    assert ((raw >= low) & (raw <= high)).all()
    assert strand.reconstruct(scene.views, scene.radius, scene.bounds, config=numbers).stages == {}


def test_progress_hears_of_every_stage(scene, numbers):
    heard = []
    strand.reconstruct(scene.views, scene.radius, scene.bounds, config=numbers, progress=heard.append)
    assert heard == STAGES[numbers.method]


def test_registration_improves_the_reported_poses(numbers):
    off = {"given": [], "found": []}
    for seed in range(5):
        scene = strand.synthetic.scene("paper", seed=seed)
        model = strand.reconstruct(scene.views, scene.radius, scene.bounds, ropes=1, config=numbers)
        nodes = scene.truth[0]
        for given, found, true in zip(scene.poses, model.poses, scene.poses_true, strict=True):
            for name, pose in (("given", given), ("found", found)):
                motion = pose @ np.linalg.inv(true)
                moved = nodes @ motion[:3, :3].T + motion[:3, 3]
                off[name].append(np.sqrt(((moved - nodes) ** 2).sum(axis=1).mean()))
    assert np.median(off["found"]) < 0.6 * np.median(off["given"])


def test_the_answer_is_the_same_bits_for_any_number_of_threads(scene, numbers, threads):
    answers = []
    for count in (1, 2, 3):
        threads(count)
        model = strand.reconstruct(scene.views, scene.radius, scene.bounds, config=numbers)
        answers.append((model.chains[0].points.tobytes(), model.poses.tobytes()))
    assert len(set(answers)) == 1


def test_the_answer_moves_with_the_world(scene, model, numbers):
    motion = strand.pose_from_angles(0.4, -0.8, 2.0, [3.0, -5.0, 1.0])
    moved_views = [view.crop(scene.bounds).moved(motion) for view in scene.views]
    moved = strand.reconstruct(moved_views, scene.radius, ropes=1, config=numbers)
    back = (moved.chains[0].points - motion[:3, 3]) @ motion[:3, :3]
    (truth,) = scene.truth
    assert distance_to(truth, back).max() < 0.3 * scene.radius
    assert moved.chains[0].length == pytest.approx(model.chains[0].length, rel=SAME)


def test_the_answer_scales_with_the_rope(scene, model, numbers):
    factor = 3.0
    views = [View.from_world(factor * v.world_points, factor * v.viewpoint) for v in scene.views]
    low, high = scene.bounds
    poses = config.Poses(translation_sd=factor * numbers.poses.translation_sd)
    numbers = dataclasses.replace(numbers, poses=poses)
    scaled = strand.reconstruct(
        views, factor * scene.radius, (factor * low, factor * high), ropes=1, config=numbers
    )
    assert scaled.chains[0].length == pytest.approx(factor * model.chains[0].length, rel=SAME)


def test_the_order_of_points_does_not_matter(scene, model, numbers):
    rng = np.random.default_rng(0)
    views = [View(rng.permutation(view.points), view.pose) for view in scene.views]
    shuffled = strand.reconstruct(views, scene.radius, scene.bounds, ropes=1, config=numbers)
    assert shuffled.chains[0].length == pytest.approx(model.chains[0].length, rel=SAME)
    assert distance_to(model.chains[0].points, shuffled.chains[0].points).max() < 0.1 * scene.radius


def test_views_that_see_nothing_are_left_out_with_a_warning(scene, model, numbers):
    nothing = View(np.zeros((0, 3)), scene.views[0].pose)
    elsewhere = View.from_world(np.full((50, 3), 9.0), viewpoint=[9.0, 9.0, 10.0])
    lonely = View.from_world(np.array([[0.0, 0.0, 0.006]]), viewpoint=[0.0, 0.0, 1.0])
    views = [nothing, *scene.views, elsewhere, lonely]
    found = strand.reconstruct(views, scene.radius, scene.bounds, ropes=1, config=numbers)
    np.testing.assert_array_equal(found.chains[0].points, model.chains[0].points)
    assert len(found.poses) == len(views)
    np.testing.assert_array_equal(found.poses[0], nothing.pose)
    unused = find_warnings(found, "unused view")
    assert [warning.view for warning in unused] == [0, 8, 9]
    assert ["no points" in str(warning) for warning in unused] == [True, True, False]
    assert "only outliers" in str(unused[2])


def test_a_single_view_is_enough_where_it_sees_the_whole_rope(scene, numbers):
    view = scene.views[3]
    found = strand.reconstruct([view], scene.radius, scene.bounds, ropes=1, config=numbers)
    assert distance_to(scene.truth[0], found.chains[0].points).max() < scene.radius
    np.testing.assert_array_equal(found.poses[0], view.pose)


def test_several_ropes_come_longest_first(numbers):
    chains = [strand.synthetic.shape("arc", length=0.3), strand.synthetic.shape("straight", length=0.15)]
    chains[1] = chains[1] + [0.0, -0.05, 0.0]
    scene = strand.synthetic.scene(chains=chains, seed=1)
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds, config=numbers)
    assert [round(chain.length, 2) for chain in model.chains] == [0.3, 0.15]
    one = strand.reconstruct(scene.views, scene.radius, scene.bounds, ropes=1, config=numbers)
    assert len(one.chains) == 1
    (left_out,) = find_warnings(one, "count")
    assert np.linalg.norm(chains[1] - left_out.place, axis=1).min() < scene.radius
    assert left_out.amount == pytest.approx(-np.log(0.3 / 0.45), rel=0.03)
    three = strand.reconstruct(scene.views, scene.radius, scene.bounds, ropes=3, config=numbers)
    (count,) = find_warnings(three, "count")
    assert str(count) == "found fewer ropes, 2, than ropes = 3"
    assert count.amount == pytest.approx(np.log(1.5))


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"views": []}, ValueError, "views: expected at least one"),
        ({"views": View(np.zeros((1, 3)))}, TypeError, "views: expected a sequence"),
        ({"views": [np.zeros((4, 3))]}, TypeError, r"views\[0\]: expected a View"),
        ({"radius": None, "config": strand.Config.published()}, ValueError, "radius: the published method"),
        ({"radius": 0.0}, ValueError, "radius: expected a positive"),
        ({"radius": -0.004}, ValueError, "radius: expected a positive"),
        ({"radius": float("nan")}, ValueError, "radius: expected a positive"),
        (
            {"radius": "4.2mm"},
            TypeError,
            "radius: expected a number of metres, got '4.2mm'; only the command line",
        ),
        (
            {"radius": ["4.2mm"]},
            TypeError,
            "radius: expected a number of metres, got '4.2mm'; only the command line",
        ),
        ({"ropes": 0}, ValueError, "ropes: expected at least 1"),
        ({"ropes": 2**64}, ValueError, "ropes: expected at most 10000"),
        ({"ropes": 1.5}, TypeError, "ropes: expected an integer"),
        ({"ropes": True}, TypeError, "ropes: expected an integer"),
        ({"length": 0.0}, ValueError, "length: expected a positive"),
        ({"length": [0.4, float("nan")]}, ValueError, "length: expected a positive"),
        ({"length": 10**400}, ValueError, "length: expected a positive"),
        ({"length": "0.4 m"}, TypeError, "length: expected a number"),
        ({"length": True}, TypeError, "length: expected a number"),
        ({"length": []}, ValueError, "length: expected one"),
        ({"length": [[0.4]]}, ValueError, "length: expected one"),
        ({"length": [0.4, 0.3], "ropes": 3}, ValueError, "length: expected one for each of 3 ropes, got 2"),
        ({"config": {"near": 1}}, TypeError, "config: expected type Config"),
        ({"bounds": ([0.0] * 3, [0.0] * 3)}, ValueError, "bounds: expected low < high"),
        (
            {"bounds": ([8.0] * 3, [9.0] * 3)},
            strand.NotEnoughDataError,
            "no view has a point in the extraction",
        ),
        ({"radius": 1e-6}, strand.NotEnoughDataError, "is the radius right"),
    ],
)
def test_wrong_input_is_refused_by_name(scene, change, error, message):
    arguments = {"views": scene.views, "radius": scene.radius, "bounds": scene.bounds} | change
    with pytest.raises(error, match=message):
        strand.reconstruct(**arguments)


@pytest.mark.parametrize(
    "points",
    [np.zeros((500, 3)), np.linspace([0.0, 0, 0], [0.3, 0, 0], 500)],
    ids=["all points equal", "all points on a line"],
)
def test_points_without_a_surface_are_refused(points, numbers):
    view = View.from_world(points, viewpoint=[0.0, 0.0, 1.0])
    with pytest.raises(strand.NotEnoughDataError, match="views"):
        strand.reconstruct([view, view], radius=0.004, config=numbers)


@pytest.mark.parametrize("seed", range(5))
def test_points_all_over_a_box_are_refused(numbers, seed):
    cloud = np.random.default_rng(seed).uniform(-0.05, 0.05, (3000, 3))
    view = View.from_world(cloud, viewpoint=[0.0, 0.0, 1.0])
    for radius in (0.004, None) if numbers.method == "default" else (0.004,):
        with pytest.raises(strand.NotEnoughDataError, match="views"):
            strand.reconstruct([view], radius, config=numbers)


def test_a_plane_is_refused(numbers):
    across = np.random.default_rng(0).uniform(-0.1, 0.1, (2, 5000))
    view = View.from_world(np.stack([*across, np.zeros(5000)], axis=1), viewpoint=[0.0, 0.0, 1.0])
    for radius in (0.004, None) if numbers.method == "default" else (0.004,):
        with pytest.raises(strand.NotEnoughDataError, match="views"):
            strand.reconstruct([view], radius, config=numbers)


@pytest.mark.parametrize("bend", [0.03, 0.06])
@pytest.mark.parametrize("method", ["default", "published"])
def test_a_ring_closes(bend, method):
    angle = np.linspace(0, 2 * np.pi, 300)
    ring = np.stack([bend * np.cos(angle), bend * np.sin(angle), np.full(300, R)], axis=1)
    cameras = 0.4 * np.array([[0.0, -0.8, 0.8], [0.8, 0.0, 0.8], [0.0, 0.8, 0.8], [-0.8, 0.0, 0.8]])
    views = [
        strand.View.from_world(sample_tube(ring, camera, 2e-4, seed), camera)
        for seed, camera in enumerate(cameras)
    ]
    model = strand.reconstruct(views, R, config=strand.Config(method=method))
    (chain,) = model.chains
    assert chain.closed
    assert chain.length == pytest.approx(2 * np.pi * bend, rel=0.01)
    assert np.abs(np.linalg.norm(chain.points[:, :2], axis=1) - bend).max() < 0.2 * R
    steps = np.linalg.norm(np.diff(np.vstack([chain.points, chain.points[:1]]), axis=0), axis=1)
    assert steps.max() < 2.5 * np.median(steps)
