import errno
import os
import re
import shutil
import struct
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from strand import StrandError
from strand.io import FileFormatError, load_scene, read_json, read_toml, write_bytes, write_json
from strand.scene import parse_length
from strand.view import View, pose_from_angles, turntable_pose

POINTS = np.random.default_rng(0).normal(size=(40, 3)) + np.array([0.0, 0.0, 5.0])
DEPTH = np.random.default_rng(1).integers(300, 900, size=(6, 8)).astype(np.uint16)
K = np.array([[10.0, 0, 3.5], [0, 11.0, 2.5], [0, 0, 1]])
CAMERA = "[camera]\nfx = 10\nfy = 11.0\ncx = 3.5\ncy = 2.5\ndepth_scale = 0.001\n"
IDENTITY = "pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"


def scene_of(folder, file, head=CAMERA, pose=IDENTITY):
    (folder / "scene.toml").write_text(f'{head}\n[[view]]\nfile = "{file}"\n{pose}')
    return folder


def save_png(path, depth=DEPTH):
    Image.fromarray(depth).save(path)


def save_npz(path, **changes):
    arrays = {
        "depth": np.stack([DEPTH, DEPTH[::-1]]),
        "depth_scale": np.float64(0.001),
        "K": K,
        "poses": np.stack([np.eye(4), pose_from_angles(0.1, 0.2, 0.3, np.array([0.1, 0.2, 0.3]))]),
        "box": np.array([[-1.0, -2, -3], [1, 2, 3]]),
        "radius": np.float64(0.004),
        "truth_0": POINTS[:5].astype(np.float32),
        "truth_10": POINTS[10:15].astype(np.float32),
        "truth_2": POINTS[5:10].astype(np.float32),
        "poses_true": np.zeros((2, 4, 4)),
        "name": np.array("knot"),
    } | changes
    np.savez_compressed(path, **{key: value for key, value in arrays.items() if value is not None})


def ply(encoding="ascii", points=POINTS, kind="double", more="", tail=b""):
    properties = "".join(f"property {kind} {axis}\n" for axis in "xyz")
    header = f"ply\nformat {encoding} 1.0\ncomment made\nelement vertex {len(points)}\n"
    header += f"{properties}{more}end_header\n"
    number = {"double": "f8", "float": "f4"}.get(kind, "i4")
    if encoding == "ascii":
        body = "".join(" ".join(repr(float(x)) for x in p) + "\n" for p in points.astype(number)).encode()
    else:
        body = points.astype(("<" if "little" in encoding else ">") + number).tobytes()
    return header.encode() + body + tail


# writing


def test_write_bytes_replaces_the_file_and_leaves_nothing_else(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    write_bytes(path, b"new")
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


def test_write_bytes_keeps_the_usual_permissions(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    write_bytes(tmp_path / "ours", b"")
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "plain").stat().st_mode


@pytest.mark.parametrize("step", ["fsync", "replace"])
@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
def test_write_bytes_leaves_the_old_file_if_it_fails(tmp_path, monkeypatch, step, error):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")

    def fail(*_):
        raise error

    monkeypatch.setattr(os, step, fail)
    with pytest.raises(type(error)) as caught:
        write_bytes(path, b"new")
    if isinstance(error, OSError):
        assert caught.value.filename == str(path)
        assert caught.value.errno == errno.ENOSPC
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_write_bytes_names_the_file_it_cannot_write(tmp_path):
    with pytest.raises(FileNotFoundError) as caught:
        write_bytes(tmp_path / "no" / "a.bin", b"")
    assert caught.value.filename == str(tmp_path / "no" / "a.bin")
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(NotADirectoryError):
        write_bytes(tmp_path / "file" / "a.bin", b"")


def test_write_bytes_refuses_what_is_not_a_file(tmp_path):
    with pytest.raises(OSError, match="Not a regular file"):
        write_bytes(tmp_path, b"")
    with pytest.raises(OSError, match="Not a regular file"):
        write_bytes(os.devnull, b"")
    assert not Path(os.devnull).is_file()


def test_write_bytes_writes_through_a_link(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "there" / "a.bin")
    write_bytes(tmp_path / "link", b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "there" / "a.bin").read_bytes() == b"new"


def test_json_comes_back(tmp_path):
    value = {"a": [1, 0.1, True, None, "é"], "b": {}}
    write_json(tmp_path / "a.json", value)
    assert read_json(tmp_path / "a.json") == value


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_write_json_refuses_what_json_cannot_say(tmp_path, number):
    with pytest.raises(ValueError, match=r"a\.json"):
        write_json(tmp_path / "a.json", {"a": number})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "data", [b"", b'{"a": [1, 2', b"nonsense", b"\xff\xfe\xfd", b"[NaN]", b"[-Infinity]", b"[" * 100_000]
)
def test_read_json_names_a_bad_file(tmp_path, data):
    (tmp_path / "a.json").write_bytes(data)
    with pytest.raises(FileFormatError, match=r"a\.json"):
        read_json(tmp_path / "a.json")


