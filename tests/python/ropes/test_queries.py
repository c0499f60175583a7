"""Queries against tubes: brute force in NumPy, meshes in Open3D, invariances, wrong arguments."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import open3d as o3d
import pytest

import strand
from shared.ropes import draw_circle, make_smooth_chain
from shared.tubes import (
    NO_POSES,
    SEEDS,
    draw_near_nodes,
    draw_random_model,
    draw_random_motion,
    draw_rope_along_x,
    measure_by_brute_force,
    place_along,
)
from strand import Chain, Model
from strand.geometry.curve import Curve


@pytest.mark.parametrize("seed", SEEDS)
def test_signed_distances_and_nearest_places_are_those_of_brute_force(seed):
    model, rng = draw_random_model(seed)
    points = np.concatenate([0.1 * rng.normal(size=(400, 3)), *(chain.points for chain in model.chains)])
    expected = measure_by_brute_force(model.chains, points)
    got = model.signed_distance(points)
    np.testing.assert_allclose(got, expected.min(axis=0), atol=1e-15)
    assert (got < 0).any()
    assert (got > 0).any()
    for chain, mine in zip(model.chains, expected, strict=True):
        np.testing.assert_allclose(chain.signed_distance(points), mine, atol=1e-15)
    near = model.nearest(points)
    radii = np.array([chain.radius for chain in model.chains])[near.chain]
    np.testing.assert_allclose(near.distance - radii, expected.min(axis=0), atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(points - near.point, axis=1), near.distance, atol=1e-15)
    for number, chain in enumerate(model.chains):
        mine = near.chain == number
        np.testing.assert_allclose(chain.at(near.s[mine]), near.point[mine], atol=1e-14)
        assert (near.s[mine] >= 0).all()
        assert (near.s[mine] <= chain.length * (1 + 1e-12)).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_rays_stop_where_brute_force_says_that_surfaces_are(seed):
    model, rng = draw_random_model(seed)
    origins = 0.08 * rng.normal(size=(300, 3))
    directions = draw_near_nodes(model, rng, 300, 0.01) - origins
    directions[:20] = np.eye(3)[rng.integers(0, 3, 20)] * 7
    hits = model.ray_hits(origins, directions)
    units = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    met = np.isfinite(hits.distance)
    assert 10 < met.sum() < 300
    farthest = np.where(met, hits.distance, 1.0)
    ends = origins + farthest[:, None] * units
    on_the_way = place_along(origins, ends, np.linspace(0.0, 1.0, 100, endpoint=False)[:, None])
    apart = np.array([measure_by_brute_force(model.chains, places).min(axis=0) for places in on_the_way])
    inside = apart[0] <= 0
    np.testing.assert_array_equal(hits.distance[inside], 0.0)
    assert (hits.distance[~inside] > 0).all()
    assert (apart[:, ~inside] > -1e-12).all()
    outside = met & ~inside
    each = measure_by_brute_force(model.chains, ends[outside])
    of_chain = each[hits.chain[outside], np.arange(outside.sum())]
    np.testing.assert_allclose(of_chain, 0.0, atol=1e-12)
    feet = np.array(
        [model.chains[c].at(s) for c, s in zip(hits.chain[outside], hits.s[outside], strict=True)]
    )
    radii = np.array([chain.radius for chain in model.chains])[hits.chain[outside]]
    np.testing.assert_allclose(feet + radii[:, None] * hits.normal[outside], ends[outside], atol=1e-12)
    assert ((hits.normal[outside] * units[outside]).sum(axis=1) < 1e-6).all()
    np.testing.assert_allclose(np.linalg.norm(hits.normal[met], axis=1), 1.0, atol=1e-12)
    assert (hits.chain[~met] == -1).all()
    assert np.isnan(hits.s[~met]).all()
    assert np.isnan(hits.normal[~met]).all()


@pytest.mark.parametrize("shape", ["ring", "rope"])
def test_answers_are_those_of_open3d_on_the_mesh_of_the_tube(shape):
    if shape == "ring":
        t = np.linspace(0.0, 2 * np.pi, 240, endpoint=False)
        knot = np.stack(
            [np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=1
        )
        chain = Chain(0.02 * knot, 0.004, closed=True)
    else:
        chain = Chain(strand.synthetic.random_ropes(1, 1, seed=3)[0], 0.0042)
    sides = 96
    vertices, triangles = chain.tube(sides)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(vertices.astype(np.float32), triangles.astype(np.uint32))
    model = Model((chain,), NO_POSES)
    rng = np.random.default_rng(5)
    centre = chain.points[rng.integers(0, len(chain.points), 3000)]
    points = (centre + 0.012 * rng.normal(size=(3000, 3))).astype(np.float32).astype(float)
    near = model.nearest(points)
    # the mesh of an open chain has flat ends
    ends = 0.0 if chain.closed else chain.radius
    beside = (near.s >= ends) & (near.s <= chain.length - ends)
    bends = chain.curvature.max() * np.linalg.norm(np.diff(chain.points, axis=0), axis=1).max()
    error = chain.radius * (1 - np.cos(np.pi / sides) * np.cos(bends)) + 1e-7
    assert error < 1e-4
    expected = scene.compute_signed_distance(points.astype(np.float32)).numpy()
    # inside, a strand that touches another is farther from the surface than from its own
    clear = beside & (near.distance > 0.5 * chain.radius)
    assert clear.sum() > 1000
    np.testing.assert_allclose(model.signed_distance(points)[clear], expected[clear], atol=error)
    assert (expected[clear] < 0).any()

    origins = points[model.signed_distance(points) > 1e-3]
    directions = rng.normal(size=origins.shape).astype(np.float32).astype(float)
    hits = model.ray_hits(origins, directions)
    units = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    cast = scene.cast_rays(np.hstack([origins, units]).astype(np.float32))
    steep = ((hits.normal * units).sum(axis=1) < -0.5) & (hits.s >= ends) & (hits.s <= chain.length - ends)
    assert steep.sum() > 150
    np.testing.assert_allclose(hits.distance[steep], cast["t_hit"].numpy()[steep], atol=3 * error)


@pytest.mark.parametrize("seed", range(3))
def test_answers_move_with_the_ropes(seed):
    model, rng = draw_random_model(seed)
    pose = draw_random_motion(rng)

    def moved(points):
        return points @ pose[:3, :3].T + pose[:3, 3]

    other = Model(tuple(Chain(moved(c.points), c.radius, c.closed) for c in model.chains), NO_POSES)
    starts, ends = 0.08 * rng.normal(size=(2, 100, 3))
    close = {"rtol": 0, "atol": 1e-13}
    np.testing.assert_allclose(other.signed_distance(moved(starts)), model.signed_distance(starts), **close)
    near, near_moved = model.nearest(starts), other.nearest(moved(starts))
    np.testing.assert_allclose(near_moved.distance, near.distance, **close)
    rays = model.ray_hits(starts, ends - starts)
    rays_moved = other.ray_hits(moved(starts), (ends - starts) @ pose[:3, :3].T)
    met = np.isfinite(rays.distance)
    np.testing.assert_array_equal(np.isfinite(rays_moved.distance), met)
    # rays that graze lose half of the digits
    np.testing.assert_allclose(rays_moved.distance[met], rays.distance[met], rtol=0, atol=1e-8)
    spheres = model.swept_spheres(starts, ends, 0.004)
    spheres_moved = other.swept_spheres(moved(starts), moved(ends), 0.004)
    np.testing.assert_allclose(spheres_moved.clearance, spheres.clearance, **close)
    boxes, to = (np.array([draw_random_motion(rng) for _ in range(20)]) for _ in range(2))
    half = (0.01, 0.02, 0.005)
    got, got_moved = model.swept_boxes(boxes, to, half), other.swept_boxes(pose @ boxes, pose @ to, half)
    np.testing.assert_allclose(got_moved.clearance, got.clearance, rtol=0, atol=5e-6)


def test_distant_origins_lose_nothing():
    model = draw_rope_along_x()
    origins, units = np.array([[0.03, 0.001, 1e6]]), np.array([[0.0, 0.0, -1.0]])
    hit = model.ray_hits(origins, units)
    assert hit.distance[0] == pytest.approx(1e6 - np.sqrt(0.005**2 - 0.001**2), abs=2e-10)


def test_a_chain_that_starts_and_ends_anywhere_has_round_ends_and_a_ring_has_none():
    half = draw_circle(0.05, 100, False)
    end = half.points[-1] + 0.01 * half.tangents[-1]
    assert half.signed_distance(end[None])[0] == pytest.approx(0.006, abs=1e-5)
    ring = draw_circle(0.05, 100, True)
    closing = 0.5 * (ring.points[-1] + ring.points[0])
    assert ring.signed_distance(closing[None])[0] == pytest.approx(-0.004, abs=1e-15)
    near = Model((ring,), NO_POSES).nearest(closing[None])
    assert near.s[0] == pytest.approx(ring.arc_length[-1] + 0.5 * (ring.length - ring.arc_length[-1]))


@pytest.mark.parametrize("closed", [False, True])
def test_arc_lengths_are_those_of_the_smooth_curve(closed):
    curve = Curve.whole(strand._core.fit_spline(draw_circle(0.05, 60, False).points, 0.02, 0.0))
    s = curve.spaced(0.004)
    chain = Chain(curve.at(s)[0], 0.004, closed=closed, curve=curve)
    rng = np.random.default_rng(0)
    places = rng.uniform(0, chain.length, 200)
    near = Model((chain,), NO_POSES).nearest(chain.at(places))
    assert near.distance.max() < 1e-9
    np.testing.assert_allclose(near.s, places, atol=1e-9)


def test_a_chain_and_its_model_answer_alike_for_any_number_of_points():
    chain = make_smooth_chain()
    points = chain.points[::7] + 0.01 * np.random.default_rng(4).normal(size=(len(chain.points[::7]), 3))
    near = chain.nearest(points)
    np.testing.assert_array_equal(near.point, chain.at(near.s))
    np.testing.assert_array_equal(near.distance, np.linalg.norm(points - near.point, axis=1))
    alone = [chain.nearest(point[None]) for point in points]
    for name, values in vars(Model((chain,), NO_POSES).nearest(points)).items():
        np.testing.assert_array_equal(getattr(near, name), values)
        np.testing.assert_array_equal(np.concatenate([getattr(one, name) for one in alone]), values)


def test_of_ropes_of_two_radii_the_nearer_surface_counts():
    thin = Chain(np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), 0.001)
    thick = Chain(np.array([[-1.0, 0.1, 0.0], [1.0, 0.1, 0.0]]), 0.07)
    model = Model((thin, thick), NO_POSES)
    near = model.nearest([[0.0, 0.02, 0.0]])
    assert near.chain[0] == 1
    assert near.distance[0] == pytest.approx(0.08)
    assert near.s[0] == pytest.approx(1.0)
    assert model.signed_distance([[0.0, 0.02, 0.0]])[0] == pytest.approx(0.01)


def ask_everything(model, count=1000):
    rng = np.random.default_rng(1)
    starts, ends = 0.08 * rng.normal(size=(2, count, 3))
    poses = np.array([draw_random_motion(rng) for _ in range(2 * (count // 5))])
    poses[:, :3, 3] *= 0.08
    answers = [
        model.nearest(starts),
        model.ray_hits(starts, ends - starts),
        model.swept_spheres(starts, ends, 0.003),
        model.swept_boxes(poses[::2], poses[1::2], (0.01, 0.002, 0.004)),
    ]
    return [model.signed_distance(starts), *(array for answer in answers for array in vars(answer).values())]


def test_answers_are_the_same_bits_for_any_number_of_threads(threads):
    model, _ = draw_random_model(2)
    threads(1)
    expected = ask_everything(model)
    for count in (2, 5):
        threads(count)
        for got, want in zip(ask_everything(model), expected, strict=True):
            np.testing.assert_array_equal(got, want)


def test_one_by_one_queries_have_the_same_answers():
    model, rng = draw_random_model(3)
    starts, ends = 0.08 * rng.normal(size=(2, 300, 3))
    together = model.swept_spheres(starts, ends, 0.003)
    alone = [model.swept_spheres(starts[i : i + 1], ends[i : i + 1], 0.003) for i in range(300)]
    for name, values in vars(together).items():
        np.testing.assert_array_equal(np.concatenate([getattr(one, name) for one in alone]), values)


def test_no_queries_have_no_answers():
    model, _ = draw_random_model(0)
    none = np.empty((0, 3))
    assert model.signed_distance(none).shape == (0,)
    assert model.chains[0].signed_distance(none).shape == (0,)
    assert model.nearest(none).point.shape == (0, 3)
    assert model.ray_hits(none, none).normal.shape == (0, 3)
    assert model.swept_spheres(none, none, 0.01).time.shape == (0,)
    assert model.swept_boxes(NO_POSES, NO_POSES, (1, 1, 1)).clearance.shape == (0,)


def test_without_chains_everything_is_far():
    model = Model((), NO_POSES)
    point = np.zeros((1, 3))
    assert model.signed_distance(point)[0] == np.inf
    near = model.nearest(point)
    assert (near.chain[0], near.distance[0]) == (-1, np.inf)
    assert np.isnan([near.s[0], *near.point[0]]).all()
    assert model.ray_hits(point, point + 1).distance[0] == np.inf
    for got in (
        model.swept_spheres(point, point, 1.0),
        model.swept_boxes(np.eye(4)[None], np.eye(4)[None], (1, 1, 1)),
    ):
        assert (got.time[0], got.clearance[0], got.chain[0]) == (np.inf, np.inf, -1)
        assert np.isnan(got.s[0])


POINT, POSE = np.zeros((2, 3)), np.tile(np.eye(4), (2, 1, 1))
SHEARED = POSE + np.eye(4, k=1)
BAD = np.array([[0.0, 0.0, 0.0], [0.0, np.nan, 0.0]])


@pytest.mark.parametrize(
    ("query", "arguments", "message"),
    [
        ("signed_distance", (BAD,), r"points: expected finite .* row 1"),
        ("signed_distance", (POINT + np.inf,), "points: expected finite"),
        ("signed_distance", (np.zeros(3),), r"points: expected shape \(N, 3\), got \(3,\)"),
        ("signed_distance", (np.zeros((2, 2)),), r"points: expected shape \(N, 3\), got \(2, 2\)"),
        ("nearest", (BAD,), "points: expected finite"),
        ("ray_hits", (BAD, POINT + 1), "origins: expected finite"),
        ("ray_hits", (POINT, BAD), "directions: expected finite"),
        ("ray_hits", (POINT, POINT), "directions: expected vectors that are not zero, but row 0"),
        ("ray_hits", (POINT, POINT[:1] + 1), "directions: expected one row for each of the 2 origins, got 1"),
        ("ray_hits", (POINT, np.zeros((2, 2))), r"directions: expected shape \(N, 3\)"),
        ("swept_spheres", (BAD, POINT, 0.1), "starts: expected finite"),
        ("swept_spheres", (POINT, BAD, 0.1), "ends: expected finite"),
        ("swept_spheres", (POINT, POINT[:1], 0.1), "ends: expected one row for each of the 2 starts, got 1"),
        ("swept_spheres", (POINT, POINT, -0.1), "radius: expected finite numbers >= 0, got -0.1"),
        ("swept_spheres", (POINT, POINT, np.nan), "radius: expected finite numbers >= 0, got NaN"),
        ("swept_spheres", (POINT, POINT, [0.1]), "radius: expected one row for each of the 2 starts, got 1"),
        ("swept_spheres", (POINT, POINT, np.zeros((2, 1))), r"radius: expected shape \(\) or \(N,\)"),
        ("swept_boxes", (POSE[0], POSE, (1, 1, 1)), r"starts: expected shape \(N, 4, 4\), got \(4, 4\)"),
        ("swept_boxes", (POSE, SHEARED, (1, 1, 1)), r"ends\[0\]: expected a rigid motion, but"),
        ("swept_boxes", (POSE, POSE + np.nan, (1, 1, 1)), r"ends\[0\]: expected a rigid motion, but"),
        ("swept_boxes", (POSE, POSE[:1], (1, 1, 1)), "ends: expected one row for each of the 2 starts"),
        ("swept_boxes", (POSE, POSE, (1, -1, 1)), "half_sizes: expected finite numbers >= 0, got -1"),
        ("swept_boxes", (POSE, POSE, (1, np.inf, 1)), "half_sizes: expected finite"),
        ("swept_boxes", (POSE, POSE, (1, 1)), r"half_sizes: expected shape \(3,\) or \(N, 3\), got \(2,\)"),
        ("swept_boxes", (POSE, POSE, np.ones((3, 3))), "half_sizes: expected one row for each of the 2"),
    ],
)
def test_wrong_arguments_are_named(query, arguments, message):
    with pytest.raises(ValueError, match=message):
        getattr(draw_rope_along_x(), query)(*arguments)


def test_whole_numbers_have_no_unit():
    with pytest.raises(TypeError, match="points: expected floating point numbers"):
        draw_rope_along_x().signed_distance(np.zeros((1, 3), dtype=int))
    # a direction needs none
    hit = draw_rope_along_x().ray_hits([[0.0, 0.0, 1.0]], [[0, 0, -2]])
    assert hit.distance[0] == pytest.approx(0.995)
    np.testing.assert_allclose(hit.normal[0], [0.0, 0.0, 1.0])


def test_models_that_were_asked_are_copied_pickled_and_saved(tmp_path):
    model, rng = draw_random_model(1)
    points = 0.1 * rng.normal(size=(20, 3))
    expected = model.signed_distance(points)
    for other in (pickle.loads(pickle.dumps(model)), copy.deepcopy(model)):
        np.testing.assert_array_equal(other.signed_distance(points), expected)
    chain = pickle.loads(pickle.dumps(model.chains[0]))
    np.testing.assert_array_equal(chain.signed_distance(points), model.chains[0].signed_distance(points))
    model.save(tmp_path / "model.json")
    np.testing.assert_allclose(
        strand.load_model(tmp_path / "model.json").signed_distance(points), expected, atol=1e-12
    )


def test_tubes_of_wrong_paths_are_refused():
    nodes, arcs = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), np.array([0.0, 1.0])
    queries = strand._core.TubeQueries
    for arguments, message in [
        (([nodes], [arcs], []), "radii: expected one row"),
        (([nodes], [], [1.0]), "arc_lengths: expected one row"),
        (([nodes], [arcs[:1]], [1.0]), "arc_length: expected one row for each of the 2 nodes, got 1"),
        (([nodes], [arcs], [0.0]), "radii: expected a positive number"),
        (([nodes[[0, 0]]], [arcs], [1.0]), "nodes: expected no two equal in a row"),
        (([nodes * np.nan], [arcs], [1.0]), "nodes: expected finite"),
    ]:
        with pytest.raises(ValueError, match=message):
            queries(*arguments)
