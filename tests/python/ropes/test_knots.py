"""Names of knots against tied knots and knot Floer homology; linking numbers against counted crossings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from knot_floer_homology import pd_to_hfk

import strand
from lib.braids import BRAIDS, make_closed_braid, make_knots
from shared.ropes import R, draw_circle
from strand.ropes.doubt import Doubt
from strand.synthetic import SHAPES, shape

# by name: Seifert genus and Ozsváth and Szabó's tau of the right knot (KnotInfo, knotinfo.org)
GENUS_AND_TAU = {
    ("3_1", "right"): (1, 1),
    ("4_1", None): (1, 0),
    ("5_1", "right"): (2, 2),
    ("5_2", "right"): (1, 1),
    ("6_1", "right"): (1, 0),
    ("6_2", "right"): (2, 1),
    ("6_3", None): (2, 0),
    ("7_1", "right"): (3, 3),
    ("7_2", "right"): (1, 1),
    ("7_3", "right"): (2, 2),
    ("7_4", "right"): (1, 1),
    ("7_5", "right"): (2, 2),
    ("7_6", "right"): (2, 1),
    ("7_7", "right"): (2, 0),
    ("3_1#3_1", "right"): (2, 2),
    ("3_1#3_1", None): (2, 0),
    ("3_1#4_1", "right"): (2, 1),
}
# what is tied in shapes
TIED = {"overhand": "3_1", "figure8_knot": "4_1", "granny": "3_1#3_1", "square": "3_1#3_1"}
# KnotInfo's braids of knots beyond the table
LARGER = {"8_19": (1, 2) * 4, "10_132": (1, 1, 1, -2, -1, -1, -2, -3, 2, -3, -3)}


def find_euler_characteristic(homology):
    """Return the Alexander polynomial's coefficients from knot Floer homology."""
    found = {}
    for (alexander, maslov), rank in homology["ranks"].items():
        found[alexander] = found.get(alexander, 0) + (-1) ** maslov * rank
    return np.trim_zeros([found.get(k, 0) for k in range(min(found), max(found) + 1)])


def add_tails(nodes, length):
    """Extend an open chain straight at both ends by a length, in steps as long as its last one."""
    steps = nodes[0] - nodes[1], nodes[-1] - nodes[-2]
    before, after = (np.arange(1, int(length / np.linalg.norm(step)) + 1)[:, None] * step for step in steps)
    return np.vstack([nodes[0] + before[::-1], nodes, nodes[-1] + after])


