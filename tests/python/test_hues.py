"""Colours: views carry them, and pieces that differ in colour are not joined."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from PIL import Image

import strand
from strand import FileFormatError, View, load_scene
from strand.hues import Hues, colors_of
from strand.linking import Links
from strand.outliers import without_outliers

R = 0.0042
K = np.array([[300.0, 0, 3.0], [0, 300.0, 2.0], [0, 0, 1.0]])
RED, BLUE, ORANGE = (0.8, 0.15, 0.1), (0.1, 0.2, 0.7), (0.8, 0.45, 0.1)


def test_a_depth_image_brings_the_colours_of_its_pixels():
    depth = np.zeros((4, 6))
    depth[1, 2], depth[3, 5], depth[0, 0] = 0.5, 0.6, np.nan
    colors = np.random.default_rng(0).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    view = View.from_depth(depth, K, colors=colors)
    np.testing.assert_array_equal(view.colors, colors[[1, 3], [2, 5]] / 255.0)
    np.testing.assert_array_equal(View.from_depth(depth, K, colors=colors / 255.0).colors, view.colors)
    cropped = view.crop(([-1.0, -1.0, 0.55], [1.0, 1.0, 1.0]))
    np.testing.assert_array_equal(cropped.colors, view.colors[1:])
    assert cropped.dropped == 1
    assert View.from_depth(depth, K).colors is None


def test_colours_belong_to_the_view():
    points, colors = np.zeros((2, 3)), np.full((2, 3), 0.5)
    view = View(points, colors=colors)
    colors[:] = 0.0
    assert (view.colors == 0.5).all()
    world = View.from_world(points, [0.0, 0.0, 1.0], np.full((2, 3), 255, dtype=np.uint8))
    assert (world.colors == 1.0).all()


@pytest.mark.parametrize(
    ("colors", "error", "message"),
    [
        (np.zeros((3, 3)), ValueError, r"colors: expected shape \(2, 3\)"),
        (np.zeros((2, 4)), ValueError, r"colors: expected shape \(2, 3\)"),
        (np.full((2, 3), 1.5), ValueError, "colors: expected colours from 0 to 1"),
        (np.full((2, 3), -0.5), ValueError, "colors: expected colours from 0 to 1"),
        (np.full((2, 3), np.nan), ValueError, "colors: expected finite"),
        (np.zeros((2, 3), dtype=np.int64), TypeError, "colors: expected floating point"),
    ],
)
def test_wrong_colours_are_refused(colors, error, message):
    with pytest.raises(error, match=message):
        View(np.zeros((2, 3)), colors=colors)


def test_views_with_and_without_colours_go_together():
    plain, red = View(np.zeros((2, 3))), View(np.zeros((1, 3)), colors=np.array([RED]))
    assert colors_of([plain, plain]) is None
    np.testing.assert_array_equal(colors_of([plain, red]), [[np.nan] * 3] * 2 + [list(RED)])


def coloured(scene, paints, views=None):
    """The scene's views, painted: each point with the colour of the nearest string, shaded and noisy."""
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
        painted.append(dataclasses.replace(cropped, colors=np.clip(colors, 0.0, 1.0)))
    return painted


def facing():
    """Two strings in a line whose ends face each other across a gap of 6 radii."""
    x = np.linspace(-0.13, -3.0 * R, 300)
    ends = [np.stack([sign * x, 0 * x, 0 * x + R], axis=1) for sign in (1.0, -1.0)]
    return strand.synthetic.scene(chains=ends, seed=1, views=3)


def test_strings_of_two_colours_are_not_joined_over_a_gap():
    scene = facing()
    plain = [view.crop(scene.bounds) for view in scene.views]
    assert len(strand.reconstruct(plain, R).chains) == 1
    for paints, count in (((RED, BLUE), 2), ((RED, ORANGE), 2), ((RED, RED), 1), ((BLUE, BLUE), 1)):
        model = strand.reconstruct(coloured(scene, paints), R)
        assert len(model.chains) == count, paints
    (chain,) = strand.reconstruct(coloured(scene, (RED, RED)), R).chains
    np.testing.assert_allclose(chain.length, 0.26, rtol=0.01)


def test_colours_say_which_ends_go_together_across_a_gap():
    """Two strings that cross in a gap that nobody sees: without colours they go straight on."""
    half = 0.03
    y = np.linspace(-half - 0.1, half + 0.1, 800)
    t = np.clip(0.5 + 0.5 * y / half, 0.0, 1.0)
    x = 0.012 * (1.0 - 2.0 * t**3 * (10.0 - 15.0 * t + 6.0 * t * t))
    lift = R + 2.2 * R * np.sin(np.pi * t) ** 2
    truth = [np.stack([x, y, np.full(len(y), R)], axis=1), np.stack([-x, y, lift], axis=1)]
    scene = strand.synthetic.scene(chains=truth, seed=2, views=3)

    def seen(views):
        return [view.only(np.abs(view.world_points[:, 1]) > half) for view in views]

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


