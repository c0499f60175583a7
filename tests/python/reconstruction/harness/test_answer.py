"""Ropes that branch, from views to the graph."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand import _core
from strand.synthetic import Camera, Noise, harness

CAMERA = Camera(size=(480, 360))
RADII = 3.0  # a node is at its place, and an edge along its line, if no farther away


def look(kind, seed, **options):
    made = harness(kind, seed=seed, views=3, camera=CAMERA, noise=Noise(depth=0.0003))
    options = {"radius": sorted(set(made.radii)), **options}
    return made, strand.reconstruct(made.views, bounds=made.bounds, branches=True, **options)


def match_nodes(made, found):
    """Return the found node at each true one."""
    used = sorted({node for pair in made.edges for node in pair})
    places = np.array([node.position for node in found.nodes])
    nearest = {node: int(np.linalg.norm(places - made.nodes[node], axis=1).argmin()) for node in used}
    for node, other in nearest.items():
        assert np.linalg.norm(places[other] - made.nodes[node]) < RADII * max(made.radii)
    assert sorted(nearest.values()) == list(range(len(found.nodes)))
    return nearest


def check_graph(made, model):
    found = model.harness
    nearest = match_nodes(made, found)
    pairs = sorted(tuple(sorted((nearest[a], nearest[b]))) for a, b in made.edges)
    assert pairs == sorted(tuple(sorted((edge.start, edge.stop))) for edge in found.edges)
    for (a, b), line in zip(made.edges, made.truth, strict=True):
        length = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
        ends = {nearest[a], nearest[b]}
        same = [edge.length for edge in found.edges if {edge.start, edge.stop} == ends]
        assert min(abs(np.array(same) - length)) < 0.05 * length


@pytest.mark.parametrize(("kind", "seed"), [("tree", 0), ("equal", 1), ("cross", 1), ("laid", 0)])
def test_graphs_are_as_drawn(kind, seed):
    made, model = look(kind, seed)
    check_graph(made, model)
    assert model.confidence > 0.5


@pytest.mark.parametrize(("kind", "seed"), [("near", 28), ("loop", 24)])
def test_one_view_hides_what_a_look_from_its_camera_shows(kind, seed):
    made = harness(kind, seed=seed, views=1, noise=Noise(depth=0.0005))
    model = strand.reconstruct(made.views, sorted(set(made.radii)), made.bounds, branches=True)
    check_graph(made, model)
    # the look from above shows another graph
    assert 0.3 < model.confidence < 0.9


@pytest.mark.parametrize(
    ("kind", "seed", "views"),
    [
        # a thin strand lies hidden under a long stretch of a thick one
        ("near", 1109036, 7),
        # two strands cross at a small angle, so that each side looks like an end under the other
        ("near", 1071011, 3),
        ("near", 1091005, 7),
        # an end lies on a bend of the strand below
        ("laid", 1091037, 7),
        # the way between an end on a strand and a junction is as narrow as one strand
        ("laid", 1160015, 7),
        # the last tie lies behind the place where the mask narrows
        ("tied", 1106035, 3),
        # a tie lifts the end of the branch that it holds
        ("tied", 1121024, 7),
        # a branch runs beside the trunk before it leaves
        ("tang", 1173020, 7),
    ],
)
def test_graphs_are_right_where_places_are_hard_to_read(kind, seed, views):
    check_scene(harness(kind, seed=seed, views=views, noise=Noise(depth=0.0005)))


def test_a_tie_that_holds_a_wire_to_itself_is_one_junction():
    check_scene(harness("loop", seed=1091047, views=3, noise=Noise(depth=0.000916)))


def test_a_rope_that_bends_through_a_crossing_has_no_ends_there():
    check_scene(harness("rope", seed=1106051, views=3, noise=Noise(depth=0.000647)))


def check_scene(made):
    radii = sorted({round(radius, 5) for radius in made.radii})
    model = strand.reconstruct(made.views, radii, made.bounds, branches=True)
    check_graph(made, model)


def test_the_models_chains_are_the_edges():
    _, model = look("tree", 1)
    edges = model.harness.edges
    assert [edge.chain for edge in edges] == list(model.chains)
    for edge in edges:
        for node, place in ((edge.start, edge.chain.points[0]), (edge.stop, edge.chain.points[-1])):
            np.testing.assert_allclose(model.harness.nodes[node].position, place, atol=edge.radius)
    for node in model.harness.nodes:
        assert (np.linalg.eigvalsh(node.covariance) >= -1e-15).all()
        assert 0.0 < node.confidence <= 1.0


def test_a_rope_is_a_graph_of_one_edge():
    scene = strand.synthetic.scene("s", views=3)
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds, branches=True)
    (edge,) = model.harness.edges
    assert [node.kind for node in model.harness.nodes] == ["end", "end"]
    assert edge.length == pytest.approx(
        np.linalg.norm(np.diff(scene.truth[0], axis=0), axis=1).sum(), rel=0.02
    )


@pytest.mark.parametrize("seed", [29, 62017])
def test_ropes_that_end_on_a_rope_have_no_junction(seed):
    made, model = look("rope", seed)
    assert [node.kind for node in model.harness.nodes] == ["end"] * 2 * len(made.edges)
    lengths = sorted(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in made.truth)
    np.testing.assert_allclose(sorted(edge.length for edge in model.harness.edges), lengths, atol=0.006)


@pytest.mark.parametrize(("kind", "seed"), [("near", 100), ("near", 111), ("cross", 103), ("cross", 111)])
def test_strands_that_cross_near_junctions_are_told_apart(kind, seed):
    made, model = look(kind, seed)
    check_graph(made, model)
    assert model.confidence > 0.7


def test_a_tie_makes_a_junction_of_a_loop():
    made, model = look("loop", 62001)
    check_graph(made, model)


def test_wires_are_counted():
    made = harness("tree", seed=0, views=3, camera=CAMERA, noise=Noise(depth=0.0003))
    wire = made.radii[0] / np.sqrt(made.wires[0])
    model = strand.reconstruct(made.views, sorted(set(made.radii)), made.bounds, branches=True, wire=wire)
    nearest = match_nodes(made, model.harness)
    truth = {
        frozenset((nearest[a], nearest[b])): wires
        for (a, b), wires in zip(made.edges, made.wires, strict=True)
    }
    assert {frozenset((edge.start, edge.stop)): edge.wires for edge in model.harness.edges} == truth


def test_the_bits_are_the_same_for_any_number_of_threads():
    threads = _core.num_threads()
    try:
        saved = []
        for count in (1, 2):
            _core.set_num_threads(count)
            _, model = look("tree", 2)
            saved.append([chain.points.tobytes() for chain in model.chains])
    finally:
        _core.set_num_threads(threads)
    assert saved[0] == saved[1]


def look_down(height, shape):
    """Return a view of a table, and of what is nearer to the camera where a function of pixels says so."""
    rows, columns = np.mgrid[:480, :640]
    raised = shape(rows - 240, columns - 320)
    rng = np.random.default_rng(0)
    depth = np.where(raised, 0.6 - height, 0.6) + 0.0005 * rng.normal(size=raised.shape)
    intrinsics = np.array([[450.0, 0.0, 319.5], [0.0, 450.0, 239.5], [0.0, 0.0, 1.0]])
    return strand.View.from_depth(depth, intrinsics=intrinsics, mask=raised)


@pytest.mark.parametrize("radius", [None, 0.003])
@pytest.mark.parametrize(
    "shape",
    [
        lambda y, x: (x / 150.0) ** 2 + (y / 100.0) ** 2 < 1.0,
        lambda y, x: (abs(x) < 180) & (abs(y) < 180) & ((x % 24 < 5) | (y % 24 < 5)),
    ],
    ids=["plate", "net"],
)
def test_plates_and_nets_are_refused(shape, radius):
    with pytest.raises(strand.StrandError):
        strand.reconstruct([look_down(0.006, shape)], radius, branches=True)


@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"wire": 0.002}, "wire"),
        ({"branches": True, "ropes": 2}, "branches"),
        ({"branches": True, "length": 0.4}, "branches"),
        ({"branches": True, "config": strand.Config(method="published")}, "branches"),
        ({"branches": True, "wire": -1.0}, "wire"),
    ],
)
def test_arguments_that_exclude_each_other_are_refused(options, argument):
    scene = strand.synthetic.scene("s", views=1)
    with pytest.raises(ValueError, match=f"^{argument}: "):
        strand.reconstruct(scene.views, scene.radius, scene.bounds, **options)