def cut_between(nodes, start, stop):
    """Return the nodes of a polyline between two arc lengths."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(nodes, axis=0), axis=1))])
    return nodes[(arc >= start - 1e-9) & (arc <= stop + 1e-9)]


def test_random_chains_of_all_knots_are_named_with_their_chirality():
    made = make_knots(2 * len(BRAIDS), 200, seed=1)
    assert {hand for _, hand, _ in made} == {"left", "right", None}
    for name, hand, nodes in made:
        found = strand.knot(nodes)
        assert (found.name, found.chirality) == (name, hand)
        assert found.probability == found.shares[0][2] > 0.3
        assert sum(share for *_, share in found.shares) == pytest.approx(1.0)
        mirrored = strand.knot(nodes * [1, 1, -1])
        opposite = {"left": "right", "right": "left", None: None}
        assert (mirrored.name, mirrored.chirality) == (name, opposite[hand])


def test_codes_have_the_knot_floer_homology_of_the_name():
    seen = set()
    for word, _ in BRAIDS.values():
        for side in (1, -1):
            found = strand.knot(make_closed_braid(word) * [1, 1, side], closed=True)
            if found.name == "0_1":
                assert found.pd_code() == ()
                continue
            homology = pd_to_hfk([list(edges) for edges in found.pd_code()])
            right = (found.name, "right" if found.chirality == "left" else found.chirality)
            genus, tau = GENUS_AND_TAU[right]
            assert homology["seifert_genus"] == genus
            assert homology["tau"] == (-tau if found.chirality == "left" else tau)
            assert tuple(find_euler_characteristic(homology)) == found.alexander
            seen.add(right)
    assert seen == set(GENUS_AND_TAU)


def test_a_name_does_not_depend_on_place_size_or_the_order_of_nodes():
    for name, hand, nodes in make_knots(18, 120, seed=4)[1:]:
        turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
        turn *= np.linalg.det(turn)
        for other in (nodes[::-1], nodes * 1e-3 + [7.0, -3.0, 2.0], nodes @ turn.T * 1e4):
            found = strand.knot(other)
            assert (found.name, found.chirality) == (name, hand)


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_of_ropes(name):
    found = strand.knot(shape(name))
    assert found.name == TIED.get(name, "0_1")
    assert found.probability > 0.9
    assert (found.core is None) == (found.name == "0_1")


@pytest.mark.parametrize("name", ["loop", "paper", "overhand", "figure8_knot", "granny", "square"])
def test_ropes_are_named_from_depth(name):
    scene = strand.synthetic.scene(name, seed=2)
    (chain,) = strand.reconstruct(scene.views, scene.radius, scene.bounds).chains
    truth = strand.knot(scene.truth[0])
    found = chain.knot()
    assert found.name == TIED.get(name, "0_1")
    assert (found.name, found.chirality) == (truth.name, truth.chirality)


def test_granny_and_square_are_told_apart():
    granny, square = strand.knot(shape("granny")), strand.knot(shape("square"))
    half = strand.knot(shape("overhand")).chirality
    assert (granny.chirality, square.chirality) == (half, None)
    assert granny.alexander == square.alexander
    assert granny.jones != square.jones
    assert strand.knot(shape("granny") * [1, -1, 1]).chirality != half
    assert strand.knot(shape("square") * [1, -1, 1]).chirality is None


def test_no_crossing_is_no_knot():
    for nodes in ([[0, 0, 0], [0, 0, 1.0]], np.linspace([0.0, 0, 0], [1, 2, 3], 50), shape("coil")):
        found = strand.knot(nodes)
        assert (found.name, found.chirality, found.probability, found.core) == ("0_1", None, 1.0, None)
        assert found.gauss_code() == found.pd_code() == found.dt_code() == ()
        assert (found.alexander, found.jones, found.writhe()) == ((1,), (0, (1,)), 0)
    assert strand.knot([[0, 0, 0], [1, 0, 0], [0, 1.0, 0]], closed=True).name == "0_1"
    assert strand.Chain([[0, 0, 0], [0, 0, 1.0]], R).knot().name == "0_1"


def test_the_core_is_where_the_knot_is():
    knotted = shape("overhand")
    nodes = add_tails(knotted, 0.4)
    found = strand.knot(nodes)
    assert (found.name, found.probability) == ("3_1", 1.0)
    start, stop = found.core
    assert 0.4 < start < stop < 0.8
    core = cut_between(nodes, start, stop)
    assert strand.knot(core).name == "3_1"
    # it cannot be much shorter
    assert strand.knot(cut_between(nodes, start + 0.04, stop - 0.04)).name == "0_1"


def test_a_core_alone_is_the_same_knot():
    same, made = 0, make_knots(36, 200, seed=2)[1:]
    for name, hand, nodes in made:
        found = strand.knot(nodes)
        alone = strand.knot(cut_between(nodes, *found.core)) if found.core else found
        same += (alone.name, alone.chirality) == (name, hand)
    assert same >= 0.95 * len(made)


def test_two_knots_on_one_rope_are_a_composite():
    one = shape("overhand")
    way = one[-1] - one[0] + [0.05, 0, 0]
    granny = strand.knot(np.vstack([one, one + way]))
    assert (granny.name, granny.chirality) == ("3_1#3_1", strand.knot(one).chirality)
    square = strand.knot(np.vstack([one, one * [1, -1, 1] + way - [0, 2 * one[0, 1], 0]]))
    assert (square.name, square.chirality) == ("3_1#3_1", None)
    assert granny.alexander == square.alexander


def test_knots_beyond_the_table_are_not_guessed():
    found = strand.knot(make_closed_braid(LARGER["8_19"]), closed=True)
    assert (found.name, found.chirality, found.core) == ("unknown", None, None)
    # the torus knot T(3, 4)
    assert found.alexander == (1, -1, 0, 1, 0, -1, 1)
    assert found.jones == (3, (1, 0, 1, 0, 0, -1))


def test_names_that_polynomials_cannot_tell_are_said():
    small = strand.knot(make_closed_braid(BRAIDS["5_1"][0]), closed=True)
    large = strand.knot(make_closed_braid(LARGER["10_132"]), closed=True)
    assert (small.alexander, small.name, small.ambiguous) == (large.alexander, "5_1", ())
    assert (large.name, large.ambiguous) == ("5_1", ("10_132",))
    # it is another knot all the same
    ranks = [pd_to_hfk([list(edges) for edges in found.pd_code()])["total_rank"] for found in (small, large)]
    assert ranks[0] != ranks[1]


def test_uncertain_crossings_make_a_name_uncertain():
    nodes = shape("overhand")
    sure = strand.knot(nodes)
    assert strand.knot(nodes, crossings=np.empty((0, 3))) == sure
    crossings = [(0.1, 0.25, 0.9), (0.15, 0.3, 0.8)]
    # either wrong order unties a trefoil; both wrong leave one crossing of three, which ties none either
    assert strand.knot(nodes, crossings=crossings).probability == pytest.approx(0.72 * sure.probability)
    assert strand.knot(nodes, crossings=[(0.1, 0.25, 1.0)]).probability == sure.probability
    # a loop is no knot whichever strand is on top
    loop = shape("loop")
    assert strand.knot(loop, crossings=[(0.1, 0.3, 0.5)]).probability == strand.knot(loop).probability
    for wrong, message in [
        ([(0.1, 9.0, 0.5)], r"crossings: expected arc lengths from 0 to 0\.[34]"),
        ([(-0.1, 0.2, 0.5)], "crossings: expected arc lengths"),
        ([(0.1, 0.2, 1.5)], "crossings: expected two arc lengths .* and a probability"),
        ([(0.1, 0.2, np.nan)], "crossings"),
        ([(0.1, 0.2)], "crossings"),
        ([(0.1, 0.2, 0.5)] * 4, "crossings: expected at most the 3 crossings"),
    ]:
        with pytest.raises(ValueError, match=message):
            strand.knot(nodes, crossings=wrong)
    with pytest.raises(ValueError, match="direction: expected a vector that is not zero"):
        strand.knot(nodes, crossings=crossings, direction=(0, 0, 0))


def test_no_crossing_given_is_all_sure():
    nodes = shape("overhand")
    for none in ((), [], np.empty((0, 3))):
        assert strand.knot(nodes, crossings=none) == strand.knot(nodes)


def test_twists_of_a_strand_do_not_matter():
    # loops in a row, more than are tried
    turn = np.linspace(0, 2 * np.pi * 14, 700)
    nodes = np.stack([0.5 * turn - np.sin(turn), -np.cos(turn), 0.05 * turn], axis=1)
    loops = strand.Chain(nodes, 1e-3).crossings()
    assert len(loops) == 13
    rows = [(loop.over[1], loop.under[1], 0.5) for loop in loops]
    found = strand.knot(nodes, crossings=rows)
    assert (found.name, found.probability) == ("0_1", strand.knot(nodes).probability)


def test_a_reconstructed_chain_has_its_own_crossings():
    scene = strand.synthetic.scene("overhand", seed=2)
    (chain,) = strand.reconstruct(scene.views, scene.radius, scene.bounds).chains
    found, sure = chain.knot(), chain.knot(crossings=())
    assert sure.probability == sure.shares[0][2] == found.shares[0][2]
    # each wrong order unties a trefoil
    right = np.prod([crossing.probability for crossing in chain.crossings()])
    assert found.probability == pytest.approx(right * sure.probability)
    assert 0.9 * sure.probability < found.probability < sure.probability
    below = np.prod([crossing.probability for crossing in chain.crossings((0, 0.2, -1))])
    assert chain.knot(direction=(0, 0.2, -1)).probability == pytest.approx(below * sure.probability)
    doubt = Doubt("order", 2.0, "what is on top", "said by a test", place=chain.crossings()[0].place)
    assert replace(chain, doubts=(doubt,)).knot().probability < found.probability
    # without covariances nodes are as they are
    assert replace(chain, covariance=None, doubts=(doubt,)).knot() == sure
    with pytest.raises(ValueError, match="direction"):
        chain.knot(direction=(0, 0, 0))


def test_a_chain_that_cannot_be_drawn_from_there_has_a_name_all_the_same():
    turn = np.linspace(0, 6 * np.pi, 61)
    helix = np.stack([0.05 * np.cos(turn), 0.05 * np.sin(turn), 0.01 * turn], axis=1).round(12)
    chain = strand.Chain(helix, R, covariance=np.tile(np.eye(3) * 1e-8, (61, 1, 1)))
    found = chain.knot()
    assert found.name == "0_1"
    assert 0.0 <= found.probability <= 1.0


def test_chains_have_their_arc_lengths():
    chain = strand.Chain(shape("overhand")[::4], R)
    found = chain.knot()
    nodes = strand.knot(chain.points)
    assert (found.name, found.shares, found.diagram) == (nodes.name, nodes.shares, nodes.diagram)
    assert set(found.core) <= set(chain.arc_length)
    assert found.core == pytest.approx(nodes.core, abs=1e-3)
    flipped = chain.reversed().knot()
    assert (flipped.name, flipped.chirality) == (found.name, found.chirality)
    ring = strand.Chain(make_closed_braid(BRAIDS["7_6"][0]) * 0.05, R, True)
    assert (ring.knot().name, ring.knot().probability, ring.knot().core) == ("7_6", 1.0, None)
    assert draw_circle(0.05, 40, True).knot().name == "0_1"
    uncertain = chain.knot(crossings=[(0.1, 0.25, 0.9)])
    assert uncertain.probability == pytest.approx(0.9 * found.probability)


def test_an_open_rope_that_ends_where_it_begins_is_a_ring():
    ring = make_closed_braid(BRAIDS["5_2"][0])
    assert strand.knot(np.vstack([ring, ring[:1]])).probability == 1.0


@pytest.mark.parametrize(
    ("points", "closed", "message"),
    [
        (np.empty((0, 3)), False, "points: expected at least two nodes, got 0"),
        (np.empty((0, 3)), True, "points: expected at least three nodes of a closed chain, got 0"),
        (np.zeros((1, 3)), False, "at least two nodes, got 1"),
        ([[0, 0, 0], [1.0, 0, 0]], True, "at least three nodes of a closed chain, got 2"),
        (np.zeros((2, 2)), False, "points"),
        (np.zeros((5, 3)), False, "no two equal nodes in a row, but rows 0 and 1 are"),
        ([[0, 0, 0], [1, 0, 0], [np.nan, 0, 0]], False, "points"),
        ([[0, 0, 0], [1, 0, 0], [np.inf, 0, 0]], True, "points"),
        ([[0, 0, 0], [1, 0, 0], [0, 1.0, 0], [0, 0, 0]], True, "without its first node again at the end"),
    ],
)
def test_what_is_no_rope_is_refused(points, closed, message):
    with pytest.raises(ValueError, match=message):
        strand.knot(points, closed)


def test_a_curve_that_meets_itself_supports_no_answer():
    with pytest.raises(strand.NotEnoughDataError, match="points: the curve meets itself"):
        strand.knot(make_closed_braid((1, 1, 1)) * [1, 1, 0], True)


def test_arguments_of_the_wrong_kind_are_refused():
    with pytest.raises(TypeError, match="closed"):
        strand.knot(shape("loop"), "yes")
    with pytest.raises(TypeError, match="points"):
        strand.knot(None)


def draw_ring(centre=(0.0, 0.0, 0.0), upright=False, nodes=50):
    angle = np.linspace(0, 2 * np.pi, nodes, endpoint=False)
    flat = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    return (flat[:, [0, 2, 1]] if upright else flat) + centre


def draw_winding(times, nodes=400):
    """A ring that winds round `draw_ring()` so many times as a right-handed screw does."""
    angle = np.linspace(0, 2 * np.pi, nodes, endpoint=False)
    around = 1 + 0.3 * np.cos(times * angle)
    return np.stack([around * np.cos(angle), around * np.sin(angle), -0.3 * np.sin(times * angle)], axis=1)


def sum_signs(a, b):
    """Return the sum of the signs of two closed polylines' crossings, seen along z, where a is above."""
    total = 0
    for p, q in zip(a, np.roll(a, -1, axis=0), strict=True):
        for r, s in zip(b, np.roll(b, -1, axis=0), strict=True):
            along, across, apart = q - p, s - r, r - p
            size = along[0] * across[1] - along[1] * across[0]
            t = (apart[0] * across[1] - apart[1] * across[0]) / size
            u = (apart[0] * along[1] - apart[1] * along[0]) / size
            if 0 < t < 1 and 0 < u < 1 and p[2] + t * along[2] > r[2] + u * across[2]:
                total += 1 if size > 0 else -1
    return total


