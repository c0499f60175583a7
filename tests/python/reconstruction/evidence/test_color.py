"""Colours: segments that differ in colour are not joined."""

from __future__ import annotations

import numpy as np

import strand
from shared.ropes import R
from strand import View
from strand.reconstruction.evidence.color import ArcColors, collect_colors
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.outliers import drop_outliers
from strand.reconstruction.tubes.join_costs import price_joins

RED = (0.8, 0.15, 0.1)
BLUE = (0.1, 0.2, 0.7)
ORANGE = (0.8, 0.45, 0.1)


def test_views_with_and_without_colours_go_together():
    plain, red = View(np.ones((2, 3))), View(np.ones((1, 3)), colors=np.array([RED]))
    assert collect_colors([plain, plain]) is None
    np.testing.assert_array_equal(collect_colors([plain, red]), [[np.nan] * 3] * 2 + [list(RED)])


def coloured(scene, paints, views=None):
    """The scene's views, painted: each point with the colour of the nearest rope, shaded and noisy."""
    rng = np.random.default_rng(0)
    painted = []
    for view in scene.views if views is None else views:
        cropped = view.crop(scene.bounds)
        points = cropped.world_points
        nodes = np.concatenate(scene.truth)
        paint = np.repeat(np.array(paints), [len(chain) for chain in scene.truth], axis=0)
        nearest = np.concatenate(
            [
                np.linalg.norm(some[:, None] - nodes[None], axis=2).argmin(axis=1)
                for some in np.array_split(points, max(len(points) // 500, 1))
            ]
        )
        # light from above: the sides are darker
        shade = 0.6 + 0.4 * np.clip((points[:, 2] - nodes[nearest, 2]) / R, 0.0, 1.0)
        colors = paint[nearest] * shade[:, None] + rng.normal(scale=0.03, size=points.shape)
        painted.append(View(cropped.points, cropped.pose, colors=np.clip(colors, 0.0, 1.0)))
    return painted


def facing():
    """Two ropes in a line whose ends face each other across a gap of 6 radii."""
    x = np.linspace(-0.13, -3.0 * R, 300)
    ends = [np.stack([sign * x, 0 * x, 0 * x + R], axis=1) for sign in (1.0, -1.0)]
    return strand.synthetic.scene(chains=ends, seed=1, views=3)


def test_ropes_of_two_colours_are_not_joined_over_a_gap():
    scene = facing()
    plain = [view.crop(scene.bounds) for view in scene.views]
    assert len(strand.reconstruct(plain, R).chains) == 1
    for paints, count in (((RED, BLUE), 2), ((RED, ORANGE), 2), ((RED, RED), 1), ((BLUE, BLUE), 1)):
        model = strand.reconstruct(coloured(scene, paints), R)
        assert len(model.chains) == count, paints
    (chain,) = strand.reconstruct(coloured(scene, (RED, RED)), R).chains
    np.testing.assert_allclose(chain.length, 0.26, rtol=0.01)


def test_colours_say_which_ends_go_together_across_a_gap():
    """Two ropes that cross in a gap that nobody sees: without colours they go straight on."""
    half = 0.03
    y = np.linspace(-half - 0.1, half + 0.1, 800)
    t = np.clip(0.5 + 0.5 * y / half, 0.0, 1.0)
    x = 0.012 * (1.0 - 2.0 * t**3 * (10.0 - 15.0 * t + 6.0 * t * t))
    lift = R + 2.2 * R * np.sin(np.pi * t) ** 2
    truth = [np.stack([x, y, np.full(len(y), R)], axis=1), np.stack([-x, y, lift], axis=1)]
    scene = strand.synthetic.scene(chains=truth, seed=2, views=3)

    def seen(views):
        return [view.select(np.abs(view.world_points[:, 1]) > half) for view in views]

    plain = [view.crop(scene.bounds) for view in scene.views]
    for views, crosses in (
        (plain, False),
        (coloured(scene, (RED, RED)), False),
        (coloured(scene, (RED, BLUE)), True),
        (coloured(scene, (RED, BLUE))[:1] + plain[1:], True),
    ):
        model = strand.reconstruct(seen(views), R, ropes=2)
        crossed = [chain.points[0, 0] * chain.points[-1, 0] < 0 for chain in model.chains]
        assert crossed == [crosses] * 2


def test_colours_hardly_change_what_ropes_of_one_colour_become():
    scene = strand.synthetic.scene("paper", seed=3)
    plain = strand.reconstruct([view.crop(scene.bounds) for view in scene.views], R)
    model = strand.reconstruct(coloured(scene, [RED]), R)
    np.testing.assert_array_equal(model.chains[0].points, plain.chains[0].points)
    assert abs(model.confidence - plain.confidence) < 0.1


def test_the_contrast_counts_in_spreads_of_colour_within_segments():
    scene = facing()
    config = strand.Config()
    views = coloured(scene, (RED, BLUE))
    model = strand.reconstruct(views, R, config=config, keep_stages=True)
    views = drop_outliers(views, R, config.filter, published=False)
    fit, arcs = model.stages["fit"], [chain.points for chain in model.chains]
    colors = ArcColors.from_fit(fit, collect_colors(views))
    contrast = colors.price_joins(arcs, R)
    np.testing.assert_allclose(contrast, contrast.T)
    assert contrast[0, 1] < 0.5
    assert contrast[2, 3] < 0.5
    assert contrast[:2, 2:].min() > 10.0
    far = [arc + 1.0 for arc in arcs]
    assert (colors.price_joins(far, R) == 0.0).all()
    nowhere = np.full(fit.points.shape, np.nan)
    assert (ArcColors.from_fit(fit, nowhere).price_joins(arcs, R) == 0.0).all()
    assert price_joins(arcs, JoinEvidence(R, config.linking)).costs
    assert not price_joins(arcs, JoinEvidence(R, config.linking, colors=colors)).costs
