"""`strand info`: the contents of files, and advice."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import strand
from lib.bag_files import FORMATS, Messages, record_cameras, record_film, write_bag
from shared.scene_files import POINTS, make_ply
from strand.cli import main
from strand.ropes.doubt import Doubt

SCENE = strand.synthetic.scene("arc", views=3)
SMALL = strand.synthetic.scene("arc", views=2, camera=strand.synthetic.Camera(size=(40, 30)))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with one file of each kind."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    SCENE.save("arc.npz")
    Path("cloud.ply").write_bytes(make_ply("binary_little_endian"))
    Image.fromarray(SMALL.depth[0]).save("depth.png")
    Path("empty.npz").touch()
    write_bag(Path("rope"), "ros1", record_film(SMALL, 3, True))
    write_bag(Path("cameras"), "mcap", record_cameras(SMALL))
    chain = strand.Chain(POINTS, 0.004, confidence=0.5, doubts=(Doubt("end", 0.7, "where", "why"),))
    strand.Model((chain,), SCENE.poses, confidence=0.5, doubts=chain.doubts, method="default").save(
        "model.json"
    )
    return tmp_path


def lines_of(capsys, *files):
    assert main(["info", *files]) == 0
    out, err = capsys.readouterr()
    assert not err
    return out.splitlines()


def test_a_scene(folder, capsys):
    lines = lines_of(capsys, "arc.npz")
    assert lines[:4] == [
        "arc.npz: scene, NPZ archive",
        "  name        arc",
        "  views       3 depth images of 320 x 240 pixels; each with its pose",
        "  intrinsics  fx 212, fy 212, cx 159.5, cy 119.5",
    ]
    assert "  radius      4.2 mm" in lines
    assert "  truth       1 centreline" in lines
    assert lines[-5:] == [
        "  strand reconstruct arc.npz",
        "  ropes       points inside the bounds; if they show a table, the ropes on it",
        "  method      tubes first, images if their answer is doubtful",
        "  radius      4.2 mm, from the scene",
        "  poses       those of the scene, then refined by aligning the views",
    ]


def test_stamps_of_a_scene_and_of_its_model(folder, capsys):
    replace(SCENE, stamps=(12.5, 12.525, 12.51)).save("arc.npz")
    assert "  stamps      12.500 s to 12.525 s" in lines_of(capsys, "arc.npz")
    assert main(["info", "--json", "arc.npz"]) == 0
    holds = json.loads(capsys.readouterr().out)["holds"]
    assert [view["stamp"] for view in holds["views"]] == [12.5, 12.525, 12.51]
    strand.Model([strand.Chain(POINTS, 0.004)], SCENE.poses, stamp=12.525).save("late.json")
    assert "  stamps      12.525 s" in lines_of(capsys, "late.json")


def test_single_files_say_which_options_they_need(folder, capsys):
    points = lines_of(capsys, "cloud.ply")
    assert points[0] == "cloud.ply: points, PLY file"
    assert "  missing     viewpoint, radius, bounds" in points
    assert "  strand reconstruct cloud.ply --viewpoint X,Y,Z" in points
    depth = lines_of(capsys, "depth.png")
    assert depth[:2] == ["depth.png: depth image, PNG file", "  image       40 x 30 pixels"]
    assert "  missing     intrinsics, unit of depth, radius, bounds or masks" in depth
    assert "  strand reconstruct depth.png --intrinsics FX,FY,CX,CY --depth-scale METRES" in depth


def test_a_recording(folder, capsys):
    lines = lines_of(capsys, "rope.bag")
    assert lines[:2] == ["rope.bag: recording, ROS 1 bag", "  recorded    2023-11-14 22:13:20 UTC, 0.1 s"]
    assert "              /depth        sensor_msgs/msg/Image            3     30.0 Hz" in lines
    assert "  depth       /depth: 3 frames, in the TF frame camera" in lines
    assert "  TF frames   camera, world" in lines
    assert "  strand reconstruct rope.bag" in lines
    assert "  frames      the first of 3; --frame N for another one, --every N for many" in lines


def test_several_cameras(folder, capsys):
    lines = lines_of(capsys, "cameras")
    assert "  strand reconstruct cameras --topic /camera_0/depth/image_raw" in lines
    assert "  topics      the first of 2; several --topic also need --world FRAME" in lines
    lines = lines_of(capsys, "cameras", "--topic", "/camera_1/*")
    assert [line.split()[1] for line in lines if line.startswith("  depth ")] == [
        "/camera_1/depth/image_raw:"
    ]
    assert main(["info", "cameras", "--topic", "/no"]) == 2
    err = capsys.readouterr().err
    assert err.startswith(
        "strand: error: topics: no topic /no; cameras has /camera_0/depth/image_raw (sensor_"
    )
    assert main(["reconstruct", "cameras", "--topic", "/no"]) == 2
    assert capsys.readouterr().err == err


def test_points_without_a_finite_one(tmp_path, capsys):
    np.savetxt(tmp_path / "cloud.xyz", np.full((5, 3), np.nan))
    assert main(["info", str(tmp_path / "cloud.xyz")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "  points      0; 5 not finite" in lines
    assert "  missing     points" in lines
    assert lines[-1] == "  refused     it holds no points"


def test_a_model_with_a_table_labels_and_hidden_ends(folder, capsys):
    chains = [
        strand.Chain(POINTS, 0.004, label=2, hidden_ends=(True, False)),
        strand.Chain(POINTS + 0.1, 0.004),
    ]
    up = (0.0, -0.6, 0.8)
    strand.Model(chains, SCENE.poses, up=up, table=(up, -0.25)).save("labels.json")
    lines = lines_of(capsys, "labels.json")
    assert "first hidden" in lines[4]
    assert lines[6:9] == [
        "  up          (0, -0.6, 0.8)",
        "  table       normal (0, -0.6, 0.8), offset -0.25 m",
        "  labels      2, none",
    ]


def test_a_model(folder, capsys):
    lines = lines_of(capsys, "model.json")
    assert lines[0] == "model.json: model, version 2"
    length = f"{strand.load_model('model.json').chains[0].length * 1e3:.1f}"
    assert lines[4].split() == ["0", length, "40", "4.00", "open", "0.50", "end"]
    assert lines[5:] == [
        "  up          (0, 0, 1)",
        "  table       none",
        "  labels      none",
        "  confidence  0.50",
        "  doubts      1 end",
        "  warnings    none",
        "",
        "  strand reconstruct",
        "  refused     it is a model, which strand.load_model() reads",
    ]


def test_a_recording_without_depth_is_refused(folder, capsys):
    made = Messages()
    entries = [("/color", 1, made.image(np.ones((2, 6), np.uint8), 1, encoding="rgb8", step=6, width=2))]
    write_bag(Path("colours"), "mcap", entries)
    lines = lines_of(capsys, "colours")
    assert lines[-1] == "  refused     no topic has readable depth"
    assert main(["reconstruct", "colours"]) == 1
    assert "no topic shows depth" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "options"),
    [
        ("arc.npz", {}),
        ("cloud.ply", {"X,Y,Z": "0,0,0"}),
        ("depth.png", {"FX,FY,CX,CY": "26,26,20,15", "METRES": "0.0001"}),
        ("rope.bag", {}),
        ("cameras", {}),
        ("cameras --topic /camera_1/*", {}),
    ],
)
def test_the_advised_command_works(folder, capsys, monkeypatch, words, options):
    given = []

    def reconstruct(views, **known):
        given.append((len(views), known["radius"], known["bounds"]))
        return strand.Model((), np.eye(4)[None])

    monkeypatch.setattr(strand, "reconstruct", reconstruct)
    assert main(["info", "--json", *words.split()]) == 0
    said = json.loads(capsys.readouterr().out)
    command = said["reconstruct"]["command"]
    for word, value in options.items():
        command = command.replace(word, value)
    assert main(shlex.split(command)[1:]) == 0
    ((views, radius, bounds),) = given
    assert views == (3 if words == "arc.npz" else 1)
    assert ("radius" in said["missing"]) == (radius is None)
    assert any("bounds" in one for one in said["missing"]) == (bounds is None)


def test_json_has_one_line_per_file(folder, capsys):
    names = ["arc.npz", "model.json", "no.npz", "cloud.ply", "cameras"]
    assert main(["info", "--json", *names]) == 3
    out, err = capsys.readouterr()
    assert err == "strand: error: no.npz: No such file or directory\n"
    said = [json.loads(line) for line in out.splitlines()]
    assert [(one["file"], one["kind"], one["format"]) for one in said] == [
        ("arc.npz", "scene", "NPZ archive"),
        ("model.json", "model", "version 2"),
        ("cloud.ply", "points", "PLY file"),
        ("cameras", "recording", "ROS 2 bag"),
    ]
    assert all(set(one) == {"file", "kind", "format", "holds", "missing", "reconstruct"} for one in said)
    scene, model, points, recording = (one["holds"] for one in said)
    np.testing.assert_array_equal([scene["bounds"]["low"], scene["bounds"]["high"]], SCENE.bounds)
    assert [view["size"] for view in scene["views"]] == [[320, 240]] * 3
    assert model["chains"][0]["doubts"] == ["end"]
    assert points["view"]["points"] == len(POINTS)
    assert [camera["frame"] for camera in recording["cameras"]] == ["camera_0", "camera_1"]


def test_bounds_may_be_open_and_turned(folder, capsys):
    Path("open").mkdir()
    np.save("open/a.npy", POINTS)
    text = "[extract]\nlow = [-inf, -1, 0]\nhigh = [1, inf, 9]\nangles_deg = [0, 0, 90]\norigin = [0, 0, 0]\n"
    pose = np.eye(4).tolist()
    Path("open/scene.toml").write_text(f'{text}[[view]]\nfile = "a.npy"\npose = {pose}\n')
    lines = lines_of(capsys, "open")
    at = next(i for i, line in enumerate(lines) if line.startswith("  bounds "))
    assert lines[at].startswith("  bounds      (-inf, -1, 0) to (1, inf, 9) m in its own frame")
    # the box's x axis is the world's y axis, and its y axis the world's -x axis
    inside = (POINTS[:, 1] <= 1) & (-POINTS[:, 0] >= -1) & (POINTS[:, 2] >= 0) & (POINTS[:, 2] <= 9)
    assert f"{np.count_nonzero(inside)} points inside" in lines[at + 2]
    assert main(["info", "--json", "open"]) == 0
    bounds = json.loads(capsys.readouterr().out)["holds"]["bounds"]
    assert (bounds["low"], bounds["high"]) == ([None, -1.0, 0.0], [1.0, None, 9.0])


def test_masks_change_the_advice(folder, capsys):
    with np.load("arc.npz") as arrays:
        np.savez("masked.npz", **arrays, mask=np.ones(SCENE.depth.shape, dtype=bool))
    lines = lines_of(capsys, "masked.npz")
    assert any(line.startswith("  masks       3 of 3 views; up to 1 label; ") for line in lines)
    assert "  ropes       points inside the bounds and the masks" in lines
    assert "  method      images first, tubes if their answer is doubtful" in lines


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["no.npz"], 3, "no.npz: No such file or directory"),
        (["empty.npz"], 1, "empty.npz: the file is empty"),
        (["nothing"], 3, "nothing/scene.toml: No such file; the folder has 1 .jpg"),
        (
            ["arc.npz", "--topic", "/depth"],
            2,
            "topics: only recordings have topics, and arc.npz is not a recording",
        ),
        (["arc.npz", "--max-bytes", "100"], 1, "arc.npz: "),
        (["arc.npz", "--max-bytes", "0"], 2, "max_bytes: expected at least 1, got 0"),
        (["rope.bag", "--max-bytes", "0"], 2, "max_bytes: expected at least 1, got 0"),
        (["depth.png", "--max-bytes", "-1"], 2, "max_bytes: expected at least 1, got -1"),
        (["model.json", "--max-bytes", "0"], 2, "max_bytes: expected at least 1, got 0"),
    ],
)
def test_an_unreadable_file_is_an_error_of_one_line(folder, capsys, words, code, said):
    Path("nothing").mkdir()
    Path("nothing/a.jpg").touch()
    for more in ([], ["--json"]):
        assert main(["info", *words, *more]) == code
        out, err = capsys.readouterr()
        assert not out
        (line,) = err.splitlines()
        assert line.startswith(f"strand: error: {said}")


def test_other_files_are_described_despite_an_error(folder, capsys):
    assert main(["info", "empty.npz", "model.json", "no.npz", "cloud.ply"]) == 1
    out, err = capsys.readouterr()
    assert len(err.splitlines()) == 2
    model, _, points, *_ = out.split("\n\n")
    assert model.startswith("model.json: ")
    assert points.startswith("cloud.ply: ")


def test_control_characters_are_escaped(folder, capsys):
    made = Messages()
    frame = "a\x1b]0;b\x07\nc"
    image = made.image(np.ones((2, 3), np.uint16), 1, frame)
    info = made.info(SCENE.intrinsics, (2, 3), 1)
    write_bag(Path("odd"), "mcap", [("/camera_info", 1, info), ("/depth", 1, image)])
    (line,) = [line for line in lines_of(capsys, "odd") if line.startswith("  depth ")]
    assert line.endswith(r"in the TF frame a\x1b]0;b\x07\nc")
    assert main(["info", "no\x1b[2J.npz"]) == 3
    assert capsys.readouterr().err == "strand: error: no\\x1b[2J.npz: No such file or directory\n"


@pytest.mark.parametrize("kind", FORMATS)
def test_memory_does_not_grow_with_a_recording(tmp_path, kind):
    program = (
        "import resource, sys; from strand.cli import main; assert not main(sys.argv[1:]); "
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, file=sys.stderr)"
    )
    peaks = []
    for frames in (2, 150):
        path = write_bag(tmp_path / f"{frames}", kind, record_film(SCENE, frames, kind == "ros1"))
        command = [sys.executable, "-c", program, "info", str(path)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        peaks.append(int(done.stderr))
    size = 148 * SCENE.depth[0].nbytes / 1024
    assert peaks[1] - peaks[0] < size / 2