def test_colours_hardly_change_what_strings_of_one_colour_become():
    scene = strand.synthetic.scene("paper", seed=3)
    plain = strand.reconstruct([view.crop(scene.bounds) for view in scene.views], R)
    model = strand.reconstruct(coloured(scene, [RED]), R)
    np.testing.assert_array_equal(model.chains[0].points, plain.chains[0].points)
    assert abs(model.confidence - plain.confidence) < 0.1


def test_the_contrast_counts_in_spreads_of_colour_within_pieces():
    scene = facing()
    config = strand.Config()
    views = coloured(scene, (RED, BLUE))
    model = strand.reconstruct(views, R, config=config, keep_stages=True)
    views = without_outliers(views, R, config.filter)
    fit, arcs = model.stages["fit"], [chain.points for chain in model.chains]
    contrast = Hues.of(fit, colors_of(views)).contrast(arcs, R)
    np.testing.assert_allclose(contrast, contrast.T)
    assert contrast[0, 1] < 0.5
    assert contrast[2, 3] < 0.5
    assert contrast[:2, 2:].min() > 10.0
    far = [arc + 1.0 for arc in arcs]
    assert (Hues.of(fit, colors_of(views)).contrast(far, R) == 0.0).all()
    nowhere = np.full(fit.points.shape, np.nan)
    assert (Hues.of(fit, nowhere).contrast(arcs, R) == 0.0).all()
    assert Links.between(arcs, R, config.linking).costs
    assert not Links.between(arcs, R, config.linking, None, Hues.of(fit, colors_of(views))).costs


def test_scene_files_hold_colour_images(tmp_path):
    scene = strand.synthetic.scene("arc", views=2)
    images = np.random.default_rng(0).integers(0, 256, (*scene.depth.shape, 3), dtype=np.uint8)
    arrays = {"depth": scene.depth, "depth_scale": scene.depth_scale, "K": scene.intrinsics}
    arrays["poses"] = scene.poses
    np.savez(tmp_path / "a.npz", **arrays, color=images)
    (fx, _, cx), (_, fy, cy), _ = scene.intrinsics.tolist()
    lines = [f"[camera]\nfx = {fx}\nfy = {fy}\ncx = {cx}\ncy = {cy}\ndepth_scale = {scene.depth_scale}"]
    for i, (depth, image) in enumerate(zip(scene.depth, images, strict=True)):
        Image.fromarray(depth).save(tmp_path / f"{i}.png")
        Image.fromarray(image).save(tmp_path / f"c{i}.png")
        pose = scene.poses[i].tolist()
        lines.append(f'[[view]]\nfile = "{i}.png"\ncolor = "c{i}.png"\npose = {pose}')
    text = "\n".join(lines)
    (tmp_path / "scene.toml").write_text(text)
    archived, described = load_scene(tmp_path / "a.npz"), load_scene(tmp_path)
    for a, b, depth, image in zip(archived.views, described.views, scene.depth, images, strict=True):
        np.testing.assert_array_equal(a.colors, image[depth > 0] / 255.0)
        np.testing.assert_array_equal(a.colors, b.colors)
    np.savez(tmp_path / "b.npz", **arrays, color=images[:, ::2])
    with pytest.raises(FileFormatError, match=r"b.npz: color: expected \(2, 240, 320, 3\) uint8"):
        load_scene(tmp_path / "b.npz")
    (tmp_path / "c0.png").write_bytes(b"no image")
    with pytest.raises(FileFormatError, match=r"c0\.png: truncated, or not a colour image"):
        load_scene(tmp_path)
    Image.fromarray(images[0, ::2]).save(tmp_path / "c0.png")
    with pytest.raises(FileFormatError, match=r"0.png: colors: expected shape \(240, 320, 3\)"):
        load_scene(tmp_path)
    np.save(tmp_path / "0.npy", np.zeros((5, 3)))
    (tmp_path / "scene.toml").write_text(text.replace('"0.png"', '"0.npy"'))
    with pytest.raises(FileFormatError, match="color: only depth images have colour images"):
        load_scene(tmp_path)
    (tmp_path / "scene.toml").write_text(text.replace('"c0.png"', "3"))
    with pytest.raises(FileFormatError, match=r"view 1\.color: expected a file's name"):
        load_scene(tmp_path)
