"""Tests of scenes in archives and folders."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from PIL import Image

import strand
from shared.scene_files import (
    CAMERA,
    DEPTH,
    IDENTITY,
    LABELS,
    POINTS,
    K,
    make_ply,
    save_npz,
    save_png,
    write_scene,
)
from strand import FileFormatError, View, load_scene


def test_npz_scene(tmp_path):
    save_npz(tmp_path / "a.npz")
    scene = load_scene(tmp_path / "a.npz")
    assert scene.name == "knot"
    assert scene.radius == 0.004
    np.testing.assert_array_equal(scene.bounds, [[-1, -2, -3], [1, 2, 3]])
    assert len(scene.views) == 2
    want = View.from_depth(DEPTH[::-1] * 0.001, K, scene.views[1].pose)
    np.testing.assert_array_equal(scene.views[1].points, want.points)
    np.testing.assert_array_equal(scene.views[1].viewpoint, [0.1, 0.2, 0.3])
    # sorted by number, not by name
    np.testing.assert_allclose(np.vstack(scene.truth), POINTS[:15], rtol=1e-6)


def test_npz_scene_with_required_keys_only(tmp_path):
    save_npz(tmp_path / "a.npz", box=None, radius=None, truth_0=None, truth_2=None, truth_10=None, name=None)
    scene = load_scene(str(tmp_path / "a.npz"))
    assert (scene.name, scene.bounds, scene.radius, scene.truth) == ("a", None, None, ())


@pytest.mark.parametrize("part", [0.0, 0.01, 0.3, 0.6, 0.9, 0.999])
def test_npz_truncated(tmp_path, part):
    save_npz(tmp_path / "whole.npz")
    data = (tmp_path / "whole.npz").read_bytes()
    (tmp_path / "a.npz").write_bytes(data[: int(part * len(data))])
    with pytest.raises(FileFormatError, match=r"a\.npz.*(empty|truncated)"):
        load_scene(tmp_path / "a.npz")


def test_npz_damaged(tmp_path):
    save_npz(tmp_path / "whole.npz")
    data = bytearray((tmp_path / "whole.npz").read_bytes())
    data[60:80] = bytes(20)
    (tmp_path / "a.npz").write_bytes(data)
    with pytest.raises(FileFormatError, match=r"a\.npz"):
        load_scene(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"depth": None}, "missing depth"),
        ({"poses": None, "K": None}, "missing K, poses"),
        ({"depth": DEPTH}, r"depth: expected \(V, H, W\) uint16"),
        ({"depth": np.stack([DEPTH, DEPTH]).astype(float)}, r"depth: expected \(V, H, W\) uint16"),
        ({"poses": np.eye(4)[None]}, r"poses: expected \(2, 4, 4\)"),
        ({"poses": np.ones((2, 4, 4))}, "pose: expected"),
        ({"K": np.eye(2)}, r"K: expected \(3, 3\)"),
        ({"depth_scale": np.float64(0)}, "depth_scale: expected one positive number"),
        ({"radius": np.float64(-1)}, "radius: expected one positive number"),
        ({"radius": np.array("wide")}, "radius: expected one positive number"),
        ({"box": np.array([[1.0, 1, 1], [0, 0, 0]])}, "bounds: expected low < high"),
        ({"truth_0": np.zeros((4, 2))}, "truth_0: expected shape"),
        ({"K": np.array([None])}, "pickle"),
        ({"stamps": np.zeros(3)}, r"stamps: expected \(2,\), got \(3,\)"),
        ({"stamps": np.array([0.0, np.nan])}, "stamps: expected finite numbers"),
        ({"stamps": np.array([0, 10**18])}, r"stamps\[1\]: expected seconds, got .* as large as nanoseconds"),
        ({"stamps": np.array(["a", "b"])}, "stamps: expected numbers"),
        ({"mask": LABELS}, r"mask: expected \(2, 6, 8\) of bools or whole numbers, got \(6, 8\) uint8"),
        ({"mask": np.ones((2, 6, 8))}, r"mask: expected .* got \(2, 6, 8\) float64"),
        ({"mask": np.full((2, 6, 8), -1)}, "mask: expected labels from 0"),
    ],
)
def test_npz_with_wrong_content(tmp_path, changes, message):
    save_npz(tmp_path / "a.npz", **changes)
    with pytest.raises(FileFormatError, match=rf"a\.npz: .*{message}"):
        load_scene(tmp_path / "a.npz")


def test_npz_with_stamps(tmp_path):
    save_npz(tmp_path / "a.npz")
    assert [view.stamp for view in load_scene(tmp_path / "a.npz").views] == [None, None]
    save_npz(tmp_path / "a.npz", stamps=np.array([1732715999.5, 12]))
    assert [view.stamp for view in load_scene(tmp_path / "a.npz").views] == [1732715999.5, 12.0]


def test_stored_scene(data):
    scene = load_scene(data / "scenes" / "two_ropes.npz")
    assert len(scene.views) == 7
    assert len(scene.truth) == 2
    assert scene.radius == pytest.approx(0.0042)


@pytest.mark.parametrize("name", ["no.npz", "no", "no/scene.toml"])
def test_no_such_scene(tmp_path, name):
    with pytest.raises(FileNotFoundError):
        load_scene(tmp_path / name)


def test_folder_without_a_description(tmp_path):
    with pytest.raises(FileNotFoundError) as caught:
        load_scene(tmp_path)
    assert caught.value.filename == str(tmp_path / "scene.toml")


def test_other_kind_of_file(tmp_path):
    (tmp_path / "a.obj").write_bytes(b"v 1 2 3")
    with pytest.raises(FileFormatError, match=r"a\.obj: expected a folder .* \.ply, \.pcd"):
        load_scene(tmp_path / "a.obj")


def test_a_picture_has_no_depth(tmp_path):
    (tmp_path / "a.jpg").write_bytes(b"")
    with pytest.raises(FileFormatError, match=r"a\.jpg: a JPG image holds colours but no depth; expected"):
        load_scene(tmp_path / "a.jpg", intrinsics=np.eye(3), depth_scale=0.001)


@pytest.mark.parametrize("suffix", ["png", "npy", "ply"])
def test_views_file_missing_or_empty(tmp_path, suffix):
    folder = write_scene(tmp_path, f"a.{suffix}")
    with pytest.raises(FileNotFoundError) as caught:
        load_scene(folder)
    assert caught.value.filename == str(tmp_path / f"a.{suffix}")
    (tmp_path / f"a.{suffix}").write_bytes(b"")
    with pytest.raises(FileFormatError, match=rf"a\.{suffix}: the file is empty"):
        load_scene(folder)


def test_views_file_of_another_kind(tmp_path):
    (tmp_path / "a.obj").write_bytes(b"v 1 2 3")
    with pytest.raises(FileFormatError, match=r"a\.obj: expected a \.png, .* or \.txt file"):
        load_scene(write_scene(tmp_path, "a.obj"))


@pytest.mark.parametrize("suffix", ["png", "npy"])
def test_depth_image_needs_a_camera_and_its_scale(tmp_path, suffix):
    save_png(tmp_path / "a.png")
    np.save(tmp_path / "a.npy", DEPTH)
    with pytest.raises(FileFormatError, match=rf"a\.{suffix}: a 16-bit depth image needs depth_scale"):
        load_scene(write_scene(tmp_path, f"a.{suffix}", head=CAMERA.replace("depth_scale = 0.001", "")))
    np.save(tmp_path / "a.npy", DEPTH * 0.001)
    with pytest.raises(FileFormatError, match=r"a\.npy: a depth image needs a \[camera\] table"):
        load_scene(write_scene(tmp_path, "a.npy", head=""))


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
    with pytest.raises(FileFormatError, match=r"0.png: color: expected the depth image's shape \(240, 320\)"):
        load_scene(tmp_path)
    np.save(tmp_path / "0.npy", np.zeros((5, 3)))
    (tmp_path / "scene.toml").write_text(text.replace('"0.png"', '"0.npy"'))
    with pytest.raises(FileFormatError, match="color: only depth images have colour images"):
        load_scene(tmp_path)
    (tmp_path / "scene.toml").write_text(text.replace('"c0.png"', "3"))
    with pytest.raises(FileFormatError, match=r"view 0\.color: expected a file's name"):
        load_scene(tmp_path)


@pytest.mark.parametrize(
    ("package", "file"),
    [
        ("PIL", "a.png"),
        ("tomllib" if sys.version_info >= (3, 11) else "tomli", "a.npy"),
    ],
)
def test_missing_package_is_named(tmp_path, monkeypatch, package, file):
    save_png(tmp_path / "a.png")
    np.save(tmp_path / "a.npy", POINTS)
    (tmp_path / "a.ply").write_bytes(make_ply())
    for name in [name for name in sys.modules if name.split(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    folder = write_scene(tmp_path, file)
    name = {"PIL": "pillow"}.get(package, package)
    with pytest.raises(
        ImportError, match=rf'{name} is needed here: pip install "[\w.-]+\[cli\]" installs it'
    ):
        load_scene(folder)


@pytest.mark.parametrize("kind", [bool, np.uint8, np.int64])
def test_npz_scene_with_masks(tmp_path, kind):
    masks = np.stack([LABELS, LABELS[::-1]]).astype(kind)
    save_npz(tmp_path / "a.npz", mask=masks)
    for view, mask in zip(load_scene(tmp_path / "a.npz").views, masks, strict=True):
        np.testing.assert_array_equal(view.image.labels, mask)
        assert 0 < len(view.points) == np.count_nonzero(mask) < mask.size


def write_masks(folder):
    """Write four mask files with the same labels."""
    Image.fromarray(LABELS).save(folder / "m8.png")
    Image.fromarray(LABELS.astype(np.uint16)).save(folder / "m16.png")
    Image.fromarray(LABELS > 0).save(folder / "m1.png")
    np.save(folder / "m.npy", LABELS.astype(np.int64))
    return ["m8.png", "m16.png", "m1.png", "m.npy"]


def test_some_views_of_a_description_may_have_masks(tmp_path):
    save_png(tmp_path / "a.png")
    np.save(tmp_path / "a.npy", DEPTH * 0.001)
    names = [*write_masks(tmp_path), None, "m8.png"]
    text = CAMERA
    for i, name in enumerate(names):
        text += f'\n[[view]]\nfile = "{("a.png", "a.npy")[i % 2]}"\n{IDENTITY}'
        text += "" if name is None else f'mask = "{name}"\n'
    (tmp_path / "scene.toml").write_text(text)
    views = load_scene(tmp_path).views
    want = View.from_depth(DEPTH * 0.001, K, mask=LABELS)
    for name, view in zip(names, views, strict=True):
        if name is None:
            assert view.mask is None
            assert len(view.points) == DEPTH.size
        else:
            np.testing.assert_array_equal(view.image.labels, LABELS > 0 if name == "m1.png" else LABELS)
            np.testing.assert_array_equal(view.points, want.points)


@pytest.mark.parametrize("kind", ["folder", "toml", "npz"])
def test_mask_files_replace_the_masks_of_the_scene(tmp_path, monkeypatch, kind):
    names = write_masks(tmp_path)
    (tmp_path / "scene").mkdir()
    if kind == "npz":
        path = tmp_path / "scene" / "a.npz"
        save_npz(path, mask=np.ones((2, 6, 8), dtype=bool))
        given = names[1:3]
    else:
        save_png(tmp_path / "scene" / "a.png")
        save_png(tmp_path / "scene" / "own.png", np.ones_like(LABELS))
        path = write_scene(tmp_path / "scene", "a.png", pose=IDENTITY + 'mask = "own.png"\n')
        path = path / "scene.toml" if kind == "toml" else path
        given = names[1:2]
    # relative to the working folder, not to the scene
    monkeypatch.chdir(tmp_path)
    views = load_scene(path, masks=given).views
    for view, name in zip(views, given, strict=True):
        np.testing.assert_array_equal(view.image.labels, LABELS > 0 if name == "m1.png" else LABELS)
    assert load_scene(path).views[0].mask.all()
    for wrong in ([], [*given, names[0]]):
        expected = rf"masks: expected one file for each of {len(views)} views, got {len(wrong)}"
        with pytest.raises(ValueError, match=expected):
            load_scene(path, wrong)
    with pytest.raises(TypeError, match="masks: expected a sequence of paths, got str"):
        load_scene(path, "m8.png")


@pytest.mark.parametrize("kind", ["folder", "npz"])
@pytest.mark.parametrize(
    ("mask", "message"),
    [
        (np.ones((3, 4), dtype=np.uint8), r"mask: expected the depth image's shape \(6, 8\), got \(3, 4\)"),
        (
            np.ones((6, 8, 3), dtype=np.uint8),
            "expected a single-channel mask PNG of 1, 8 or 16 bits, got 8-bit RGB",
        ),
    ],
)
def test_a_mask_file_of_another_shape_is_named_once(tmp_path, kind, mask, message):
    Image.fromarray(mask).save(tmp_path / "m.png")
    if kind == "npz":
        path, given = tmp_path / "a.npz", [tmp_path / "m.png"] * 2
        save_npz(path)
    else:
        save_png(tmp_path / "a.png")
        path, given = write_scene(tmp_path, "a.png", pose=IDENTITY + 'mask = "m.png"\n'), None
    with pytest.raises(FileFormatError, match=rf"^\S*m\.png: {message}"):
        load_scene(path, given)


def test_mask_files_missing_damaged_or_of_points(tmp_path):
    save_png(tmp_path / "a.png")
    folder = write_scene(tmp_path, "a.png", pose=IDENTITY + 'mask = "m.npy"\n')
    with pytest.raises(FileNotFoundError) as caught:
        load_scene(folder)
    assert caught.value.filename == str(tmp_path / "m.npy")
    for content, message in (
        (b"", "the file is empty"),
        (b"\x93NUMPY\x01", "truncated, or not an .npy file"),
    ):
        (tmp_path / "m.npy").write_bytes(content)
        with pytest.raises(FileFormatError, match=rf"m\.npy: {message}"):
            load_scene(folder)
    np.save(tmp_path / "m.npy", LABELS * 0.5)
    with pytest.raises(FileFormatError, match=r"^\S*m\.npy: mask: expected bools, or whole numbers"):
        load_scene(folder)
    (tmp_path / "a.ply").write_bytes(make_ply())
    with pytest.raises(FileFormatError, match=r"a\.ply: mask: only depth images have masks"):
        load_scene(write_scene(tmp_path, "a.ply", pose=IDENTITY + 'mask = "m.npy"\n'))


def test_a_description_names_no_files_outside_of_its_folder(tmp_path):
    np.save(tmp_path / "secret.npy", POINTS)
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "link.npy").symlink_to(tmp_path / "secret.npy")
    (folder / "own.npy").symlink_to(folder / "b.npy")
    np.save(folder / "b.npy", POINTS)
    for name in ("../secret.npy", str(tmp_path / "secret.npy"), "link.npy", "../scene/../secret.npy"):
        write_scene(folder, name)
        with pytest.raises(
            FileFormatError, match=r"scene\.toml: view 0\.file: .* is outside of the scene's folder"
        ) as caught:
            load_scene(folder)
        assert (caught.value.file, caught.value.place) == (str(folder / "scene.toml"), "view 0.file")
        assert len(load_scene(folder, outside=True).views[0].points) == len(POINTS)
    for name in ("own.npy", "../scene/b.npy", "./b.npy"):
        assert len(load_scene(write_scene(folder, name)).views[0].points) == len(POINTS)
    (tmp_path / "link").symlink_to(folder)
    assert load_scene(tmp_path / "link").files == (
        tmp_path / "link" / "scene.toml",
        tmp_path / "link" / "./b.npy",
    )


def test_views_share_one_limit(tmp_path):
    np.save(tmp_path / "a.npy", POINTS)
    (tmp_path / "scene.toml").write_text(f'[[view]]\nfile = "a.npy"\n{IDENTITY}' * 50)
    assert len(load_scene(tmp_path).views) == 50
    with pytest.raises(FileFormatError, match=r"a\.npy: takes .* are left of max_bytes=100000"):
        load_scene(tmp_path, max_bytes=100_000)
    with pytest.raises(ValueError, match="max_bytes: expected at least 1, got 0"):
        load_scene(tmp_path, max_bytes=0)
    with pytest.raises(TypeError, match=r"max_bytes: expected an integer"):
        load_scene(tmp_path, max_bytes=1e9)


@pytest.mark.parametrize(
    ("changes", "place"),
    [
        ({"depth": np.zeros((0, 6, 8), np.uint16), "poses": np.zeros((0, 4, 4))}, "depth"),
        ({"name": np.array(["a", "b"])}, "name"),
        ({"name": np.array(3)}, "name"),
        ({"radius": np.zeros((2, 2))}, "radius"),
        ({"depth_scale": np.float64(np.nan)}, "depth_scale"),
        ({"poses": np.full((2, 4, 4), 1e308)}, "pose"),
    ],
)
def test_npz_that_once_raised_other_errors(tmp_path, changes, place):
    save_npz(tmp_path / "a.npz", **changes)
    with np.errstate(all="raise"), pytest.raises(FileFormatError) as caught:
        load_scene(tmp_path / "a.npz")
    assert (caught.value.file, caught.value.place) == (str(tmp_path / "a.npz"), place)


@pytest.mark.parametrize(
    "text",
    [
        "[camera]\nfx = 1" + "0" * 400 + "\nfy = 1\ncx = 1\ncy = 1",
        "radius = 0x" + "f" * 9000,
        "name = [1]",
        "[turntable]\naxis = [1e308, 1e308, 0]\n" + IDENTITY,
    ],
)
def test_descriptions_that_once_raised_other_errors(tmp_path, text):
    np.save(tmp_path / "a.npy", POINTS)
    with pytest.raises(FileFormatError, match=r"scene\.toml: "):
        load_scene(write_scene(tmp_path, "a.npy", text, "turntable_deg = 30" if "turn" in text else IDENTITY))
    with pytest.raises(FileFormatError, match=r"view 0\.file: expected a file's name"):
        load_scene(write_scene(tmp_path, r"a\u0000.npy"))