@pytest.mark.parametrize("times", [-3, -1, 0, 1, 2, 5])
def test_rings_that_wind_round_each_other(times):
    assert strand.linking_number(draw_ring(), draw_winding(times)) == times
    assert strand.linking_number(draw_winding(times), draw_ring()) == times
    assert strand.linking_number(draw_ring()[::-1], draw_winding(times)) == -times
    assert strand.linking_number(draw_ring() * [1, 1, -1], draw_winding(times) * [1, 1, -1]) == -times


def test_random_polygons_are_linked_as_their_crossings_say():
    rng = np.random.default_rng(2)
    numbers = set()
    for _ in range(15):
        a, b = rng.normal(size=(2, 12, 3))
        found = strand.linking_number(a, b)
        assert found == sum_signs(a, b) == sum_signs(b, a)
        numbers.add(found)
    assert len(numbers) > 2


def test_chains_know_whether_they_are_closed():
    flat, linked = draw_ring(), draw_ring((1.0, 0.0, 0.0), upright=True)
    number = strand.linking_number(flat, linked)
    assert abs(number) == 1
    closed = [strand.Chain(nodes, 0.1, True) for nodes in (flat, linked)]
    assert strand.linking_number(*closed) == strand.linking_number(closed[0], linked) == number
    # an open chain lacks its last step: the integral is no whole number
    cut = strand.Chain(linked, 0.1)
    open_one = strand.linking_number(closed[0], cut)
    assert 0.5 < open_one * number < 1
    assert strand.linking_number(flat, linked, closed=False) != open_one


