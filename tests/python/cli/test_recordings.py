"""The command line with recordings."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest
from mcap.reader import make_reader

import strand
from lib.bag_files import (
    FORMATS,
    START,
    Messages,
    convert_to_millimeters,
    record_cameras,
    record_film,
    write_bag,
)
from strand.cli import main
from strand.io.models import load_frames
from strand.support.files import FileFormatError

SCENE = strand.synthetic.scene("arc", seed=0, views=3)
SIZE = SCENE.depth.shape[1:]
RADIUS = ["--radius", "4.2mm"]
BOUNDS = ["--bounds", *(f"{x}" for x in np.concatenate(SCENE.bounds).tolist())]
WORLD = ["--world", "world"]
KNOWN = [*RADIUS, *WORLD, *BOUNDS]


def direct(k):
    """Return the nodes of the rope in one view of the scene."""
    view = strand.View.from_depth(
        convert_to_millimeters(SCENE)[k], SCENE.intrinsics, SCENE.poses[k], depth_scale=0.001
    )
    (chain,) = strand.reconstruct([view], radius=0.0042, bounds=SCENE.bounds).chains
    return chain.points


@pytest.mark.parametrize("kind", FORMATS)
def test_one_command_reconstructs_a_recording(tmp_path, capsys, kind):
    path = write_bag(tmp_path / "rope", kind, record_film(SCENE, 3, kind == "ros1"))
    assert main(["reconstruct", str(path), *RADIUS]) == 0
    out, _ = capsys.readouterr()
    ((length,),) = [re.findall(r"^\d+ +(\d+\.\d) +\d+ +4\.20 +open +\d\.\d\d", out, re.MULTILINE)]
    assert float(length) == pytest.approx(400, rel=0.05)
    assert sorted(one.name for one in tmp_path.iterdir()) == [path.relative_to(tmp_path).parts[0]]


def test_several_cameras_and_an_output_file(tmp_path, capsys):
    path = write_bag(tmp_path / "rope", "mcap", record_cameras(SCENE))
    out = tmp_path / "model.json"
    command = ["reconstruct", str(path), "--topic", "/camera_*", *WORLD, *RADIUS, *BOUNDS, "-o", str(out)]
    assert main([*command, "--ropes", "1", "--figures", str(tmp_path / "figures")]) == 0
    with strand.Recording(path, ["/camera_0*"], world="camera_1") as one:
        assert one.frame_id == "camera_1"
    with strand.Recording(path, ["/camera_0*"], poses=[np.eye(4)]) as one:
        assert one.frame_id == "world"
    printed = capsys.readouterr().out.splitlines()
    assert str(out) in printed
    assert len(list((tmp_path / "figures").glob("*.png"))) > 3
    views = [
        strand.View.from_depth(depth, SCENE.intrinsics, pose, depth_scale=0.001)
        for depth, pose in zip(convert_to_millimeters(SCENE), SCENE.poses, strict=True)
    ]
    want = strand.reconstruct(views, radius=0.0042, bounds=SCENE.bounds, ropes=1)
    got = strand.load_model(out)
    # poses come from quaternions, rounded
    np.testing.assert_allclose(got.chains[0].points, want.chains[0].points, rtol=0, atol=1e-6)


def test_a_frame_by_its_number(tmp_path, capsys):
    path = write_bag(tmp_path / "rope", "sqlite3", record_film(SCENE, 3))
    out = tmp_path / "a.json"
    assert main(["reconstruct", str(path), *KNOWN, "--frame", "2", "-o", str(out)]) == 0
    np.testing.assert_allclose(strand.load_model(out).chains[0].points, direct(2), rtol=0, atol=1e-9)
    capsys.readouterr()
    for more in ([], ["--every", "2"]):
        assert main(["reconstruct", str(path), *KNOWN, "--frame", "3", *more]) == 2
        said = "strand: error: --frame 3: the recording has 3 frames, 0 to 2\n"
        assert capsys.readouterr().err == said


def test_every_frame_is_a_line(tmp_path, capsys):
    made = Messages()
    empty = made.image(np.zeros(SIZE, np.uint16), START + 1)
    entries = list(record_film(SCENE, 5))
    entries.append(("/depth", START + 1, empty))
    path = write_bag(tmp_path / "rope", "mcap", sorted(entries, key=lambda entry: entry[1]))
    out = tmp_path / "frames.jsonl"
    command = ["reconstruct", str(path), *KNOWN, "--every", "2", "--frame", "1", "-o", str(out)]
    assert main(command) == 0
    printed, _ = capsys.readouterr()
    rows = re.findall(r"^frame (\d) at (\d+\.\d{3}) s: (.*)$", printed, re.MULTILINE)
    assert [number for number, _, _ in rows] == ["1", "3", "5"]
    assert rows[0][2].startswith("views: ")
    assert re.fullmatch(r"1 rope, \d+\.\d mm, confidence \d\.\d\d", rows[1][2])
    found = list(load_frames(out))
    assert [frame for frame, _, _ in found] == [1, 3, 5]
    assert found[0][2] is None
    assert "error" in json.loads(out.read_text().splitlines()[0])
    for (_, _, model), k in zip(found[1:], (2, 1), strict=True):
        np.testing.assert_allclose(model.chains[0].points, direct(k), rtol=0, atol=1e-9)
    assert found[1][1] == START + 2 * 33_333_333


def test_every_frame_is_a_line_of_json(tmp_path, capsys):
    path = write_bag(tmp_path / "rope", "mcap", record_film(SCENE, 3))
    out = tmp_path / "frames.jsonl"
    command = ["reconstruct", str(path), *KNOWN, "--every", "2", "--json"]
    assert main([*command, "-o", str(out)]) == 0
    printed = capsys.readouterr().out
    assert printed == out.read_text()
    assert [json.loads(line)["frame"] for line in printed.splitlines()] == [0, 2]


def test_frames_are_scene_updates_at_their_times(tmp_path, capsys):
    path = write_bag(tmp_path / "rope", "mcap", record_film(SCENE, 3))
    out, lines = tmp_path / "ropes.mcap", tmp_path / "frames.jsonl"
    command = ["reconstruct", str(path), *KNOWN, "--every", "2"]
    assert main([*command, "-o", str(lines)]) == main([*command, "-o", str(out)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == str(out)
    answers = [json.loads(line) for line in lines.read_text().splitlines()]
    with out.open("rb") as file:
        found = [
            (message.log_time, json.loads(message.data)) for *_, message in make_reader(file).iter_messages()
        ]
    assert [time for time, _ in found] == pytest.approx([one["stamp"] for one in answers], abs=1000)
    for answer, (_, update) in zip(answers, found, strict=True):
        points = [[one[axis] for axis in "xyz"] for one in update["entities"][0]["lines"][0]["points"]]
        np.testing.assert_allclose(points, answer["model"]["chains"][0]["points"], atol=1e-6)
    assert {update["entities"][0]["frame_id"] for _, update in found} == {"world"}
    # one frame in the frame of its camera, and a scene without a time
    assert main(["reconstruct", str(path), *RADIUS, "-o", str(out)]) == 0
    with out.open("rb") as file:
        (update,) = (json.loads(message.data) for *_, message in make_reader(file).iter_messages())
    assert update["entities"][0]["frame_id"] == "camera"
    SCENE.save(tmp_path / "scene.npz")
    assert main(["reconstruct", str(tmp_path / "scene.npz"), "-o", str(out)]) == 0
    with out.open("rb") as file:
        assert [message.log_time for *_, message in make_reader(file).iter_messages()] == [0]


def test_frames_without_an_answer_leave_no_file(tmp_path, capsys):
    made = Messages()
    image = made.image(np.zeros(SIZE, np.uint16), START)
    info = made.info(SCENE.intrinsics, SIZE, START)
    path = write_bag(tmp_path / "rope", "mcap", [("/camera_info", START, info), ("/depth", START, image)])
    out = tmp_path / "frames.jsonl"
    out.write_text("before")
    assert main(["reconstruct", str(path), *RADIUS, "--every", "1", "-o", str(out)]) == 1
    assert "none of 1 frames supports an answer" in capsys.readouterr().err
    assert out.read_text() == "before"
    assert main(["reconstruct", str(path), *RADIUS, "--every", "1", "-o", str(tmp_path / "a.mcap")]) == 1
    assert not [*tmp_path.glob(".strand-*"), *tmp_path.glob("a.mcap")]


def test_a_recording_without_camera_info_is_read_with_intrinsics(tmp_path, capsys):
    messages = [message for message in record_film(SCENE, 1) if "info" not in message[0]]
    path = write_bag(tmp_path / "rope", "mcap", messages)
    assert main(["reconstruct", str(path), *KNOWN]) == 1
    assert "no CameraInfo" in capsys.readouterr().err
    (fx, _, cx), (_, fy, cy), _ = SCENE.intrinsics
    assert main(["reconstruct", str(path), *KNOWN, "--intrinsics", f"{fx},{fy},{cx},{cy}"]) == 0
    assert "open" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["no.bag"], 3, "no.bag: No such file or directory"),
        (["empty.mcap"], 1, "empty.mcap: truncated, damaged or not a bag"),
        (
            ["rope.bag", "--topic", "/no"],
            2,
            "topics: no topic /no; rope.bag has /depth (sensor_msgs/msg/Imag",
        ),
        (["rope.bag", "--world", "map"], 2, "no frame 'map' in TF; there are camera, world"),
        (["rope.bag", "--every", "0"], 2, "error: --every: expected at least 1, got 0"),
        (["rope.bag", "--frame", "-1"], 2, "--frame -1: the recording has 2 frames, 0 to 1"),
        (["rope.bag", "--frame", "-1", "--every", "1"], 2, "--frame -1: the recording has 2 frames, 0 to 1"),
        (["rope.bag", "--tolerance", "-1"], 2, "tolerance: expected a number >= 0"),
        (["rope.bag", "--mask", "a.png"], 2, "--mask: for scenes only, and rope.bag is a recording"),
        (["rope.bag", "--every", "1", "--figures", "f"], 2, "--figures: for one frame only"),
        (["rope.bag", "-o", "rope.bag"], 2, "--out: expected another file than the inputs"),
        (["rope.bag", "-o", "no/a.json"], 3, "no/a.json: No such file or directory"),
        (["rope.bag", "--depth-scale", "0"], 2, "depth_scale: expected a positive number"),
        (["arc.npz", "--frame", "0"], 2, "--frame: for recordings only, and arc.npz is none"),
        (["arc.npz", "--ignore-distortion"], 2, "--ignore-distortion: for recordings only"),
        (["arc.npz", "--depth-scale", "1"], 2, "depth_scale: accepted only for a single file"),
    ],
)
def test_errors_are_one_line(tmp_path, monkeypatch, capsys, arguments, code, said):
    monkeypatch.chdir(tmp_path)
    write_bag(tmp_path / "rope", "ros1", record_film(SCENE, 2, True))
    SCENE.save(tmp_path / "arc.npz")
    (tmp_path / "empty.mcap").write_bytes(b"")
    assert main(["reconstruct", *arguments]) == code
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("strand: error: ")
    assert said in line


def test_a_scene_needs_no_output_file(tmp_path, capsys):
    SCENE.save(tmp_path / "arc.npz")
    assert main(["reconstruct", str(tmp_path / "arc.npz")]) == 0
    assert "chain  length / mm" in capsys.readouterr().out
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b"", None),
        (b'{"frame": 0', "line 1: truncated, or not JSON"),
        (b"[]", "line 1: not a frame's model"),
        (b'{"frame": 0, "stamp": 1}', "line 1: not a frame's model"),
        (b'{"frame": -1, "stamp": 1, "error": ""}', "line 1: not a frame's model"),
        (b'{"frame": 0, "stamp": 1, "model": {}}', "not a strand model"),
        (b'{"frame": 0, "stamp": 1, "model": 3}', "not a strand model"),
    ],
)
def test_invalid_lines_are_named(tmp_path, line, reason):
    path = tmp_path / "a.jsonl"
    path.write_bytes(line)
    if reason is None:
        assert list(load_frames(path)) == []
        return
    with pytest.raises(FileFormatError, match=reason) as caught:
        list(load_frames(path))
    assert caught.value.file == str(path)


def test_frames_are_rows_of_a_table(tmp_path, capsys):
    made = Messages()
    entries = [
        *record_film(SCENE, 3),
        ("/depth", START + 1, made.image(np.zeros(SIZE, np.uint16), START + 1)),
    ]
    path = write_bag(tmp_path / "rope", "mcap", sorted(entries, key=lambda entry: entry[1]))
    out, lines = tmp_path / "frames.csv", tmp_path / "frames.jsonl"
    command = ["reconstruct", str(path), *KNOWN, "--every", "1"]
    assert main([*command, "-o", str(out)]) == main([*command, "-o", str(lines)]) == 0
    with out.open(newline="") as file:
        rows = list(csv.DictReader(file))
    answers = [json.loads(line) for line in lines.read_text().splitlines()]
    assert [int(row["frame"]) for row in rows] == [answer["frame"] for answer in answers] == [0, 1, 2, 3]
    for row, answer in zip(rows, answers, strict=True):
        assert int(row["stamp"]) == answer["stamp"]
        if "error" in answer:
            assert (row["rope"], row["length"], row["error"]) == ("", "", answer["error"])
            continue
        (chain,) = answer["model"]["chains"]
        assert (row["rope"], row["error"]) == ("0", "")
        assert float(row["radius"]) == chain["radius"]
        assert float(row["model_confidence"]) == answer["model"]["confidence"]
        assert [float(row[f"{axis}_last"]) for axis in "xyz"] == chain["points"][-1]
    assert sum("error" in answer for answer in answers) == 1
    capsys.readouterr()
    for name in ("frames.ply", "frames.parquet", "frames"):
        assert main([*command, "-o", str(tmp_path / name)]) == 2
        assert "--out: with --every, expected a .csv, .mcap, .json or .jsonl file" in capsys.readouterr().err
        assert not (tmp_path / name).exists()