def test_read_json_without_a_file(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_json(tmp_path / "a.json")


def test_file_format_error_is_a_strand_error_and_a_value_error():
    assert issubclass(FileFormatError, StrandError)
    assert issubclass(FileFormatError, ValueError)


# lengths


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("4.2mm", 0.0042),
        ("4.2 mm", 0.0042),
        ("0.42cm", 0.0042),
        (" .0042 m ", 0.0042),
        ("0.0042", 0.0042),
        ("4.2e-3", 0.0042),
        ("-3mm", -0.003),
        ("1.mm", 0.001),
        (0.0042, 0.0042),
        (1e-7, 1e-7),
        (2, 2.0),
    ],
)
def test_parse_length(text, metres):
    assert parse_length(text) == metres


@pytest.mark.parametrize(
    "text",
    ["", "mm", "4.2 in", "4,2mm", "nan", "inf", "1e999", "1e99999999", "4.2mm 3", float("nan"), float("inf")],
)
def test_parse_length_refuses(text):
    with pytest.raises(ValueError, match="length: expected"):
        parse_length(text)


@pytest.mark.parametrize("value", [None, True, [0.1], b"4mm"])
def test_parse_length_refuses_other_things(value):
    with pytest.raises(TypeError, match="length: expected"):
        parse_length(value)


# archives


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
    # in the order of their numbers, not of their names
    np.testing.assert_allclose(np.vstack(scene.truth), POINTS[:15], rtol=1e-6)


def test_npz_scene_with_what_is_needed_only(tmp_path):
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
        ({"K": np.eye(2)}, "intrinsics: expected"),
        ({"depth_scale": np.float64(0)}, "depth_scale: expected one positive number"),
        ({"radius": np.float64(-1)}, "radius: expected one positive number"),
        ({"radius": np.array("wide")}, "radius: expected one positive number"),
        ({"box": np.array([[1.0, 1, 1], [0, 0, 0]])}, "bounds: expected low < high"),
        ({"truth_0": np.zeros((4, 2))}, "truth_0: expected shape"),
        ({"K": np.array([None])}, "pickle"),
    ],
)
def test_npz_with_wrong_content(tmp_path, changes, message):
    save_npz(tmp_path / "a.npz", **changes)
    with pytest.raises(FileFormatError, match=rf"a\.npz: .*{message}"):
        load_scene(tmp_path / "a.npz")


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
    (tmp_path / "a.pcd").write_bytes(b"VERSION .7")
    with pytest.raises(FileFormatError, match=r"a\.pcd: expected a folder"):
        load_scene(tmp_path / "a.pcd")


# descriptions


def test_description_in_full(tmp_path):
    save_png(tmp_path / "a.png")
    (tmp_path / "b.ply").write_bytes(ply())
    np.save(tmp_path / "c.npy", POINTS)
    (tmp_path / "scene.toml").write_text(
        'name = "knot"\nradius = "4.2mm"\n'
        + CAMERA
        + "[extract]\nlow = [-1, -2.5, -inf]\nhigh = [1, 2, inf]\n"
        + "[turntable]\nangles_deg = [-140, 0, 90]\norigin = [0.4, 0, 0.45]\n"
        + "centre = [0, 0.1, 0]\naxis = [0, 0, 2]\n"
        + f'[[view]]\nfile = "a.png"\n{IDENTITY}'
        + '[[view]]\nfile = "b.ply"\nangles_deg = [10, 20.5, -30]\norigin = [1, 2, 3]\n'
        + '[[view]]\nfile = "c.npy"\nturntable_deg = 30\n'
    )
    for path in (tmp_path, tmp_path / "scene.toml"):
        scene = load_scene(path)
        assert (scene.name, scene.radius, scene.truth) == ("knot", 0.0042, ())
        np.testing.assert_array_equal(scene.bounds, [[-1, -2.5, -np.inf], [1, 2, np.inf]])
        image, cloud, turned = scene.views
        np.testing.assert_array_equal(image.points, View.from_depth(DEPTH * 0.001, K).points)
        np.testing.assert_array_equal(cloud.points, POINTS)
        pose = pose_from_angles(*np.radians([10, 20.5, -30]), np.array([1.0, 2, 3]))
        np.testing.assert_allclose(cloud.pose, pose, atol=1e-15)
        camera = pose_from_angles(*np.radians([-140.0, 0, 90]), np.array([0.4, 0, 0.45]))
        pose = turntable_pose(camera, np.radians(30), (0.0, 0.1, 0.0), (0.0, 0.0, 1.0))
        np.testing.assert_allclose(turned.pose, pose, atol=1e-15)


