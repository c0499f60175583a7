import math

import numpy as np
import open3d as o3d
import pytest
from measure import crossings
from scipy.spatial.distance import cdist

from strand import io, shapes, synthetic
from strand.shapes import SHAPES, shape
from strand.synthetic import camera_pose, render_depth, scene, sense

CROSSINGS = dict(straight=0, arc=0, s=0, coil=0, loop=1, figure8=2, overhand=3, paper=3)
RADIUS = 0.0042
PINHOLE = np.array([[212.0, 0.0, 159.5], [0.0, 212.0, 119.5], [0.0, 0.0, 1.0]])
OVERHEAD = camera_pose(0.0, 0.35, elevation=0.5 * math.pi)  # image x is world y, image y is world x


def finer(nodes, times=3):
    s = shapes.arc_lengths(nodes)
    at = np.linspace(0.0, s[-1], times * (len(nodes) - 1) + 1)
    return np.stack([np.interp(at, s, nodes[:, k]) for k in range(3)], axis=1)


def clearance(nodes, radius):
    """Least distance between places farther apart than pi * radius along the string, in radii."""
    fine = finer(nodes)
    s = shapes.arc_lengths(fine)
    apart = cdist(fine, fine)[np.abs(s[:, None] - s) > np.pi * radius]
    return apart.min(initial=np.inf) / radius


