"""Tests of the figures of the stages."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from PIL import Image

from strand import Chain, Model, TubeFit, figures
from strand.ropes.notebook import PALETTE

RADIUS = 0.004
S = np.linspace(0.0, 0.2, 41)
LINE = np.stack([S - 0.1, 0.02 * np.sin(30 * S), 0.005 + 0.003 * np.cos(40 * S)], axis=1)


def make_tube(seed):
    """Return points and outward normals of the upper half of a tube around LINE."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0.0, np.pi, 800)
    normals = np.stack([np.zeros(800), np.cos(angle), np.sin(angle)], axis=1)
    return LINE[rng.integers(len(LINE), size=800)] + RADIUS * normals, normals


def make_model(**changes):
    clouds, normals = zip(*(make_tube(seed) for seed in range(3)), strict=True)
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, 3] = [[-0.3, -0.3, 0.5], [0, -0.3, 0.5], [0.3, -0.3, 0.5]]
    stages = {
        "raw": clouds,
        "filtered": clouds,
        "normals": normals,
        "registered": clouds,
        "axis_points": LINE[np.arange(400) % len(LINE)],
        "traced": (LINE[:20], LINE[20:]),
        "separation": (np.full(20, np.inf), np.abs(np.arange(21) - 8.0) / 1000),
        "cuts": (np.array([], dtype=np.intp), np.array([8])),
        "segments": (LINE[:20], LINE[20:27], LINE[30:]),
    }
    chains = changes.pop("chains", (Chain(LINE, RADIUS),))
    return Model(chains, poses, {}, (), stages | changes, method="published")


def make_chain(points=LINE, bridged=(20, 30), closed=False):
    """Return a chain of the default method with a stretch of nodes without points."""
    counts = np.full(len(points), 5)
    counts[slice(*bridged)] = 0
    covariance = np.tile(np.diag([1e-8, 4e-8, 9e-8]), (len(points), 1, 1))
    return Chain(points, RADIUS, closed, None, covariance, counts, np.minimum(counts, 3))


