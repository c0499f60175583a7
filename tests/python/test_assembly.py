"""Which piece goes on as which: what cameras saw, second look, joins, gaps, confidence."""

from __future__ import annotations

import dataclasses
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

import strand
from strand import assembly, certainty, linking, pieces, tubes
from strand.assembly import Assembly, Judged
from strand.config import Linking
from strand.synthetic import tangle
from strand.visibility import Sight

SHARED = Path(__file__).resolve().parents[3] / "shared"
SCENES = SHARED / "scenes"
R = 0.0042
UP = np.array([0.0, 0.0, 5.0 * R])


def line(start, stop):
    start, stop = np.array(start, float), np.array(stop, float)
    count = max(int(np.linalg.norm(stop - start) / (0.5 * R)), 2) + 1
    return start + np.linspace(0.0, 1.0, count)[:, None] * (stop - start)


@pytest.fixture(scope="module")
def paper():
    return strand.synthetic.scene("paper", seed=3)


@pytest.fixture(scope="module")
def paper_model(paper):
    return strand.reconstruct(paper.views, paper.radius, paper.bounds, keep_stages=True)


def test_cameras_see_strings_where_they_are_and_nothing_above_them(paper):
    sight = Sight.of(paper.views, paper.poses_true)
    truth = paper.truth[0][::10]
    assert not sight.free(truth, R).any()
    assert sight.occluded(truth, R).mean() < 0.1
    above = truth + UP
    assert sight.free(above, R).all()
    under_the_table = truth - UP
    assert sight.occluded(under_the_table, R).all()


def test_what_cameras_saw_does_not_depend_on_the_world_frame(paper):
    motion = strand.pose_from_angles(0.4, -0.7, 2.0, [3.0, -1.0, 0.5])
    places = np.concatenate([paper.truth[0][::10], paper.truth[0][::10] + UP])
    there = Sight.of(paper.views, paper.poses_true).states(places, R)
    poses = [motion @ pose for pose in paper.poses_true]
    moved = Sight.of(paper.views, poses).states(places @ motion[:3, :3].T + motion[:3, 3], R)
    assert (there == moved).mean() > 0.995


def test_a_view_without_points_knows_nothing():
    view = strand.View(np.empty((0, 3)))
    sight = Sight.of([view], [view.pose])
    assert not sight.free(np.zeros((3, 3)), R).any()
    assert sight.occluded(np.zeros((3, 3)), R).all()


def test_a_second_look_finds_the_string_that_is_left_out(paper, paper_model):
    fit = paper_model.stages["fit"]
    assert pieces.left_over(fit) == []
    two = strand.load_scene(SCENES / "two_ropes.npz")
    model = strand.reconstruct(two.views, two.radius, two.bounds, keep_stages=True)
    fit = model.stages["fit"]
    clouds = tubes.Clouds.of([view.crop(two.bounds) for view in two.views], two.bounds)
    one = strand.fit_tubes(
        clouds.points,
        clouds.viewpoints,
        fit.curves[:1],
        fit.motions,
        two.radius,
        pose_sd=(0.01, 0.001),
        reference=3,
        fit_curves=False,
        iterations=1,
    )
    found = pieces.left_over(one)
    other = model.chains[1 if model.chains[0].nearest(found[0][0])[1] > 2.0 * R else 0]
    assert sum(np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum() for nodes in found) > 0.5 * other.length
    for nodes in found:
        assert max(other.nearest(node)[1] for node in nodes) < two.radius


def test_a_gap_is_bridged_where_it_is_hidden_and_not_where_it_was_seen_through():
    parts = [line([-0.1, 0, R], [-0.03, 0, R]), line([0.03, 0, R], [0.1, 0, R])]
    scene = strand.synthetic.scene(chains=parts, seed=1, views=3)
    for ropes in (None, 1):
        model = strand.reconstruct(scene.views, scene.radius, scene.bounds, ropes=ropes)
        assert model.chains[0].length < 0.08
    # the same rope seen without the table: nothing speaks against a gap
    views = [view.crop(scene.bounds) for view in scene.views]
    model = strand.reconstruct(views, scene.radius, ropes=1)
    (chain,) = model.chains
    assert chain.length == pytest.approx(0.2, rel=0.02)
    assert chain.bridged.mean() == pytest.approx(0.3, abs=0.04)
    middle = np.abs(chain.points[:, 0]) < 0.025
    assert chain.bridged[middle].all()
    assert np.abs(chain.points[middle, 1:] - [0.0, R]).max() < R