def test_description_with_what_is_needed_only(tmp_path):
    np.save(tmp_path / "a.npy", POINTS)
    scene = load_scene(scene_of(tmp_path, "a.npy", head=""))
    assert (scene.name, scene.bounds, scene.radius) == (tmp_path.name, None, None)
    scene = load_scene(scene_of(tmp_path, "a.npy", head="radius = 0.005"))
    assert scene.radius == 0.005


def test_turntable_may_give_its_pose_as_a_matrix(tmp_path):
    np.save(tmp_path / "a.npy", POINTS)
    scene = load_scene(scene_of(tmp_path, "a.npy", f"[turntable]\n{IDENTITY}", "turntable_deg = 90"))
    np.testing.assert_allclose(scene.views[0].pose, turntable_pose(np.eye(4), np.pi / 2))


@pytest.mark.parametrize(
    ("head", "view", "message"),
    [
        ("radios = 1", IDENTITY, "scene: unknown key radios; accepted are name, radius, camera"),
        (
            CAMERA + "width = 8",
            IDENTITY,
            "camera: unknown key width; accepted are fx, fy, cx, cy, depth_scale",
        ),
        ("[camera]\nfx = 1\nfy = 1\ncy = 1", IDENTITY, "camera: missing key cx"),
        ("[camera]\nfx = 0\nfy = 1\ncx = 1\ncy = 1", IDENTITY, "camera: expected fx, fy > 0"),
        ("[camera]\nfx = 'a'\nfy = 1\ncx = 1\ncy = 1", IDENTITY, r"camera\.fx: expected a finite number"),
        ("[camera]\nfx = true\nfy = 1\ncx = 1\ncy = 1", IDENTITY, r"camera\.fx: expected a finite number"),
        (CAMERA.replace("0.001", "-0.001"), IDENTITY, r"camera\.depth_scale: expected metres per unit > 0"),
        ("camera = 3", IDENTITY, "camera: expected a table"),
        ("[extract]\nlow = [0, 0, 0]", IDENTITY, "extract: missing key high"),
        ("[extract]\nlow = [0, 0, 0]\nhigh = [1, 1, 0]", IDENTITY, "bounds: expected low < high"),
        ("[extract]\nlow = [0, 0]\nhigh = [1, 1]", IDENTITY, r"expected shape \(3\)"),
        ("[extract]\nlow = 'a'\nhigh = [1, 1, 1]", IDENTITY, r"extract\.low: expected a list of numbers"),
        ("radius = 0", IDENTITY, "radius: expected a positive length"),
        ("radius = '4 inch'", IDENTITY, "length: expected metres"),
        ("radius = [1]", IDENTITY, "length: expected a number of metres"),
        ("", "", "view 1: expected a pose.*none of them"),
        ("", "angles_deg = [1, 2, 3]", "view 1: expected a pose.*angles_deg"),
        ("", IDENTITY + "origin = [1, 2, 3]", "view 1: expected a pose.*origin, pose"),
        ("", IDENTITY + "turntable_deg = 3", "view 1: expected one pose"),
        ("", "turntable_deg = 3", r"view 1: turntable_deg needs a \[turntable\] table"),
        ("[turntable]\ncentre = [0, 0, 0]", "turntable_deg = 3", "turntable: expected a pose"),
        ("[turntable]\ncenter = [0, 0, 0]", "turntable_deg = 3", "turntable: unknown key center; .*centre"),
        (f"[turntable]\naxis = [0, 0, 0]\n{IDENTITY}", "turntable_deg = 3", "axis: expected a direction"),
        ("", "angles_deg = [1, 2]\norigin = [1, 2, 3]", r"view 1\.angles_deg: expected three angles"),
        ("", "angles_deg = [1, 2, 3]\norigin = [1, 2]", "origin: expected shape"),
        ("", "pose = [[1, 0], [0]]", r"view 1\.pose: expected a list of numbers"),
        ("", IDENTITY.replace("[1,", "[2,"), r"view 1\.pose: expected a rigid motion"),
        ("", IDENTITY + "poes = 3", "view 1: unknown key poes"),
    ],
)
def test_description_with_wrong_content(tmp_path, head, view, message):
    np.save(tmp_path / "a.npy", POINTS)
    with pytest.raises(FileFormatError, match=rf"(?s)scene\.toml: .*{message}"):
        load_scene(scene_of(tmp_path, "a.npy", head, view))