def make_tube_model(explained=0.9, **changes):
    """Return a model of the default method, answered by tubes."""
    clouds = [make_tube(seed)[0] for seed in range(3)]
    points = np.concatenate(clouds)
    rng = np.random.default_rng(0)
    count = len(points)
    residual = rng.normal(0.0, 3e-4, count)
    is_explained = rng.random(count) < explained
    residual[~is_explained] = np.inf
    fit = TubeFit(
        curves=[LINE[::4]],
        motions=np.tile(np.eye(4), (3, 1, 1)),
        radius_classes=np.zeros(1, dtype=np.int64),
        radii=np.array([RADIUS]),
        radii_sd=np.zeros(1),
        sigma=3e-4,
        bands=np.array([1.5e-3]),
        points=points,
        to_camera=np.tile([0.0, 0.0, 1.0], (count, 1)),
        view=np.repeat(np.arange(3), count // 3),
        curve=np.zeros(count, dtype=np.int64),
        parameter=rng.uniform(0.0, 8.0, count),
        residual=residual,
        facing=np.ones(count),
        weight=np.ones(count),
        explained=is_explained,
        inlier=is_explained & (np.abs(residual) < 1.5e-3),
        pose_covariance=np.zeros((3, 6, 6)),
        covariances=[],
    )
    stages = {
        "raw": clouds,
        "filtered": clouds,
        "registered": clouds,
        "arcs": (LINE[:20], LINE[30:]),
        "fit": fit,
    }
    chains = changes.pop("chains", (make_chain(),))
    return Model(chains, make_model().poses, {}, (), stages | changes, method="default", branch="tubes")


PUBLISHED_FIGURES = [
    "1-raw.png",
    "2-filtered.png",
    "3-normals.png",
    "4-registered.png",
    "5-axis-points.png",
    "6-chains.png",
    "7-separation.png",
    "8-segments.png",
    "9-strings.png",
    "10-cameras.png",
]
FIGURES = [
    "1-raw.png",
    "2-filtered.png",
    "3-registered.png",
    "4-arcs.png",
    "5-ropes.png",
    "6-residuals.png",
    "7-uncertainty.png",
    "8-cameras.png",
]


@pytest.mark.parametrize(
    ("model", "names"), [(make_model(), PUBLISHED_FIGURES), (make_tube_model(), FIGURES)]
)
def test_writes_one_figure_a_stage(tmp_path, model, names):
    paths = figures.write_figures(model, tmp_path / "new" / "folder", truth=[LINE.astype(np.float32)])
    assert [path.name for path in paths] == names
    assert set((tmp_path / "new" / "folder").iterdir()) == set(paths)
    for path in paths:
        with Image.open(path) as image:
            image.load()
            assert image.width == 1200
            assert 200 < image.height < 1600
            assert len(image.convert("RGB").getcolors(image.width * image.height)) > 20
        assert path.stat().st_size < 400_000


def test_needs_the_stages(tmp_path):
    model = Model((Chain(LINE, RADIUS),), np.eye(4)[None])
    with pytest.raises(ValueError, match="model: expected one with its stages"):
        figures.write_figures(model, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_folder_that_is_a_file(tmp_path):
    (tmp_path / "out").write_bytes(b"")
    with pytest.raises(FileExistsError):
        figures.write_figures(make_model(), tmp_path / "out")


def test_names_the_missing_package(tmp_path, monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ImportError, match=r'matplotlib is needed here: pip install "[\w.-]+\[cli\]"'):
        figures.plot_over_points(make_model(), LINE, tmp_path / "a.png")
    assert not list(tmp_path.iterdir())


def test_leaves_global_state_of_matplotlib_alone(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    figures.plot_over_points(make_model(), LINE, tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 0


def test_same_model_same_bytes(tmp_path):
    for name in ("a.png", "b.png"):
        figures.plot_over_points(make_model(), LINE, tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


@pytest.mark.parametrize("upper", [0, 1])
def test_upper_strand_crosses_over_the_lower_one(tmp_path, upper):
    s = np.linspace(-0.1, 0.1, 21)[:, None]
    height = [0.0, 0.0]
    height[upper] = 0.02
    strands = (s * [1, 1, 0] + [0, 0, height[0]], s * [1, -1, 0] + [0, 0, height[1]])
    model = make_model(chains=tuple(Chain(strand, RADIUS) for strand in strands))
    figures.plot_over_points(model, np.vstack(strands), tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    colours = [np.array([int(c[i : i + 2], 16) for i in (1, 3, 5)]) for c in PALETTE[:2]]
    near = [np.abs(pixels - colour).max(axis=2) < 12 for colour in colours]
    # the crossing is in the middle of both strands; the legend is below
    rows, columns = np.nonzero((near[0] | near[1])[:-100])
    v, u = (rows.min() + rows.max()) // 2, (columns.min() + columns.max()) // 2
    assert near[upper][v, u]
    assert not near[1 - upper][v, u]


@pytest.mark.parametrize(
    ("draw", "changes"),
    [
        (figures.draw_separation, {"chains": ()}),
        (figures.draw_separation, {"separation": (np.full(20, np.inf), np.full(21, np.inf))}),
        (
            figures.draw_separation,
            {"traced": (LINE,) * 20, "separation": (LINE[:, 0] + 1,) * 20, "cuts": (np.array([3]),) * 20},
        ),
        (figures.draw_segments, {"chains": ()}),
        (figures.draw_segments, {"segments": (LINE[:2],)}),
        (figures.draw_chains, {"traced": tuple(LINE[i : i + 3] for i in range(30))}),
        (figures.draw_cameras, {"chains": ()}),
        (figures.draw_cameras, {"chains": (Chain(LINE[:30], RADIUS, closed=True),) * 6}),
        (figures.draw_ropes, {"chains": ()}),
        (figures.draw_ropes, {"chains": (Chain(LINE[:30], RADIUS, closed=True),) * 6}),
        (figures.draw_raw, {"raw": tuple(make_tube(0)[0][:30] for _ in range(40))}),
        (figures.draw_raw, {"raw": (LINE[:1],)}),
    ],
)
def test_draws_odd_models(draw, changes):
    figure = draw(make_model(**changes))
    figure.draw_without_rendering()
    assert figure.axes or figure.texts


@pytest.mark.parametrize(
    ("draw", "changes"),
    [
        (figures.draw_arcs, {"arcs": ()}),
        (figures.draw_arcs, {"arcs": (LINE[:2],) * 12}),
        (figures.draw_ropes, {"chains": ()}),
        (figures.draw_ropes, {"chains": (make_chain(bridged=(0, 41)),)}),
        (figures.draw_residuals, {"explained": 0.0}),
        (figures.draw_residuals, {"explained": 1.0}),
        (figures.draw_uncertainty, {"chains": ()}),
        (figures.draw_uncertainty, {"chains": (make_chain(LINE[:2], bridged=(0, 2)),)}),
        (figures.draw_uncertainty, {"chains": (make_chain(LINE[:30], closed=True), make_chain()) * 10}),
    ],
)
def test_draws_odd_models_of_the_default_method(draw, changes):
    figure = draw(make_tube_model(**changes))
    figure.draw_without_rendering()
    assert figure.axes or figure.texts


def test_residuals_are_on_a_scale_about_zero():
    low, high = figures.draw_residuals(make_tube_model()).axes[-1].get_ylim()
    assert high == pytest.approx(3 * 0.3)
    assert low == -high


def test_uncertainty_is_that_of_the_worst_direction():
    below, above = figures.draw_uncertainty(make_tube_model()).axes
    deviations, bridged = above.get_lines()
    np.testing.assert_allclose(deviations.get_ydata(), 0.3)
    np.testing.assert_allclose(bridged.get_xdata(), 1e3 * make_chain().arc_length[20:30])
    (marks,) = below.get_lines()
    assert len(marks.get_xdata()) == 10


@pytest.mark.parametrize(("bridged", "marked"), [((0, 0), False), ((20, 30), True)])
def test_bridged_nodes_are_marked_and_named(bridged, marked):
    for draw in (figures.draw_ropes, figures.draw_uncertainty):
        (legend,) = draw(make_tube_model(chains=(make_chain(bridged=bridged),))).legends
        assert ("node without points" in [text.get_text() for text in legend.get_texts()]) == marked


def test_stray_points_do_not_make_a_figure_endless():
    points = np.array([[0.0, 0.0, 0.0], [0.0, 50.0, 0.01], [0.001, 0.0, 9.0]])
    width, height = figures.draw_raw(make_model(raw=(points,))).get_size_inches()
    assert (width, height < 10) == (8, True)