def test_joins_keep_out_of_space_that_was_seen_to_be_empty(paper):
    sight = Sight.of(paper.views, paper.poses_true)
    z = 8.0 * R
    arcs = [line([-0.06, 0.0, z], [-0.01, 0.0, z]), line([0.01, 0.0, z], [0.06, 0.0, z])]
    assert len(linking.link(arcs, R, Linking())) == 1
    assert len(linking.link(arcs, R, Linking(), sight)) == 2


def test_the_cheapest_bridges_are_those_of_an_exhaustive_search():
    rng = np.random.default_rng(0)
    for _ in range(20):
        pieces_of = [0, 1, 2, 3]
        priced = sorted(
            (float(rng.uniform(0, 10)), i, j) for i, j in combinations(range(8), 2) if i // 2 != j // 2
        )
        found = linking._cheapest(priced, pieces_of, 3)
        cost = {(i, j): c for c, i, j in priced}
        best = np.inf
        for chosen in combinations(cost, 3):
            ends = [end for pair in chosen for end in pair]
            if len(set(ends)) == 6:
                group = list(range(4))
                rings = False
                for i, j in chosen:
                    a, b = group[i // 2], group[j // 2]
                    rings |= a == b
                    group = [a if g == b else g for g in group]
                if not rings:
                    best = min(best, sum(cost[pair] for pair in chosen))
        assert sum(cost[pair] for pair in found) == pytest.approx(best)


def test_a_stub_beyond_a_crossing_is_turned_to_the_arc_that_points_at_it():
    arc = line([-0.05, 0.0, 0.0], [0.0, 0.0, 0.0])
    across = line([4 * R, -0.8 * R, 0.0], [4 * R, 0.8 * R, 0.0])
    _, stub = linking.aimed([arc, across], R)
    step = stub[-1] - stub[0]
    assert abs(step[0]) == pytest.approx(np.linalg.norm(step), rel=0.02)
    np.testing.assert_allclose(stub.mean(axis=0), [4 * R, 0, 0], atol=0.3 * R)
    long = line([4 * R, -3 * R, 0.0], [4 * R, 3 * R, 0.0])
    np.testing.assert_array_equal(linking.aimed([arc, long], R)[1], long)


def test_two_ways_that_are_as_good_have_no_margin():
    def ends(slope):
        """Four arcs that lead into a gap, each pair as likely to go on across as along."""
        arcs = []
        for x in (-1.0, 1.0):
            for y in (-1.0, 1.0):
                inner = np.array([x * 3 * R, y * 1.5 * R, 0.0])
                out = np.array([x, y * slope, 0.0]) / np.hypot(1.0, slope)
                arcs.append(line(inner + 10 * R * out, inner))
        return arcs

    def margin(slope):
        links = linking.Links.between(ends(slope), R, Linking())
        joins, cost = links.matched(5.0)
        return min(links.matched(5.0, [pair])[1] - cost for pair in joins), joins

    low, across = margin(0.0)[1], margin(0.5)[1]
    assert low != across
    a, b = 0.0, 0.5
    for _ in range(40):
        middle = 0.5 * (a + b)
        a, b = (middle, b) if margin(middle)[1] == low else (a, middle)
    assert margin(a)[0] < 0.01
    assert margin(0.0)[0] > 1.0
    assert margin(0.5)[0] > 0.3


def test_a_clear_scene_is_sure_and_says_so(paper_model, tmp_path):
    assert paper_model.confidence > 0.85
    assert not any("unsure" in warning for warning in paper_model.warnings)
    assert all(join.margin > 1.5 for join in paper_model.joins)
    assert [join.margin for join in paper_model.joins] == sorted(join.margin for join in paper_model.joins)
    paper_model.save(tmp_path / "model.json")
    loaded = strand.load(tmp_path / "model.json")
    assert loaded.confidence == paper_model.confidence
    assert len(loaded.joins) == len(paper_model.joins)
    for a, b in zip(loaded.joins, paper_model.joins, strict=True):
        np.testing.assert_array_equal(a.place, b.place)
        assert (a.chains, a.margin) == (b.chains, b.margin)
    assert [str(doubt) for doubt in loaded.doubts] == [str(doubt) for doubt in paper_model.doubts]
    assert [doubt.amount for doubt in loaded.doubts] == [doubt.amount for doubt in paper_model.doubts]


@pytest.fixture(scope="module")
def tucked_under():
    """A string whose end lies under another one, one radius beyond its axis, seen from one place."""
    over = [
        np.linspace(-0.1, 0.1, 201),
        np.zeros(201),
        R + 2.2 * R * np.exp(-((np.arange(-100, 101) / 20) ** 2)),
    ]
    under = [np.zeros(111), np.linspace(-0.11 + R, R, 111), np.full(111, R)]
    return strand.synthetic.scene(chains=[np.stack(over, axis=1), np.stack(under, axis=1)], views=1, seed=5)


def test_an_end_that_no_camera_saw_is_put_where_it_may_be_and_named(tucked_under):
    scene = tucked_under
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    assert len(model.chains) == 2
    end = scene.truth[1][-1]
    off = min(np.linalg.norm(chain.points[k] - end) for chain in model.chains for k in (0, -1))
    assert off < 1.5 * R
    hidden = [doubt for doubt in model.doubts if "where no camera saw" in doubt.reason]
    assert len(hidden) == 1
    assert np.linalg.norm(hidden[0].place - end) < 4.0 * R
    assert model.confidence < 0.8
    assert any("where the string ends" in warning for warning in model.warnings)


def two_in_line(gap):
    x = np.linspace(0.0, 0.1, 101)
    return [np.stack([side * (x + 0.5 * gap * R), 0.0 * x, np.full(101, R)], axis=1) for side in (-1.0, 1.0)]


@pytest.mark.parametrize("gap", [2.0, 3.0, 4.0])
def test_a_gap_that_cameras_see_through_is_not_bridged(gap):
    scene = strand.synthetic.scene(chains=two_in_line(gap), seed=int(gap))
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    assert len(model.chains) == 2
    assert model.confidence > 0.9


def test_a_t_is_named_a_branch_and_a_gap_is_none():
    trunk = np.stack([np.linspace(-0.1, 0.1, 201), np.zeros(201), np.full(201, R)], axis=1)
    for start, branched in ((0.0, True), (4.5 * R, False)):
        arm = np.stack([np.zeros(101), start + np.linspace(0.0, 0.1, 101), np.full(101, R)], axis=1)
        scene = strand.synthetic.scene(chains=[trunk, arm], seed=1)
        model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
        assert any("a branch?" in warning for warning in model.warnings) == branched


def test_rings_start_at_the_same_place_however_the_data_waver():
    angle = np.linspace(0.0, 2.0 * np.pi, 315)
    ring = 0.05 * np.stack([np.cos(angle), np.sin(angle), np.zeros(315)], axis=1) + [0.0, 0.0, R]
    starts = []
    for seed in range(3):
        scene = strand.synthetic.scene(chains=[ring], seed=seed)
        chain = strand.reconstruct(scene.views, scene.radius, scene.bounds).chains[0]
        assert chain.closed
        starts.append(chain.points[0])
    assert np.ptp(starts, axis=0).max() < 3.0 * R


def test_other_ways_are_given_with_what_they_cost_more(tmp_path):
    shared = strand.load_scene(SCENES / "paper_high.npz")
    model = strand.reconstruct(shared.views, shared.radius, shared.bounds)
    assert model.alternatives
    costs = [other.cost for other in model.alternatives]
    assert costs == sorted(costs)
    assert costs[0] >= 0.0
    model.save(tmp_path / "model.json")
    loaded = strand.load(tmp_path / "model.json").alternatives
    assert [other.cost for other in loaded] == costs
    for a, b in zip(loaded, model.alternatives, strict=True):
        for some, others in zip(a.chains, b.chains, strict=True):
            np.testing.assert_array_equal(some, others)


def test_a_way_that_explains_nothing_is_no_alternative(paper_model):
    nodes = [(chain.points, chain.closed) for chain in paper_model.chains]
    assembly = Assembly(linking.Links((), {}), (), nodes, 0.0, ())
    ways = [Judged(assembly, paper_model.stages["fit"], cost, 0.0) for cost in (2.0, 3.5, np.inf)]
    assert [other.cost for other in tubes.alternatives([ways, ways[2:], []])] == [1.5]


@pytest.mark.parametrize("factor", [0.8, 0.9, 1.1, 1.2])
def test_a_radius_that_the_points_contradict_is_named(paper, paper_model, factor):
    assert not any(warning.startswith("radius") for warning in paper_model.warnings)
    model = strand.reconstruct(paper.views, factor * paper.radius, paper.bounds)
    looks = "thicker" if factor < 1.0 else "thinner"
    assert any(f"the string looks {looks}" in warning for warning in model.warnings)


def test_the_next_view_is_never_from_under_the_table():
    for name in ("arc_low", "arc_mid"):
        shared = strand.load_scene(SCENES / f"{name}.npz")
        model = strand.reconstruct(shared.views, shared.radius, shared.bounds)
        assert model.next_view()[2] > 0.0


def test_doubts_make_the_confidence(paper_model, tucked_under):
    scene = tucked_under
    for model in (paper_model, strand.reconstruct(scene.views, scene.radius, scene.bounds)):
        total = sum(doubt.amount for doubt in model.doubts)
        assert model.confidence == pytest.approx(np.exp(-0.01 - total), rel=1e-12)
        assert [doubt.amount for doubt in model.doubts] == sorted(
            (doubt.amount for doubt in model.doubts), reverse=True
        )


def test_points_that_lie_on_no_string_make_unsure(paper):
    rng = np.random.default_rng(0)
    _, high = paper.bounds
    ball = rng.normal(size=(1500, 3))
    ball = np.array([0.0, 0.0, high[2] - 3.0 * R]) + 3.0 * R * ball / np.linalg.norm(ball, axis=1)[:, None]
    views = []
    for view in paper.views:
        facing = (ball - ball.mean(axis=0)) @ (view.viewpoint - ball.mean(axis=0)) > 0
        back = (ball[facing] - view.viewpoint) @ view.pose[:3, :3]
        views.append(dataclasses.replace(view, points=np.concatenate([view.points, back])))
    model = strand.reconstruct(views, paper.radius, paper.bounds)
    assert model.confidence < 0.8
    assert any("of the points lie on the strings" in doubt.reason for doubt in model.doubts)


def test_noise_as_wide_as_the_string_is_not_sure():
    scene = strand.synthetic.scene("paper", seed=0, radius=0.0025, noise=0.0015, views=2)
    try:
        model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    except strand.NotEnoughDataError:
        return
    assert model.confidence < 0.7


def test_the_published_method_does_not_say_how_sure_it_is(paper, tmp_path):
    model = strand.reconstruct(paper.views, paper.radius, paper.bounds, config=strand.Config.published())
    assert np.isnan(model.confidence)
    assert model.joins == ()
    model.save(tmp_path / "model.json")
    assert np.isnan(strand.load(tmp_path / "model.json").confidence)


def test_the_next_view_sees_what_is_least_certain(paper, paper_model):
    camera = paper_model.next_view()
    place = paper_model.joins[0].place
    cameras = paper_model.poses[:, :3, 3]
    assert np.linalg.norm(camera - place) == pytest.approx(
        np.median(np.linalg.norm(cameras - place, axis=1)), rel=1e-6
    )
    assert camera[2] > 0.05, "above the table, as the other cameras are"
    # no strand within a radius of the line of sight, but for the two that cross there
    nodes = np.concatenate([chain.points for chain in paper_model.chains])
    ray = (camera - place) / np.linalg.norm(camera - place)
    along = (nodes - place) @ ray
    aside = np.linalg.norm(nodes - place - along[:, None] * ray, axis=1)
    assert (aside[along > 4.0 * R] > R).all()


def test_chains_start_at_the_same_end_however_the_data_waver(paper, paper_model):
    start = paper_model.chains[0].points[0]
    for seed in range(2):
        other = strand.synthetic.scene(chains=paper.truth, seed=seed, noise=0.0005)
        chain = strand.reconstruct(other.views, other.radius, other.bounds).chains[0]
        assert np.linalg.norm(chain.points[0] - start) < 2.0 * R
    before = dataclasses.replace(paper_model, chains=(paper_model.chains[0].reversed(),))
    model = strand.reconstruct(paper.views, paper.radius, paper.bounds, previous=before)
    np.testing.assert_allclose(model.chains[0].points, before.chains[0].points, atol=1e-9)
    with pytest.raises(TypeError, match="previous"):
        strand.reconstruct(paper.views, paper.radius, paper.bounds, previous="before")


def test_a_reversed_chain_is_the_same_string(paper_model):
    chain = paper_model.chains[0]
    back = chain.reversed()
    s = np.linspace(0.0, chain.length, 11)
    np.testing.assert_allclose(back.at(s), chain.at(chain.length - s), atol=1e-9)
    np.testing.assert_array_equal(back.points_seen[::-1], chain.points_seen)
    np.testing.assert_array_equal(back.reversed().points, chain.points)


@pytest.mark.parametrize(("crossings", "ropes", "seed"), [(0, 1, 0), (2, 1, 1), (3, 2, 5), (4, 3, 2)])
def test_tangles_cross_as_often_as_wanted_and_never_cut_through_each_other(crossings, ropes, seed):
    chains = tangle(crossings, ropes, R, seed)
    assert len(chains) == ropes
    for again, chain in zip(tangle(crossings, ropes, R, seed), chains, strict=True):
        np.testing.assert_array_equal(again, chain)
    steps = [(k, i) for k, chain in enumerate(chains) for i in range(len(chain) - 1)]
    start = np.concatenate([chain[:-1] for chain in chains])
    step = np.concatenate([np.diff(chain, axis=0) for chain in chains])
    count = 0
    for i in range(len(steps)):
        j = np.arange(i + 2, len(steps))
        j = j[(start[j, 0] != start[i, 0]) & (np.abs(start[j, :2] - start[i, :2]).max(axis=1) < 0.004)]
        size = step[i, 0] * step[j, 1] - step[i, 1] * step[j, 0]
        apart = start[j, :2] - start[i, :2]
        with np.errstate(all="ignore"):
            t = (apart[:, 0] * step[j, 1] - apart[:, 1] * step[j, 0]) / size
            u = (apart[:, 0] * step[i, 1] - apart[:, 1] * step[i, 0]) / size
        count += int(((t >= 0) & (t < 1) & (u >= 0) & (u < 1)).sum())
    assert count == crossings
    thin = [chain[::3] for chain in chains]
    nodes, number = np.concatenate(thin), np.repeat(np.arange(ropes), [len(chain) for chain in thin])
    along = np.concatenate([np.arange(len(chain)) * 3e-3 for chain in thin])
    apart = np.linalg.norm(nodes[:, None] - nodes[None], axis=2)
    own = (number[:, None] == number[None]) & (np.abs(along[:, None] - along[None]) < 6.0 * R)
    assert apart[~own].min() > 1.9 * R


def test_tangles_refuse_what_cannot_be():
    with pytest.raises(ValueError, match="crossings"):
        tangle(-1)
    with pytest.raises(ValueError, match="ropes"):
        tangle(1, 0)
    with pytest.raises(ValueError, match="radius"):
        tangle(1, 1, 0.0)


def test_a_branched_object_comes_as_chains_that_meet_and_says_so():
    path = SHARED / "real" / "harness" / "wireHarness.txt"
    points = np.loadtxt(path)
    model = strand.reconstruct([strand.View.from_world(points, points.mean(axis=0) + 40.0 * UP)], 0.006)
    assert len(model.chains) > 2
    assert sum("a branch?" in warning for warning in model.warnings) >= 1
    assert model.confidence < 0.2


def test_branches_are_ends_that_point_into_another_side():
    trunk = strand.Chain(line([-0.1, 0, 0], [0.1, 0, 0]), R)
    branch = strand.Chain(line([0.0, 2.5 * R, 0], [0.0, 0.1, 0]), R)
    ((number, other, place),) = certainty.branches([trunk, branch])
    assert (number, other) == (1, 0)
    np.testing.assert_allclose(place, [0, 0, 0], atol=R)
    over = strand.Chain(line([0.0, 2.5 * R, 2 * R], [0.0, 0.1, 2 * R]), R)
    assert certainty.branches([trunk, over]) == []


@pytest.mark.parametrize(("gap", "said"), [(0.0, True), (1.0, False), (2.0, False)])
def test_a_string_that_ends_short_of_another_is_no_branch(gap, said):
    trunk = line([-0.12, 0, R], [0.12, 0, R])
    other = line([0.01, (1.0 + gap) * R, R], [0.01, 0.12, R])
    scene = strand.synthetic.scene(chains=[trunk, other], radius=R, seed=1)
    model = strand.reconstruct(scene.views, R, scene.bounds)
    assert len(model.chains) == 2
    assert any("a branch?" in warning for warning in model.warnings) == said


def test_ropes_that_cross_near_an_end_are_no_branches():
    scene = strand.load_scene(SCENES / "two_ropes.npz")
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    assert len(model.chains) == 2
    assert not any("a branch?" in warning for warning in model.warnings)


@pytest.mark.parametrize("name", ["loop_high", "overhand_high"])
def test_crossings_that_look_like_one_strand_for_long_are_told_apart(name):
    scene = strand.load_scene(SCENES / f"{name}.npz")
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    (chain,) = model.chains
    truth = strand.Chain(scene.truth[0], scene.radius)
    assert chain.length == pytest.approx(truth.length, rel=0.01)
    s = np.array([truth.nearest(point)[0] for point in chain.points])
    assert (np.abs(np.diff(s)) < 4.0 * R).all(), "in order along the true string"


def test_assemblies_are_alike_whatever_the_direction_of_their_chains():
    chains = [(line([0, 0, 0], [0.1, 0, 0]), False), (line([0, 0.05, 0], [0.1, 0.05, 0]), False)]
    flipped = [(chains[1][0][::-1], False), chains[0]]
    assert assembly.alike(chains, flipped, R)
    assert not assembly.alike(chains, chains[:1], R)
    other = [chains[0], (line([0, 0.05, 0], [0.1, 0.09, 0]), False)]
    assert not assembly.alike(chains, other, R)


def test_joins_name_the_chains_that_run_there():
    scene = strand.synthetic.scene(chains=strand.synthetic.tangle(4, 2, seed=2), seed=2)
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    assert len(model.chains) == 2
    assert model.joins
    for join in model.joins:
        for number in join.chains:
            apart = np.linalg.norm(model.chains[number].points - join.place, axis=1).min()
            assert apart < 4.0 * scene.radius


def test_a_wrong_number_of_strings_is_not_sure(paper):
    for ropes in (2, 3):
        model = strand.reconstruct(paper.views, paper.radius, paper.bounds, ropes=ropes)
        assert model.confidence < 0.5


def test_an_end_that_leaves_the_extraction_range_is_named():
    t = np.linspace(-0.2, 0.2, 400)
    scene = strand.synthetic.scene(chains=[np.stack([t, 0 * t, 0 * t + 0.0042], axis=1)], seed=1)
    low, high = (np.array(corner) for corner in scene.bounds)
    low[0], high[0] = -0.1, 0.1
    model = strand.reconstruct(scene.views, scene.radius, (low, high))
    assert sum("runs out of the extraction range" in warning for warning in model.warnings) == 2
    whole = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    assert not any("extraction range" in warning for warning in whole.warnings)


def test_noise_that_the_residuals_contradict_is_named(paper):
    config = strand.Config(tubes=strand.config.Tubes(noise=1e-5))
    model = strand.reconstruct(paper.views, paper.radius, paper.bounds, config=config)
    assert any(warning.startswith("noise: ") for warning in model.warnings)