@pytest.mark.parametrize(
    "text", ["", "name = 'a'", "view = 3", "view = []", "[[view]]\npose = 3", "[[view]]\nfile = 3"]
)
def test_description_without_views(tmp_path, text):
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(FileFormatError, match=r"scene\.toml: view"):
        load_scene(tmp_path)


@pytest.mark.parametrize("data", [b"[camera\nfx", b'name = "a', b"name = \xff"])
def test_toml_truncated_or_damaged(tmp_path, data):
    (tmp_path / "scene.toml").write_bytes(data)
    with pytest.raises(FileFormatError, match=r"scene\.toml: truncated, or not TOML"):
        load_scene(tmp_path)


def test_read_toml(tmp_path):
    (tmp_path / "a.toml").write_text("a = 1\n[b]\nc = 'd'\n")
    assert read_toml(tmp_path / "a.toml") == {"a": 1, "b": {"c": "d"}}


@pytest.mark.parametrize("suffix", ["png", "npy", "ply"])
def test_views_file_missing_or_empty(tmp_path, suffix):
    folder = scene_of(tmp_path, f"a.{suffix}")
    with pytest.raises(FileNotFoundError) as caught:
        load_scene(folder)
    assert caught.value.filename == str(tmp_path / f"a.{suffix}")
    (tmp_path / f"a.{suffix}").write_bytes(b"")
    with pytest.raises(FileFormatError, match=rf"a\.{suffix}: the file is empty"):
        load_scene(folder)


def test_views_file_of_another_kind(tmp_path):
    (tmp_path / "a.pcd").write_bytes(b"VERSION .7")
    with pytest.raises(FileFormatError, match=r"a\.pcd: expected a \.png, \.ply or \.npy file"):
        load_scene(scene_of(tmp_path, "a.pcd"))


@pytest.mark.parametrize("suffix", ["png", "npy"])
def test_depth_image_needs_a_camera_and_its_scale(tmp_path, suffix):
    save_png(tmp_path / "a.png")
    np.save(tmp_path / "a.npy", DEPTH)
    with pytest.raises(FileFormatError, match=rf"a\.{suffix}: a 16-bit depth image needs depth_scale"):
        load_scene(scene_of(tmp_path, f"a.{suffix}", head=CAMERA.replace("depth_scale = 0.001", "")))
    np.save(tmp_path / "a.npy", DEPTH * 0.001)
    with pytest.raises(FileFormatError, match=r"a\.npy: a depth image needs a \[camera\] table"):
        load_scene(scene_of(tmp_path, "a.npy", head=""))


# PNG