def test_a_long_straight_rope_through_a_ring():
    line = [[0.1, 0.0, -1e3], [0.0, 0.1, 1e3]]
    through = strand.linking_number(strand.Chain(draw_ring(), R, True), strand.Chain(line, R))
    assert abs(through) == pytest.approx(1.0, abs=1e-4)
    beside = strand.linking_number(
        strand.Chain(draw_ring(), R, True), strand.Chain([[5, 0, -9.0], [5, 0, 9.0]], R)
    )
    assert beside == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        (draw_ring()[:2], draw_ring(), "a: expected at least three nodes of a closed chain, got 2"),
        (
            draw_ring(),
            np.vstack([draw_ring(), draw_ring()[:1]]),
            "b: expected a closed chain without its first node",
        ),
        (draw_ring(), np.zeros((4, 3)), "b: expected no two equal nodes in a row"),
        (draw_ring() * [1, np.nan, 1], draw_ring(), "a"),
        (draw_ring(), draw_ring()[:, :2], "b"),
        (draw_ring(nodes=20_000), draw_ring(nodes=20_000) + 3, "b: expected at most 100000000 pairs"),
    ],
)
def test_linking_of_what_is_no_rope_is_refused(a, b, message):
    with pytest.raises(ValueError, match=message):
        strand.linking_number(a, b)


def test_a_flag_is_a_flag():
    with pytest.raises(TypeError, match="closed"):
        strand.linking_number(draw_ring(), draw_ring() + 3, closed="both")
