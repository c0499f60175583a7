"""Recordings found in folders: their names, and digests of their files."""

from __future__ import annotations

import inspect
import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import strand
from lib.bag_files import record_film, write_bag
from shared.scene_files import save_npz, write_scene
from strand.batch import Settings, find_units, make_rows, units
from strand.batch.frames import iterate_frames

SCENE = strand.synthetic.scene("arc", seed=0, views=3)


@pytest.fixture
def folder(tmp_path):
    """A folder with a recording of each kind, and other files."""
    (tmp_path / "b" / "scene").mkdir(parents=True)
    write_scene(tmp_path / "b" / "scene", "0.png")
    (tmp_path / "b" / "depth").mkdir()
    for k in (0, 1, 2):
        Image.fromarray(SCENE.depth[k]).save(tmp_path / "b" / "depth" / f"{k}.png")
    save_npz(tmp_path / "a.npz")
    (tmp_path / "notes.txt").write_text("no recording")
    write_bag(tmp_path / "film", "mcap", record_film(SCENE, 3)).rename(tmp_path / "c.mcap")
    shutil.rmtree(tmp_path / "film")
    write_bag(tmp_path / "d", "sqlite3", record_film(SCENE, 3))
    return tmp_path


def found(folder, settings=None, root=None, excluded=None, given=None):
    return list(find_units(given or [folder], settings or Settings(), root or folder, excluded))


def test_recordings_of_each_kind_are_found_in_order(folder):
    assert [(unit.recording, unit.kind) for unit in found(folder)] == [
        ("a.npz", "scene"),
        ("b/depth", "images"),
        ("b/scene", "scene"),
        ("c.mcap", "bag"),
        ("d", "bag"),
    ]
    assert {(unit.start, unit.stop) for unit in found(folder)} == {(0, None)}


def test_recordings_come_once_however_they_are_given(folder):
    given = [folder / "b" / "scene", folder, folder / "a.npz", Path(f"{folder}/b/../a.npz")]
    assert found(folder, given=given) == found(folder)