def png(bits, colour, rows):
    """A PNG of one's own making, for what Pillow does not write."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 2, len(rows), bits, colour, 0, 0, 0)
    data = zlib.compress(b"".join(b"\0" + row for row in rows))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def test_png_keeps_all_16_bits(tmp_path):
    depth = np.array([[0, 1], [256, 65535]], dtype=np.uint16)
    save_png(tmp_path / "a.png", depth)
    view = load_scene(scene_of(tmp_path, "a.png")).views[0]
    np.testing.assert_allclose(view.points[:, 2], [0.001, 0.256, 65.535], rtol=1e-15)
    assert view.dropped == 0


@pytest.mark.parametrize(
    ("mode", "kind"),
    [
        ("L", "8-bit grey"),
        ("RGB", "8-bit RGB"),
        ("P", "8-bit palette"),
        ("1", "1-bit grey"),
        ("LA", "8-bit grey and alpha"),
        ("RGBA", "8-bit RGB and alpha"),
    ],
)
def test_png_of_another_kind(tmp_path, mode, kind):
    Image.new("L", (8, 6)).convert(mode).save(tmp_path / "a.png")
    with pytest.raises(FileFormatError, match=rf"a\.png: expected a 16-bit single-channel .* got {kind}"):
        load_scene(scene_of(tmp_path, "a.png"))


def test_png_with_16_bit_colours(tmp_path):
    (tmp_path / "a.png").write_bytes(png(16, 2, [bytes(12), bytes(12)]))
    with pytest.raises(FileFormatError, match="got 16-bit RGB"):
        load_scene(scene_of(tmp_path, "a.png"))
    (tmp_path / "a.png").write_bytes(png(16, 0, [b"\x01\x02\x03\x04", bytes(4)]))
    np.testing.assert_allclose(load_scene(tmp_path).views[0].points[:, 2], [0.258, 0.772])


def test_png_truncated_anywhere(tmp_path):
    save_png(tmp_path / "whole.png")
    data = (tmp_path / "whole.png").read_bytes()
    folder = scene_of(tmp_path, "a.png")
    for length in range(1, len(data) - 4):  # the last four bytes are the end mark's checksum
        (tmp_path / "a.png").write_bytes(data[:length])
        with pytest.raises(FileFormatError, match=r"a\.png: truncated"):
            load_scene(folder)


def test_png_that_is_another_file(tmp_path):
    Image.new("RGB", (8, 6)).save(tmp_path / "a.jpg")
    shutil.move(tmp_path / "a.jpg", tmp_path / "a.png")
    with pytest.raises(FileFormatError, match=r"a\.png: truncated, or not a PNG"):
        load_scene(scene_of(tmp_path, "a.png"))


# NPY


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("order", ["C", "F"])
def test_npy_points(tmp_path, kind, order):
    np.save(tmp_path / "a.npy", np.asarray(POINTS, dtype=kind, order=order))
    view = load_scene(scene_of(tmp_path, "a.npy")).views[0]
    np.testing.assert_array_equal(view.points, POINTS.astype(kind))


def test_npy_depth(tmp_path):
    want = View.from_depth(DEPTH * 0.001, K).points
    np.save(tmp_path / "a.npy", DEPTH)
    np.testing.assert_array_equal(load_scene(scene_of(tmp_path, "a.npy")).views[0].points, want)
    metres = DEPTH * 0.001
    metres[0, 0], metres[1, 1] = np.nan, np.inf
    np.save(tmp_path / "a.npy", metres)
    view = load_scene(tmp_path).views[0]
    assert len(view.points) == DEPTH.size - 2
    assert view.dropped == 2


def test_cloud_drops_and_counts_what_is_not_finite(tmp_path):
    points = POINTS.copy()
    points[3, 1], points[7] = np.nan, np.inf
    np.save(tmp_path / "a.npy", points)
    (tmp_path / "a.ply").write_bytes(ply("binary_little_endian", points))
    for file in ("a.npy", "a.ply"):
        view = load_scene(scene_of(tmp_path, file)).views[0]
        np.testing.assert_array_equal(view.points, np.delete(POINTS, [3, 7], axis=0))
        assert view.dropped == 2


@pytest.mark.parametrize(
    "array",
    [
        np.zeros(3),
        np.zeros((2, 2, 3)),
        np.zeros((4, 3), int),
        np.zeros((4, 3), complex),
        np.zeros((4, 4), np.uint8),
    ],
)
def test_npy_of_another_kind(tmp_path, array):
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(FileFormatError, match=r"a\.npy: expected a depth image"):
        load_scene(scene_of(tmp_path, "a.npy"))


def test_npy_with_a_negative_depth(tmp_path):
    np.save(tmp_path / "a.npy", np.full((6, 8), -1.0))
    with pytest.raises(FileFormatError, match=r"a\.npy: depth: expected depths >= 0"):
        load_scene(scene_of(tmp_path, "a.npy"))


def test_npy_truncated_anywhere(tmp_path):
    np.save(tmp_path / "whole.npy", POINTS[:4])
    data = (tmp_path / "whole.npy").read_bytes()
    folder = scene_of(tmp_path, "a.npy")
    for length in range(1, len(data)):
        (tmp_path / "a.npy").write_bytes(data[:length])
        with pytest.raises(FileFormatError, match=r"a\.npy: truncated"):
            load_scene(folder)


def test_npy_with_pickled_objects_is_not_opened(tmp_path):
    class Harm:
        def __reduce__(self):
            return Path.touch, (tmp_path / "harm",)

    np.save(tmp_path / "a.npy", np.array([[Harm()] * 3]), allow_pickle=True)
    with pytest.raises(FileFormatError, match=r"a\.npy"):
        load_scene(scene_of(tmp_path, "a.npy"))
    assert not (tmp_path / "harm").exists()


# PLY


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("kind", ["double", "float"])
def test_ply(tmp_path, encoding, kind):
    (tmp_path / "a.ply").write_bytes(ply(encoding, kind=kind))
    view = load_scene(scene_of(tmp_path, "a.ply")).views[0]
    want = POINTS if kind == "double" else POINTS.astype(np.float32)
    np.testing.assert_array_equal(view.points, want)


def test_ply_with_windows_line_ends_and_faces(tmp_path):
    faces = "element face 1\nproperty list uchar int vertex_indices\n"
    (tmp_path / "a.ply").write_bytes(ply(more=faces, tail=b"3 0 1 2\n"))
    folder = scene_of(tmp_path, "a.ply")
    np.testing.assert_array_equal(load_scene(folder).views[0].points, POINTS)
    (tmp_path / "a.ply").write_bytes(ply().replace(b"\n", b"\r\n"))
    np.testing.assert_array_equal(load_scene(folder).views[0].points, POINTS)


def test_ply_with_colours(tmp_path):
    row = np.zeros(3, dtype=[("xyz", "<f4", 3), ("rgb", "u1", 3)])
    row["xyz"] = POINTS[:3]
    colours = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    header = ply("binary_little_endian", POINTS[:3], "float", more=colours).split(b"end_header\n")[0]
    (tmp_path / "a.ply").write_bytes(header + b"end_header\n" + row.tobytes())
    points = load_scene(scene_of(tmp_path, "a.ply")).views[0].points
    np.testing.assert_array_equal(points, POINTS[:3].astype(np.float32))


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_truncated(tmp_path, encoding):
    data = ply(encoding, POINTS[:5])
    folder = scene_of(tmp_path, "a.ply")
    # an ASCII file that lost the end of its last number cannot be told from a whole one
    end = len(data.rstrip().rsplit(b" ", 1)[0]) if encoding == "ascii" else len(data)
    for length in range(1, end):
        (tmp_path / "a.ply").write_bytes(data[:length])
        with pytest.raises(FileFormatError, match=r"a\.ply: truncated"):
            load_scene(folder)


def test_ply_with_no_points(tmp_path):
    (tmp_path / "a.ply").write_bytes(ply(points=POINTS[:0]))
    assert load_scene(scene_of(tmp_path, "a.ply")).views[0].points.shape == (0, 3)


@pytest.mark.parametrize(
    "data",
    [
        b"solid a\n",
        ply().replace(b"ply\n", b"plx\n", 1),
        ply().replace(b"property double z\n", b""),
        ply().replace(b" z\n", b" w\n"),
        ply(kind="int"),
        ply().replace(b".", b"a", 9),
        ply().replace(b"element vertex", b"element face"),
    ],
)
def test_ply_with_wrong_content(tmp_path, data):
    (tmp_path / "a.ply").write_bytes(data)
    with pytest.raises(FileFormatError, match=r"a\.ply"):
        load_scene(scene_of(tmp_path, "a.ply"))


# packages that are not there


@pytest.mark.parametrize(
    ("package", "file"),
    [
        ("PIL", "a.png"),
        ("trimesh", "a.ply"),
        ("tomllib" if sys.version_info >= (3, 11) else "tomli", "a.npy"),
    ],
)
def test_missing_package_is_named(tmp_path, monkeypatch, package, file):
    save_png(tmp_path / "a.png")
    np.save(tmp_path / "a.npy", POINTS)
    (tmp_path / "a.ply").write_bytes(ply())
    for name in [name for name in sys.modules if name.split(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    folder = scene_of(tmp_path, file)
    name = {"PIL": "pillow"}.get(package, package)
    with pytest.raises(
        ImportError, match=re.escape(f'{name} is needed here: pip install ".[cli]" installs it')
    ):
        load_scene(folder)