def bend_radius(nodes):
    steps = np.diff(nodes, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    cosines = np.clip((steps[:-1] * steps[1:]).sum(1) / (lengths[:-1] * lengths[1:]), -1.0, 1.0)
    return (lengths[:-1] / np.maximum(np.arccos(cosines), 1e-12)).min()


def assert_valid(name, nodes, radius):
    assert nodes[:, 2].min() >= radius
    assert clearance(nodes, radius) >= 2.0
    assert bend_radius(nodes) >= 2.5 * radius
    assert len(crossings(nodes)) == CROSSINGS[name]


# shapes


@pytest.mark.parametrize("radius", [0.002, 0.0042, 0.01])
@pytest.mark.parametrize("name", SHAPES)
def test_no_shape_cuts_through_itself(name, radius):
    length = 0.4 * radius / RADIUS
    nodes = shape(name, radius, length)
    assert_valid(name, nodes, radius)
    steps = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    assert steps.sum() == pytest.approx(length, rel=1e-3)
    assert steps == pytest.approx(min(1e-3, radius / 4), rel=0.02)
    assert np.abs(nodes[:, :2].max(0) + nodes[:, :2].min(0)).max() < 1e-12


@pytest.mark.parametrize("name", SHAPES)
def test_lengths_from_the_shortest_to_long_ones(name):
    shortest = shapes._SHORTEST[name] * RADIUS
    for length in (shortest, 0.7):
        nodes = shape(name, RADIUS, length)
        assert_valid(name, nodes, RADIUS)
        assert shapes.arc_lengths(nodes)[-1] == pytest.approx(length, rel=1e-3)
    with pytest.raises(ValueError, match=r"length: .* needs at least .* m \("):
        shape(name, RADIUS, 0.99 * shortest)


@pytest.mark.parametrize("name", SHAPES)
def test_seeds_place_and_vary_valid_shapes(name):
    for seed in range(4):
        nodes = synthetic._placed(name, RADIUS, None, np.random.default_rng(seed))
        assert_valid(name, nodes, RADIUS)
        assert shapes.arc_lengths(nodes)[-1] == pytest.approx(0.4, rel=1e-3)


@pytest.mark.parametrize("name", [name for name, count in CROSSINGS.items() if count])
def test_strands_pass_by_turns_under_and_over(name):
    nodes = shape(name)
    passes = sorted((s, z * side) for low, high, z in crossings(nodes) for s, side in ((low, -1), (high, 1)))
    heights = np.array([z for _, z in passes])
    assert (np.sign(heights) == np.tile([-1, 1], len(heights) // 2)).all()
    assert np.abs(heights) == pytest.approx(2.1 * RADIUS, rel=0.01)
    # down on the table at both ends, and wherever the string passes under
    assert nodes[[0, -1], 2] == pytest.approx(RADIUS)
    s = shapes.arc_lengths(nodes)
    assert np.interp([at for at, z in passes if z < 0], s, nodes[:, 2]) == pytest.approx(RADIUS, rel=0.01)


def order_of_crossings(nodes):
    found = crossings(nodes)
    passes = sorted((s, i) for i, (low, high, _) in enumerate(found) for s in (low, high))
    names = {i: "ABC"[k] for k, i in enumerate(dict.fromkeys(i for _, i in passes))}
    return "".join(names[i] for _, i in passes)


def test_knots():
    # alternating, so A B C A B C is the trefoil; A B B A comes apart, and C C is the circle
    assert order_of_crossings(shape("overhand")) == "ABCABC"
    assert order_of_crossings(shape("paper")) == "ABBACC"
    assert order_of_crossings(shape("figure8")) == "ABBA"


@pytest.mark.parametrize("seed", [None, 0, 1, 2, 3, 4, 5])
def test_crossings_of_the_papers_string_are_steep_and_isolated(seed):
    nodes = shape("paper") if seed is None else scene("paper", seed=seed, views=1).truth[0]
    s = shapes.arc_lengths(nodes) / RADIUS
    flat = nodes[:, :2] / RADIUS
    found = [(low / RADIUS, high / RADIUS) for low, high, _ in crossings(nodes)]

    def at(x):
        return np.array([np.interp(x, s, flat[:, k]) for k in range(2)])

    def direction(x):
        d = at(x + 0.3) - at(x - 0.3)
        return d / np.linalg.norm(d)

    assert len(found) == CROSSINGS["paper"]
    for low, high in found:
        angle = np.degrees(np.arccos(abs(direction(low) @ direction(high))))
        assert 60 <= angle <= 90
    places = np.array([at(low) for low, _ in found])
    assert cdist(places, places)[np.triu_indices(3, 1)].min() >= 7
    passes = np.sort(np.ravel(found))
    assert np.diff(passes).min() >= 8
    assert min(passes[0], s[-1] - passes[-1]) >= 7
    strands = np.abs(s[:, None] - s) > 8
    for low, high in found:
        near = (np.abs(s - low) < 6.6)[:, None] & (np.abs(s - high) < 6.6)
        strands &= ~(near | near.T)
    assert cdist(flat, flat)[strands].min() >= 5
    for end in (0, -1):
        assert np.linalg.norm(flat - flat[end], axis=1)[np.abs(s - s[end]) > 8].min() >= 5
    if seed is None:
        assert (np.sort(np.ptp(nodes[:, :2], axis=0)) <= (0.15, 0.2)).all()


def test_wrong_shapes():
    with pytest.raises(ValueError, match=r"name: expected one of straight, arc, .*paper, got 'bow'"):
        shape("bow")
    with pytest.raises(ValueError, match="radius: expected a positive"):
        shape("arc", radius=0.0)
    with pytest.raises(ValueError, match="length: expected a positive"):
        shape("arc", length=math.nan)
    with pytest.raises(TypeError, match="radius: expected a number"):
        shape("arc", radius="4.2mm")


# camera


def unproject(depth, intrinsics, pose):
    v, u = np.nonzero(depth)
    z = depth[v, u]
    camera = np.stack(
        [(u - intrinsics[0, 2]) / intrinsics[0, 0] * z, (v - intrinsics[1, 2]) / intrinsics[1, 1] * z, z], 1
    )
    return camera @ pose[:3, :3].T + pose[:3, 3]


def test_straight_tube_from_above():
    half = 0.1
    nodes = np.array([[0.0, -half, RADIUS], [0.0, 0.01, RADIUS], [0.0, half, RADIUS]])
    distance = 0.35
    K = PINHOLE.copy()
    K[:2, 2] = 160, 120  # a pixel's centre on the axis
    depth = render_depth([nodes], RADIUS, K, OVERHEAD, (321, 241), table=False)
    assert depth[depth > 0].min() == pytest.approx(distance - 2 * RADIUS, abs=1e-12)
    assert depth[120, 160] == pytest.approx(distance - 2 * RADIUS, abs=1e-12)
    # silhouette: rays that touch the tube, whose axis is at the depth `distance - RADIUS`
    wide = 212 * math.tan(math.asin(RADIUS / (distance - RADIUS)))
    assert np.ptp(np.nonzero(depth[:, 160])[0]) == 2 * math.floor(wide)
    # flat ends, turned away from the camera: the tube ends at the rim's top
    long = 212 * half / (distance - 2 * RADIUS)
    assert np.ptp(np.nonzero(depth[120])[0]) == 2 * math.floor(long)
    points = unproject(depth, K, OVERHEAD)
    assert np.hypot(points[:, 0], points[:, 2] - RADIUS) == pytest.approx(RADIUS, abs=1e-12)
    assert (points[:, 2] > RADIUS).all()
    assert np.abs(points[:, 1]).max() <= half + 1e-12


def test_the_end_is_a_flat_disc():
    nodes = np.stack([np.linspace(-0.1, 0.0, 101), np.zeros(101), np.full(101, 0.05)], axis=1)
    pose = camera_pose(0.0, 0.3, elevation=0.0)  # looks along the string's axis, from 0.05 below it
    depth = render_depth([nodes], 0.01, PINHOLE, pose, table=0)
    points = unproject(depth, PINHOLE, pose)
    assert points[:, 0].max() <= 1e-12
    disc = points[points[:, 0] > -1e-9]
    assert len(disc) == pytest.approx(np.pi * (0.01 * 212 / 0.3) ** 2, rel=0.1)
    assert np.hypot(disc[:, 1], disc[:, 2] - 0.05).max() <= 0.01


def test_every_hit_is_on_the_table_or_on_the_tube():
    nodes = shape("overhand")
    pose = camera_pose(0.7, 0.32)
    points = unproject(render_depth([nodes], RADIUS, PINHOLE, pose), PINHOLE, pose)
    table = np.abs(points[:, 2]) < 1e-12
    assert np.abs(points[table, :2]).max() <= 0.5
    tube = points[~table]
    assert len(tube) > 1000
    assert cdist(tube, finer(nodes, 10)).min(axis=1) == pytest.approx(RADIUS, rel=0.01)


def test_a_fine_string_has_no_gaps():
    angle = np.linspace(0.0, 1.9 * np.pi, 2000)
    ring = np.stack([0.08 * np.cos(angle), 0.08 * np.sin(angle), np.full(2000, RADIUS)], axis=1)
    depth = render_depth([ring], RADIUS, PINHOLE, OVERHEAD)
    towards = unproject(depth, PINHOLE, OVERHEAD)
    off = np.hypot(np.hypot(towards[:, 0], towards[:, 1]) - 0.08, towards[:, 2] - RADIUS)
    reach = np.hypot(towards[:, 0], towards[:, 1])
    turn = np.mod(np.arctan2(towards[:, 1], towards[:, 0]), 2 * np.pi)
    within = (np.abs(reach - 0.08) < 0.8 * RADIUS) & (turn > 0.05) & (turn < 1.89 * np.pi)
    assert within.sum() > 500
    assert off[within] == pytest.approx(RADIUS, rel=1e-3)


def test_chains_of_different_radii_hide_each_other():
    low = np.array([[-0.1, 0.0, 0.004], [0.1, 0.0, 0.004]])
    high = np.array([[0.0, -0.1, 0.018], [0.0, 0.1, 0.018]])
    both = render_depth([low, high], [0.004, 0.01], PINHOLE, OVERHEAD)
    alone = [render_depth([nodes], r, PINHOLE, OVERHEAD) for nodes, r in ((low, 0.004), (high, 0.01))]
    assert np.array_equal(both, np.minimum(*alone))
    assert both.min() == pytest.approx(0.35 - 0.028, abs=1e-4)


def test_strings_beside_and_behind_the_camera():
    pose = np.eye(4)
    behind = np.array([[-0.1, 0.0, -0.3], [0.1, 0.0, -0.3]])
    assert not render_depth([behind], RADIUS, PINHOLE, pose, table=0).any()
    past = np.array([[0.02, 0.0, -0.5], [0.02, 0.0, 0.5]])  # from behind the camera to in front of it
    fine = np.linspace(past[0], past[1], 1001)
    depth = render_depth([past], RADIUS, PINHOLE, pose, table=0)
    assert (depth > 0).sum() > 500
    assert np.abs(depth - render_depth([fine], RADIUS, PINHOLE, pose, table=0)).max() < 1e-9


def test_table_is_finite_and_optional():
    nodes = shape("straight", length=0.05)
    assert (render_depth([nodes], RADIUS, PINHOLE, OVERHEAD) > 0).all()
    cut = unproject(render_depth([nodes], RADIUS, PINHOLE, OVERHEAD, table=0.2), PINHOLE, OVERHEAD)
    assert 0.099 < np.abs(cut[:, :2]).max() <= 0.1
    assert (render_depth([nodes], RADIUS, PINHOLE, OVERHEAD, table=False) > 0).sum() < 300
    assert render_depth([], RADIUS, PINHOLE, OVERHEAD) == pytest.approx(0.35, abs=1e-12)


def tube_mesh(nodes, radius, sides=128):
    tangents = np.gradient(nodes, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    across = np.cross(tangents, (0.0, 0.0, 1.0))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    up = np.cross(across, tangents)
    angle = np.arange(sides) * 2 * np.pi / sides
    rings = nodes[:, None] + radius * (
        np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * up[:, None]
    )
    i = np.arange(len(nodes) - 1)[:, None] * sides
    a, b = i + np.arange(sides), i + (np.arange(sides) + 1) % sides
    faces = [
        np.stack([a, b, b + sides], -1).reshape(-1, 3),
        np.stack([a, b + sides, a + sides], -1).reshape(-1, 3),
    ]
    vertices = np.vstack([rings.reshape(-1, 3), nodes[[0, -1]]])
    for ring, middle in ((0, len(vertices) - 2), ((len(nodes) - 1) * sides, len(vertices) - 1)):
        rim = ring + np.arange(sides)
        faces.append(np.stack([rim, np.roll(rim, 1), np.full(sides, middle)], 1))
    return vertices.astype(np.float32), np.vstack(faces).astype(np.uint32)


def test_parity_with_open3d():
    made = scene("paper", seed=3, views=3)
    vertices, faces = tube_mesh(finer(made.truth[0], 2), RADIUS)
    square = np.float32([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    cast = o3d.t.geometry.RaycastingScene()
    cast.add_triangles(o3d.core.Tensor(vertices), o3d.core.Tensor(faces))
    cast.add_triangles(o3d.core.Tensor(square), o3d.core.Tensor(np.uint32([[0, 1, 2], [0, 2, 3]])))
    x, y = (np.arange(320) - 159.5) / 212, (np.arange(240) - 119.5) / 212
    for pose in made.poses_true:
        directions = np.stack([*np.meshgrid(x, y), np.ones((240, 320))], axis=-1) @ pose[:3, :3].T
        rays = np.concatenate([np.broadcast_to(pose[:3, 3], directions.shape), directions], axis=-1)
        theirs = cast.cast_rays(o3d.core.Tensor(rays.astype(np.float32)))["t_hit"].numpy()
        ours = render_depth(made.truth, RADIUS, PINHOLE, pose)
        agree = np.isfinite(theirs) == (ours > 0)
        assert agree.mean() > 0.9999
        string = np.isfinite(theirs) & (unproject_all(theirs, rays)[..., 2] > 1e-4)
        error = np.abs(ours - theirs)
        assert string.sum() > 1000
        # the mesh's facets are up to 1.3 micrometres inside the tube; at its outline they miss it
        assert np.median(error[string]) < 2e-6
        assert (error[string] < 5e-5).mean() > 0.99
        assert (error[agree & ~string & (ours > 0)] < 1e-5).mean() > 0.999


def unproject_all(depth, rays):
    return rays[..., :3] + np.where(np.isfinite(depth), depth, 0.0)[..., None] * rays[..., 3:]


# sensor


def test_noise_is_normal_and_as_large_as_asked():
    for noise in (0.0003, 0.0007, 0.0015):
        made = scene("s", noise=noise, flying=0.0, views=2, seed=4)
        exact = np.stack([render_depth(made.truth, RADIUS, PINHOLE, pose) for pose in made.poses_true])
        error = (made.depth * made.depth_scale - exact)[exact > 0]
        assert error.mean() == pytest.approx(0.0, abs=0.02 * noise)
        assert error.std() == pytest.approx(math.hypot(noise, made.depth_scale / math.sqrt(12)), rel=0.02)
        assert (np.abs(error) > 2 * noise).mean() == pytest.approx(0.0455, rel=0.15)
        assert not made.depth[exact == 0].any()


def test_quantisation():
    exact = render_depth([shape("loop")], RADIUS, PINHOLE, camera_pose(0.3, 0.32))
    settings = dict(noise=0.0, flying=0.0, step=RADIUS, rng=np.random.default_rng(0))
    for depth_scale in (1e-4, 1e-3):
        seen = sense(exact, depth_scale=depth_scale, **settings)
        assert seen.dtype == np.uint16
        assert np.abs(seen * depth_scale - exact).max() <= 0.5001 * depth_scale
    # 1e-6 m in 16 bits reach 66 mm only: what is farther has no return
    assert not sense(exact, depth_scale=1e-6, **settings).any()


def test_flying_pixels_are_between_two_surfaces():
    exact = render_depth([shape("loop")], RADIUS, PINHOLE, camera_pose(0.3, 0.32), table=3.0)
    assert (exact > 0).all()
    rng = np.random.default_rng(7)
    around = np.pad(exact, 1, mode="edge")
    gaps = np.stack([around[1:-1, :-2], around[1:-1, 2:], around[:-2, 1:-1], around[2:, 1:-1]]) - exact
    step = np.abs(gaps).max(axis=0) > RADIUS
    seen = sense(exact, noise=0.0, flying=0.25, step=RADIUS, depth_scale=2e-5, rng=rng) * 2e-5
    moved = np.abs(seen - exact) > 2e-5
    assert not (moved & ~step).any()
    assert moved.sum() == pytest.approx(0.25 * step.sum(), rel=0.1)
    low, high = exact + np.minimum(gaps.min(axis=0), 0), exact + np.maximum(gaps.max(axis=0), 0)
    assert ((seen >= low - 2e-5) & (seen <= high + 2e-5)).all()


# scenes


def test_reported_poses_are_wrong_in_the_table_plane_only():
    angles, shifts = [], []
    for seed in range(12):
        made = scene("arc", seed=seed, size=(32, 24))
        assert np.array_equal(made.poses[3], made.poses_true[3])
        for i in (0, 1, 2, 4, 5, 6):
            error = made.poses[i] @ np.linalg.inv(made.poses_true[i])
            assert error[2] == pytest.approx([0, 0, 1, 0], abs=1e-12)
            assert error[:3, 2] == pytest.approx([0, 0, 1], abs=1e-12)
            angles.append(math.atan2(error[1, 0], error[0, 0]))
            shifts.extend(error[:2, 3])
    assert np.degrees(np.std(angles)) == pytest.approx(0.5, rel=0.25)
    assert np.std(shifts) == pytest.approx(0.0015, rel=0.25)
    exact = scene("arc", size=(32, 24), turn_error=0.0, shift_error=0.0)
    assert exact.poses == pytest.approx(exact.poses_true, abs=1e-15)


def test_cameras_stand_around_the_table():
    made = scene("loop", size=(32, 24))
    centres = made.poses_true[:, :3, 3]
    distance = np.linalg.norm(centres, axis=1)
    assert distance == pytest.approx(distance[0])
    assert np.degrees(np.arcsin(centres[:, 2] / distance)) == pytest.approx(50)
    assert np.degrees(np.arctan2(centres[:, 1], centres[:, 0])) == pytest.approx(np.arange(-90, 91, 30))
    assert -made.poses_true[:, :3, 2] * distance[:, None] == pytest.approx(centres)  # look at the origin
    assert scene("loop", views=1, size=(32, 24)).poses_true[0, 1, 3] == 0.0
    large = scene("loop", size=(640, 480), views=1)
    assert large.depth.shape == (1, 480, 640)
    assert large.intrinsics == pytest.approx(np.array([[424, 0, 319.5], [0, 424, 239.5], [0, 0, 1]]))


@pytest.mark.parametrize("name", SHAPES)
def test_every_view_holds_the_string(name):
    made = scene(name, seed=6, noise=0.0003)
    nodes = made.truth[0]
    for pose in made.poses_true:
        seen = (nodes - pose[:3, 3]) @ pose[:3, :3]
        pixel = seen @ made.intrinsics.T / seen[:, 2:]
        assert (pixel[:, :2] > 0).all()
        assert (pixel[:, :2] < (319, 239)).all()
    low, high = made.bounds
    assert low == pytest.approx([*(nodes[:, :2].min(0) - 6 * RADIUS), 0.6 * RADIUS])
    assert high == pytest.approx(nodes.max(0) + np.array([6, 6, 3]) * RADIUS)
    points = np.vstack([view.crop(made.bounds).points for view in made.views])
    assert 5500 < len(points) < 13000
    for view, pose in zip(made.views, made.poses, strict=True):
        assert np.array_equal(view.pose, pose)


def test_same_seed_same_bits():
    first, again, other = scene(seed=5, views=2), scene(seed=5, views=2), scene(seed=6, views=2)
    assert first.name == "paper"
    assert np.array_equal(first.depth, again.depth)
    assert np.array_equal(first.poses, again.poses)
    assert np.array_equal(first.truth[0], again.truth[0])
    assert not np.array_equal(first.truth[0], other.truth[0])
    assert not np.array_equal(first.depth, other.depth)
    # the noise has no part in how the string lies
    assert np.array_equal(first.truth[0], scene(seed=5, views=2, noise=0.0).truth[0])


def test_several_strings_of_ones_own():
    one = shape("arc") - (0.0, 0.03, 0.0)
    two = shape("straight", length=0.1) - (0.03, 0.0, 0.0)
    made = scene(chains=[one, two], seed=1, views=3)
    assert made.name == "chains"
    assert len(made.truth) == 2
    assert np.array_equal(made.truth[0], one)
    assert scene("pair", chains=[one], views=1).name == "pair"


def test_large_and_small_strings():
    for radius in (0.002, 0.01):
        made = scene(radius=radius, views=3)
        assert shapes.arc_lengths(made.truth[0])[-1] == pytest.approx(0.4 * radius / RADIUS, rel=1e-3)
        assert sum(len(view.crop(made.bounds).points) for view in made.views) > 2500


def test_save_and_load(tmp_path):
    path = tmp_path / "two.npz"
    made = scene("two", chains=[shape("arc"), shape("straight", length=0.1) - (0.03, 0.0, 0.0)], views=3)
    made.save(path)
    assert [file.name for file in tmp_path.iterdir()] == ["two.npz"]

    read = io.load_scene(path)
    assert read.name == "two"
    assert read.radius == made.radius
    assert np.array_equal(np.stack(read.bounds), np.stack(made.bounds))
    for got, view in zip(read.views, made.views, strict=True):
        assert np.array_equal(got.points, view.points)
        assert np.array_equal(got.pose, view.pose)
    for got, nodes in zip(read.truth, made.truth, strict=True):
        assert got == pytest.approx(nodes, abs=1e-7)


def test_saved_in_the_format_of_the_stored_scenes(data, tmp_path):
    path = tmp_path / "paper.npz"
    made = scene()
    made.save(path)
    with np.load(path) as ours, np.load(data / "scenes" / "paper_mid.npz") as theirs:
        assert set(ours.files) == set(theirs.files)
        for key in theirs.files:
            assert ours[key].dtype.kind == theirs[key].dtype.kind
            assert ours[key].dtype.itemsize == theirs[key].dtype.itemsize or key == "name"
            if key != "truth_0":
                assert ours[key].shape == theirs[key].shape
        # as the prototype reads it
        K, low, high = ours["K"], *ours["box"]
        for depth, pose, view in zip(ours["depth"], ours["poses"], made.views, strict=True):
            v, u = np.nonzero(depth)
            z = depth[v, u] * float(ours["depth_scale"])
            world = (
                np.c_[(u - K[0, 2]) / K[0, 0] * z, (v - K[1, 2]) / K[1, 1] * z, z] @ pose[:3, :3].T
                + pose[:3, 3]
            )
            inside = world[((world > low) & (world < high)).all(axis=1)]
            assert inside == pytest.approx(view.crop(made.bounds).world_points, abs=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (dict(name="bow"), "name: expected one of straight"),
        (dict(radius=0.0), "radius: expected a positive"),
        (dict(radius=-1.0), "radius: expected a positive"),
        (dict(length=0.3), "length: a string of radius 0.0042 m needs at least 0.399 m"),
        (dict(noise=-1e-3), "noise: expected a number >= 0"),
        (dict(noise=math.nan), "noise: expected a number >= 0"),
        (dict(views=0), "views: expected at least 1, got 0"),
        (dict(seed=-1), "seed: expected at least 0, got -1"),
        (dict(size=(0, 240)), r"size\[0\]: expected at least 1, got 0"),
        (dict(size=320), "size: expected a pair"),
        (dict(depth_scale=0.0), "depth_scale: expected a positive"),
        (dict(flying=1.5), "flying: expected a part from 0 to 1"),
        (dict(turn_error=-0.1), "turn_error: expected a number >= 0"),
        (dict(shift_error=math.inf), "shift_error: expected a number >= 0"),
        (dict(chains=[]), "chains: expected at least one string"),
        (dict(chains=[np.zeros((1, 3))]), r"chains\[0\]: expected at least two nodes"),
        (dict(chains=[np.zeros((2, 3))]), r"chains\[0\]: expected no two equal nodes"),
        (dict(chains=[np.zeros((4, 2))]), r"chains\[0\]: expected shape"),
        (dict(chains=[shape("arc")], length=0.4), "length: expected none"),
    ],
)
def test_wrong_values(arguments, message):
    with pytest.raises(ValueError, match=message):
        scene(**{"views": 1, "size": (32, 24), **arguments})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (dict(views=2.5), "views: expected an integer, got float"),
        (dict(seed="one"), "seed: expected an integer, got str"),
        (dict(noise="low"), "noise: expected a number, got str"),
        (dict(size=(320.0, 240.0)), r"size\[0\]: expected an integer"),
        (dict(chains=[np.zeros((4, 3), dtype=int)]), r"chains\[0\]: expected floating point"),
    ],
)
def test_wrong_types(arguments, message):
    with pytest.raises(TypeError, match=message):
        scene(**{"views": 1, "size": (32, 24), **arguments})


def test_wrong_cameras():
    nodes = shape("straight")
    with pytest.raises(ValueError, match="intrinsics: expected"):
        render_depth([nodes], RADIUS, -PINHOLE, OVERHEAD)
    with pytest.raises(ValueError, match="pose: expected a rigid motion"):
        render_depth([nodes], RADIUS, PINHOLE, np.diag([2.0, 1.0, 1.0, 1.0]))
    with pytest.raises(ValueError, match="table: expected a number >= 0"):
        render_depth([nodes], RADIUS, PINHOLE, OVERHEAD, table=-1.0)
    with pytest.raises(ValueError, match="radius: expected one number or one for each of 1 chains, got 2"):
        render_depth([nodes], [0.004, 0.005], PINHOLE, OVERHEAD)
    with pytest.raises(ValueError, match=r"chains\[0\]: expected turns under 90 degrees, but node 1"):
        render_depth([nodes[[0, 1, 0]]], RADIUS, PINHOLE, OVERHEAD)
    with pytest.raises(ValueError, match="distance: expected a positive"):
        camera_pose(0.0, 0.0)
    with pytest.raises(ValueError, match="azimuth: expected a finite"):
        camera_pose(math.nan, 0.3)