def test_named_paths_below_named_folders_are_found(folder, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    save_npz(elsewhere / "f.npz")
    (folder / "link").symlink_to(elsewhere)
    single, inner = folder / "b" / "depth" / "1.png", folder / "b"
    walked = [unit.recording for unit in found(folder)]
    given = [folder, inner, single, folder / "link", folder / "a.npz"]
    assert [unit.recording for unit in found(folder, given=given)] == [*walked, "b/depth/1.png", "link/f.npz"]


def test_names_are_relative_to_the_root_or_whole(folder, monkeypatch):
    monkeypatch.chdir(folder / "b")
    assert [unit.recording for unit in find_units([Path("scene")], Settings(), Path("."))] == ["scene"]
    outside = found(folder, given=[folder / "a.npz"], root=folder / "b")
    assert [unit.recording for unit in outside] == [str(folder / "a.npz")]
    strange = Path(os.fsdecode(os.fsencode(folder) + b"/\xff.npz"))
    (folder / "a.npz").rename(strange)
    assert found(folder, given=[strange])[0].recording == "\\xff.npz"


def test_names_are_distinct(tmp_path):
    for name in (b"\xff.npz", b"\\xff.npz", b"\\\\xff.npz"):
        Path(os.fsdecode(os.fsencode(tmp_path) + b"/" + name)).touch()
    assert sorted(unit.recording for unit in found(tmp_path)) == sorted(
        ("\\xff.npz", "\\\\xff.npz", "\\\\\\\\xff.npz")
    )


def test_a_link_and_its_target_are_one_recording(folder):
    (folder / "link").symlink_to(folder / "b")
    assert found(folder, given=[folder / "link", folder / "b"]) == found(folder, given=[folder / "b"])
    assert [unit.recording for unit in found(folder, given=[folder / "link"])] == ["link/depth", "link/scene"]
    (folder / "more").symlink_to("link")
    assert len(found(folder, given=[folder / "link", folder / "more"])) == 2


def test_metadata_of_other_kinds_hide_no_recordings(folder):
    before = found(folder)
    (folder / "metadata.yaml").write_text("name: our ropes\n")
    assert found(folder) == before
    (folder / "metadata.yaml").write_text("# of a bag\nrosbag2_bagfile_information:\n")
    assert [(unit.path, unit.kind) for unit in found(folder)] == [(str(folder), "bag")]
    # damaged metadata beside a .db3 file is still a bag
    (folder / "d" / "metadata.yaml").write_text("")
    assert [unit.kind for unit in found(folder / "d")] == ["bag"]


def test_a_recording_that_the_search_cannot_read_has_an_error_row(folder):
    whole = (folder / "c.mcap").read_bytes()
    (folder / "c.mcap").write_bytes(whole[: len(whole) // 2])
    settings = Settings(stretch=2, world="world")
    (unit,) = found(folder, settings, given=[folder / "c.mcap"])
    assert unit.error.startswith("FileFormatError: ")
    # the error stays, although the recording can be read now
    (folder / "c.mcap").write_bytes(whole)
    assert make_rows(unit, settings).column("error").to_pylist() == [unit.error]
    (folder / "a.npz").unlink()
    (folder / "a.npz").symlink_to("a.npz")
    unit = found(folder)[0]
    assert (unit.recording, unit.digest, unit.error.partition(":")[0]) == ("a.npz", None, "OSError")
    with pytest.raises(OSError, match=r"a\.npz"):
        found(folder, given=[folder / "a.npz"])


def test_an_unreadable_file_affects_only_its_frame(folder):
    settings = Settings(intrinsics=SCENE.intrinsics, depth_scale=SCENE.depth_scale, ropes=1)
    depth = folder / "b" / "depth"
    (depth / "1.png").unlink()
    (depth / "1.png").symlink_to("gone.png")
    (images, scene) = found(folder, settings, given=[folder / "b"])
    told = [bool(error) for error in make_rows(images, settings).column("error").to_pylist()]
    assert told == [False, True, False]
    # a broken link, as editors leave it
    (folder / "b" / "scene" / ".#scene.toml").symlink_to("who@where.1")
    (_, after) = found(folder, settings, given=[folder / "b"])
    assert after.error is None
    assert after.digest not in (None, scene.digest)
    for name in ("0.png", "2.png"):
        (depth / name).unlink()
        (depth / name).symlink_to("gone.png")
    assert found(folder, settings, given=[depth])[0].digest is None


def test_a_missing_package_is_no_error_of_a_recording(folder, monkeypatch):
    def missing(*_):
        raise ImportError("lz4 is needed here")

    monkeypatch.setattr(units, "open_bag", missing)
    with pytest.raises(ImportError, match="lz4 is needed"):
        found(folder, Settings(stretch=2), given=[folder / "c.mcap"])


def test_a_digest_depends_on_the_recordings_files_only(folder):
    before = {unit.recording: unit.digest for unit in found(folder)}
    (folder / "notes.txt").write_text("changed")
    assert {unit.recording: unit.digest for unit in found(folder)} == before
    with open(folder / "b" / "scene" / "0.png", "wb") as file:
        file.write(b"another")
    os.utime(folder / "a.npz", ns=(1, 1))
    after = {unit.recording: unit.digest for unit in found(folder)}
    assert {name for name in before if before[name] != after[name]} == {"a.npz", "b/scene"}


def test_the_table_inside_a_recording_does_not_change_its_digest(folder):
    out = folder / "b" / "scene" / "table"
    before = {unit.recording: unit.digest for unit in found(folder, excluded=out)}
    (out / "ab").mkdir(parents=True)
    (out / "ab" / "shard.parquet").touch()
    (folder / "b" / "depth" / "summary.html").touch()
    assert {unit.recording: unit.digest for unit in found(folder, excluded=out)} == before
    assert {unit.recording: unit.digest for unit in found(folder)} != before


def test_a_copy_elsewhere_is_the_same_input(folder):
    (before,) = found(folder, given=[folder / "b" / "depth"])
    (folder / "e").mkdir()
    (folder / "b").rename(folder / "e" / "b")
    (after,) = found(folder, given=[folder / "e" / "b" / "depth"], root=folder / "e")
    assert (after.recording, after.digest) == (before.recording, before.digest)


@pytest.fixture
def deep(tmp_path):
    """A folder and one far below it, deeper than the recursion limit, which pytest could not remove."""
    folders = [tmp_path / "deep"]
    for _ in range(300):
        folders.append(folders[-1] / "d")
    for one in folders:
        one.mkdir()
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(len(inspect.stack(0)) + 200)
    yield folders[0], folders[-1]
    sys.setrecursionlimit(limit)
    for one in reversed(folders):
        for file in one.iterdir():
            file.unlink()
        one.rmdir()


def test_folders_are_searched_to_any_depth(deep):
    top, bottom = deep
    (bottom / "a.npz").write_bytes(b"")
    assert [unit.path for unit in found(top)] == [str(bottom / "a.npz")]
    # files below a scene's folder belong to the scene
    (top / "scene.toml").write_text("")
    (before,) = found(top)
    (bottom / "a.npz").write_bytes(b"more")
    (after,) = found(top)
    assert before.path == after.path == str(top)
    assert before.digest != after.digest


def test_a_folder_can_be_excluded(folder):
    assert [unit.recording for unit in found(folder, excluded=folder / "b")] == ["a.npz", "c.mcap", "d"]


@pytest.mark.parametrize(
    ("every", "stretch", "expected"),
    [(1, 2, [(0, 2), (2, None)]), (1, 3, [(0, None)]), (2, 1, [(0, 2), (2, None)]), (1, 99, [(0, None)])],
)
def test_long_recordings_are_worked_on_in_stretches(folder, every, stretch, expected):
    settings = Settings(every=every, stretch=stretch, intrinsics=SCENE.intrinsics, depth_scale=1e-4)
    units = [u for u in found(folder, settings) if u.kind != "scene"]
    for name in ("b/depth", "c.mcap", "d"):
        own = [unit for unit in units if unit.recording == name]
        assert [(unit.start, unit.stop) for unit in own] == expected
        numbers = [number for unit in own for number, _ in iterate_frames(unit, settings)]
        assert numbers == list(range(3)[::every])


def test_one_path_in_place_of_several_is_refused(folder, monkeypatch):
    monkeypatch.chdir(folder)
    with pytest.raises(TypeError, match="recordings: expected a sequence of paths, got str"):
        next(find_units("a.npz", Settings(), folder))
    with pytest.raises(ValueError, match="recordings: expected a path, got an empty text"):
        next(find_units([""], Settings(), folder))
    with pytest.raises(TypeError, match="root: expected a path, got NoneType"):
        next(find_units(["a.npz"], Settings(), None))
    assert [unit.recording for unit in find_units(["a.npz"], Settings(), ".")] == ["a.npz"]


def test_frames_of_images_are_views_in_the_order_of_names(folder):
    settings = Settings(intrinsics=SCENE.intrinsics, depth_scale=SCENE.depth_scale)
    (unit,) = found(folder, settings, given=[folder / "b" / "depth"])
    for (_, read), depth in zip(iterate_frames(unit, settings), SCENE.depth, strict=True):
        seen = read()
        want = strand.View.from_depth(depth, SCENE.intrinsics, depth_scale=SCENE.depth_scale)
        np.testing.assert_array_equal(seen.views[0].points, want.points)
        assert seen.time is None


def test_an_error_says_that_the_tables_folder_is_not_searched(folder):
    out = folder / "empty" / "out"
    out.mkdir(parents=True)
    for given in (out, out.parent):
        with pytest.raises(ValueError, match=f"{given} holds none.* {out} is the folder of the table"):
            found(folder, given=[given], excluded=out)
    with pytest.raises(ValueError, match=r"file$"):
        found(folder, given=[out.parent], excluded=folder)


def test_a_folder_without_recordings_is_refused_before_the_work(folder):
    (folder / "empty").mkdir()
    with pytest.raises(ValueError, match="empty holds none"):
        next(find_units([folder / "a.npz", folder / "empty"], Settings(), folder))
    with pytest.raises(FileNotFoundError):
        next(find_units([folder / "missing"], Settings(), folder))


@pytest.mark.parametrize(
    ("wrong", "error"),
    [
        ({"every": 0}, ValueError),
        ({"stretch": 0}, ValueError),
        ({"radius": -1.0}, ValueError),
        ({"radius": []}, ValueError),
        ({"radius": "4mm"}, TypeError),
        ({"length": ()}, ValueError),
        ({"ropes": 1.5}, TypeError),
        ({"config": "fast"}, TypeError),
        ({"topics": "/depth"}, TypeError),
        ({"color_topics": "/rgb"}, TypeError),
        ({"intrinsics": np.eye(2)}, ValueError),
        ({"bounds": (0, 1)}, ValueError),
    ],
)
def test_settings_are_checked(wrong, error):
    with pytest.raises(error, match=next(iter(wrong))):
        Settings(**wrong)


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.array, lambda value: np.array([value])[0]])
def test_settings_accept_any_type_of_number(kind):
    given = Settings(radius=kind(0.25), length=kind(2.0))
    assert given.digest == Settings(radius=0.25, length=2.0).digest
    assert Settings(radius=np.int64(1)).radius == 1.0
    assert Settings(radius=np.array([0.25, 0.5])).radius == (0.25, 0.5)


def test_settings_cannot_be_changed():
    intrinsics, viewpoint = np.diag([100.0, 100.0, 1.0]), np.zeros(3)
    settings = Settings(intrinsics=intrinsics, viewpoint=viewpoint)
    before = settings.digest
    intrinsics[0, 0], viewpoint[0] = 5.0, 5.0
    assert settings.digest == Settings(intrinsics=np.diag([100.0, 100.0, 1.0]), viewpoint=(0, 0, 0)).digest
    assert (settings.intrinsics[0, 0], settings.viewpoint[0], settings.digest) == (100.0, 0.0, before)
    for array in (settings.intrinsics, settings.viewpoint):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 5.0


def test_the_digest_depends_on_all_settings():
    same = Settings(radius=0.004, bounds=([0, 0, -np.inf], [1.0, 1, 1]), config=strand.Config())
    assert same.digest == Settings(radius=0.004, bounds=([0, 0, -np.inf], [1.0, 1, 1])).digest
    others = [
        Settings(),
        Settings(radius=0.0041, bounds=same.bounds),
        Settings(radius=0.004),
        Settings(radius=0.004, bounds=same.bounds, config=strand.Config.published()),
        Settings(radius=0.004, bounds=same.bounds, every=2),
    ]
    assert len({same.digest, *(one.digest for one in others)}) == 6
    assert len(same.digest) == 16
