"""The command line."""

from __future__ import annotations

import contextlib
import io
import json
import os
import pty
import re
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import strand
from shared.ropes import find_rope_pixels
from strand import cli
from strand.cli import main
from strand.ropes.doubt import Doubt, ModelWarning

STAGES = ["extract", "filter", "register", "arcs", "link", "fit", "ends"]
PUBLISHED_STAGES = ["extract", "filter", "normals", "register", "centerline", "trace", "split", "reconnect"]
SCENE = strand.synthetic.scene("arc", views=3)


@pytest.fixture
def scene_npz(tmp_path):
    SCENE.save(tmp_path / "arc.npz")
    return tmp_path / "arc.npz"


def write_folder(folder, radius='radius = "4.2mm"'):
    """SCENE as a folder with a description and depth images."""
    (fx, _, cx), (_, fy, cy), _ = SCENE.intrinsics.tolist()
    low, high = SCENE.bounds
    lines = [
        radius,
        f"[camera]\nfx = {fx}\nfy = {fy}\ncx = {cx}\ncy = {cy}\ndepth_scale = {SCENE.depth_scale}",
        f"[extract]\nlow = {low.tolist()}\nhigh = {high.tolist()}",
    ]
    for i, (depth, pose) in enumerate(zip(SCENE.depth, SCENE.poses, strict=True)):
        Image.fromarray(depth).save(folder / f"{i}.png")
        lines.append(f'[[view]]\nfile = "{i}.png"\npose = {pose.tolist()}')
    (folder / "scene.toml").write_text("\n".join(lines))


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo") / "out"
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["demo", "--out", str(folder), "--seed", "1"])
    return code, out.getvalue(), err.getvalue(), folder


def test_demo_shows_both_methods_the_default_one_first(demo):
    code, out, err, _ = demo
    assert code == 0
    default, published = out.split("The published method\n")
    assert default.startswith("The default method\n")
    for said, names in ((default, STAGES), (published, PUBLISHED_STAGES)):
        rows = re.findall(r"^(\w+) +(\d+)? +(\d+)? +\d+\.\d$", said, re.MULTILINE)
        assert [name for name, *_ in rows if name != "total"] == names
        points = [(int(before), int(after)) for _, before, after in rows if before]
        assert points[0][0] > points[0][1] > 1000
        assert len(points) > 4
        assert all(before[1] == after[0] for before, after in pairwise(points))
        assert re.search(
            r"^rope 0: length \d+\.\d mm, truth 400\.\d mm \([+-]\d+\.\d+%\), RMS", said, re.MULTILINE
        )
        assert "rope 1" not in said
    assert re.search(r"^whole ropes +1$", default, re.MULTILINE)
    counts = re.findall(r"^([a-z ]+?) +(\d+) +(\d+)$", published, re.MULTILINE)
    assert [(name, paper) for name, _, paper in counts] == [
        ("chains traced", "3"),
        ("segments after the split", "7"),
        ("whole strings", "1"),
    ]
    assert [here for _, here, _ in counts[1:]] == ["7", "1"]
    assert [line for line in err.splitlines() if "warning" not in line] == [
        f"strand: {name}" for name in (*STAGES, *PUBLISHED_STAGES)
    ]


def test_demo_writes_models_and_figures_of_both_methods(demo):
    _, out, _, folder = demo
    written = sorted(str(path) for path in folder.rglob("*") if path.is_file())
    assert sorted(line for line in out.splitlines() if line.startswith(str(folder))) == written
    for place, method, figures in ((folder, "default", 8), (folder / "published", "published", 10)):
        assert len(list(place.glob("*.png"))) == figures
        model = strand.load_model(place / "model.json")
        assert (model.method, len(model.chains)) == (method, 1)
    assert len(written) == 8 + 10 + 2


def test_demo_leaves_other_files_alone(demo, tmp_path, monkeypatch, capsys):
    _, _, _, folder = demo
    shutil.copytree(folder, tmp_path / "out")
    (tmp_path / "out" / "notes.txt").write_text("mine")
    monkeypatch.setattr(cli.demo.figures, "write_figures", lambda *_: [])
    assert main(["demo", "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "notes.txt").read_text() == "mine"
    assert "model.json" in capsys.readouterr().out


def test_reconstruct_npz(scene_npz, tmp_path, capsys):
    assert main(["reconstruct", str(scene_npz), "-o", str(tmp_path / "a.json"), "--ropes", "1"]) == 0
    out, err = capsys.readouterr()
    model = strand.load_model(tmp_path / "a.json")
    (chain,) = model.chains
    row = f"0 +{chain.length * 1e3:.1f} +{len(chain.points)} +{chain.radius * 1e3:.2f} +open"
    assert re.search(rf"^{row} +{chain.confidence:.2f}( +[a-z ,+0-9]+)?$", out, re.MULTILINE)
    assert f"\nconfidence: {model.confidence:.2f} that all ropes run as said\n" in out
    assert re.findall(r"^([a-z]+) +\d+\.\d$", out, re.MULTILINE) == [*STAGES, "total"]
    assert out.splitlines()[-1] == str(tmp_path / "a.json")
    assert [line for line in err.splitlines() if "warning" not in line] == [
        f"strand: {name}" for name in STAGES
    ]
    want = strand.reconstruct(SCENE.views, radius=SCENE.radius, bounds=SCENE.bounds, ropes=1)
    np.testing.assert_array_equal(chain.points, want.chains[0].points)
    assert "estimated" not in out


def test_radius_is_estimated_and_printed_if_nobody_gives_it(tmp_path, capsys):
    write_folder(tmp_path, radius="")
    assert main(["reconstruct", str(tmp_path), "-o", str(tmp_path / "a.json")]) == 0
    out, err = capsys.readouterr()
    (shown,) = re.findall(r"^radius: (\d\.\d\d) mm, estimated from what the views show$", out, re.MULTILINE)
    (chain,) = strand.load_model(tmp_path / "a.json").chains
    assert shown == f"{1e3 * chain.radius:.2f}"
    assert float(shown) == pytest.approx(4.2, rel=0.05)
    assert "strand: radius" in err.splitlines()


def test_published_method_by_its_name(scene_npz, tmp_path, capsys):
    (tmp_path / "a.toml").write_text('method = "published"\n')
    command = ["-o", str(tmp_path / "a.json"), "--config", str(tmp_path / "a.toml")]
    assert main(["reconstruct", str(scene_npz), *command, "--figures", str(tmp_path / "figures")]) == 0
    out = capsys.readouterr().out
    assert re.findall(r"^([a-z]+) +\d+\.\d$", out, re.MULTILINE) == [*PUBLISHED_STAGES, "total"]
    assert len(list((tmp_path / "figures").iterdir())) == 10
    write_folder(tmp_path, radius="")
    assert main(["reconstruct", str(tmp_path), *command]) == 2
    assert capsys.readouterr().err.splitlines() == [
        "strand: error: radius: the published method needs the ropes' one radius, metres "
        "(--radius on the command line)"
    ]
    assert main(["reconstruct", str(tmp_path), *command, "--radius", "4.2mm"]) == 0


def test_reconstruct_folder_is_the_same_as_its_archive(scene_npz, tmp_path):
    write_folder(tmp_path)
    for scene, out in ((scene_npz, "a.json"), (tmp_path, "b.json"), (tmp_path / "scene.toml", "c.json")):
        assert main(["reconstruct", str(scene), "-o", str(tmp_path / out)]) == 0
    a, b, c = (strand.load_model(tmp_path / f"{name}.json").chains[0].points for name in "abc")
    np.testing.assert_allclose(a, b, atol=1e-12)
    np.testing.assert_array_equal(b, c)


def test_options_reach_the_reconstruction(scene_npz, tmp_path, monkeypatch):
    given = {}
    made = strand.reconstruct(SCENE.views, radius=SCENE.radius, bounds=SCENE.bounds)

    def reconstruct(views, **options):
        given.update(options, views=len(views))
        return made

    monkeypatch.setattr(strand, "reconstruct", reconstruct)
    (tmp_path / "a.toml").write_text("[tracing]\nnear = 0.75\n")
    command = ["reconstruct", str(scene_npz), "-o", str(tmp_path / "a.json")]
    assert main(command) == 0
    assert given["views"] == 3
    assert given["radius"] == SCENE.radius
    np.testing.assert_array_equal(given["bounds"], SCENE.bounds)
    assert (given["ropes"], given["config"], given["keep_stages"]) == (None, strand.Config(), False)
    command += ["--radius", "5mm", "--ropes", "2", "--config", str(tmp_path / "a.toml")]
    command += ["--bounds", "-0.2", "-.1", "1mm", "20cm", "0.1", "0.05"]
    assert main(command) == 0
    assert (given["radius"], given["ropes"], given["config"].tracing.near) == (0.005, 2, 0.75)
    assert given["length"] is None
    np.testing.assert_array_equal(given["bounds"], [[-0.2, -0.1, 0.001], [0.2, 0.1, 0.05]])
    assert main([*command, "--length", "40cm"]) == 0
    assert given["length"] == 0.4
    assert main([*command, "--length", "40cm", "300mm"]) == 0
    assert given["length"] == [0.4, 0.3]


def test_masks_are_read_for_each_view(scene_npz, tmp_path, monkeypatch):
    given = []
    made = strand.reconstruct(SCENE.views, radius=SCENE.radius, bounds=SCENE.bounds)

    def reconstruct(views, **_):
        given.extend(views)
        return made

    monkeypatch.setattr(strand, "reconstruct", reconstruct)
    masks, paths = find_rope_pixels(SCENE), [tmp_path / f"mask{i}.png" for i in range(3)]
    for path, mask in zip(paths, masks, strict=True):
        Image.fromarray(mask.astype(np.uint8) * 255).save(path)
    command = ["reconstruct", str(scene_npz), "-o", str(tmp_path / "a.json"), "--mask", *map(str, paths)]
    assert main(command) == 0
    for view, mask in zip(given, masks, strict=True):
        np.testing.assert_array_equal(view.mask, mask)


def test_radius_none_is_passed_on(tmp_path, monkeypatch, capsys):
    write_folder(tmp_path, radius="")

    def reconstruct(views, *, radius, **_):
        raise strand.NotEnoughDataError(f"radius: {radius}\nis not known")

    monkeypatch.setattr(strand, "reconstruct", reconstruct)
    assert main(["reconstruct", str(tmp_path), "-o", str(tmp_path / "a.json")]) == 1
    assert capsys.readouterr().err.splitlines()[-1] == "strand: error: radius: None is not known"


def test_reconstruct_draws_figures(scene_npz, tmp_path, monkeypatch, capsys):
    def write_figures(model, directory, truth):
        assert model.stages
        assert len(truth) == 1
        return [directory / "a.png"]

    monkeypatch.setattr(cli.demo.figures, "write_figures", write_figures)
    command = [
        "reconstruct",
        str(scene_npz),
        "-o",
        str(tmp_path / "a.json"),
        "--figures",
        str(tmp_path / "f"),
    ]
    assert main(command) == 0
    assert capsys.readouterr().out.splitlines()[-1] == str(tmp_path / "f" / "a.png")


def test_warnings_go_to_stderr(scene_npz, tmp_path, capsys):
    command = ["reconstruct", str(scene_npz), "-o", str(tmp_path / "a.json"), "--ropes", "9"]
    assert main(command) == 0
    out, err = capsys.readouterr()
    assert "strand: warning: " in err
    assert "strand: " not in out


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (["no.npz", "-o", "a.json"], 3, "no.npz: No such file or directory"),
        (["empty.npz", "-o", "a.json"], 1, "empty.npz: the file is empty"),
        (["half.npz", "-o", "a.json"], 1, "half.npz: truncated"),
        (["arc.npz", "-o", "no/a.json"], 3, "no/a.json: No such file or directory"),
        (["arc.npz", "-o", "."], 3, ".: Not a regular file"),
        (["arc.npz", "-o", "a.json", "--config", "no.toml"], 3, "no.toml: No such file or directory"),
        (["arc.npz", "-o", "a.json", "--config", "bad.toml"], 1, "bad.toml: "),
        (["arc.npz", "-o", "a.json", "--radius", "0"], 2, "radius: "),
        (["arc.npz", "-o", "a.json", "--ropes", "0"], 2, "ropes: "),
        (
            ["arc.npz", "-o", "a.json", "--mask", "none.npy"],
            2,
            "masks: expected one file for each of 3 views",
        ),
        (
            ["arc.npz", "-o", "a.json", "--mask", *["none.npy"] * 3],
            1,
            "views: no view has a point: view 0 has an",
        ),
        (["arc.npz", "-o", "a.json", "--mask", *["small.npy"] * 3], 1, "small.npy: mask: expected the depth"),
        (["arc.npz", "-o", "a.json", "--mask", *["no.png"] * 3], 3, "no.png: No such file or directory"),
        (["arc.npz", "-o", "a.json", "--ropes", "1", "--length", "1", "2"], 2, "length: "),
        (["arc.npz", "-o", "a.json", "--bounds", "0", "0", "0", "-1", "1", "1"], 2, "bounds: "),
        (["arc.npz", "-o", "a.json", "--bounds", "7", "7", "7", "8", "8", "8"], 1, ""),
    ],
)
def test_expected_errors_are_one_line(scene_npz, tmp_path, monkeypatch, capsys, options, code, message):
    monkeypatch.chdir(tmp_path)
    Path("empty.npz").touch()
    Path("half.npz").write_bytes(scene_npz.read_bytes()[:5000])
    Path("bad.toml").write_text("[tracing]\nneer = 1\n")
    np.save("none.npy", np.zeros(SCENE.depth[0].shape, dtype=bool))
    np.save("small.npy", np.ones((3, 4), dtype=bool))
    assert main(["reconstruct", *options]) == code
    assert capsys.readouterr().err.splitlines()[-1].startswith(f"strand: error: {message}")
    assert not Path("a.json").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["demolish"],
        ["reconstruct"],
        ["reconstruct", "arc.npz", "-o", "a.json", "--radius", "4.2 inch"],
        ["reconstruct", "arc.npz", "-o", "a.json", "--ropes", "one"],
        ["reconstruct", "", "-o", "a.json"],
        ["reconstruct", "arc.npz", "-o", ""],
        ["reconstruct", "arc.npz", "-o", "a.json", "--mask", ""],
        ["reconstruct", "arc.npz", "-o", "a.json", "--bounds", "1", "2"],
        ["demo", "--seed", "x"],
    ],
)
def test_wrong_usage(arguments, capsys):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    assert "usage: strand" in capsys.readouterr().err


def test_wrong_length_is_explained(capsys):
    with pytest.raises(SystemExit):
        main(["reconstruct", "a.npz", "-o", "a.json", "--radius", "4.2 inch"])
    assert "--radius: length: expected metres, or a number with mm, cm or m" in capsys.readouterr().err


def test_version_and_help(capsys):
    for arguments in (["--version"], ["--help"], ["demo", "--help"], ["reconstruct", "--help"]):
        with pytest.raises(SystemExit) as caught:
            main(arguments)
        assert caught.value.code == 0
        out = capsys.readouterr().out
        assert out == f"strand {strand.__version__}\n" if arguments == ["--version"] else "exit codes:" in out


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (KeyboardInterrupt(), 130, "strand: error: interrupted"),
        (ImportError("pillow is needed here"), 3, "strand: error: pillow is needed here"),
        (PermissionError(13, "Permission denied", "a.npz"), 3, "strand: error: a.npz: Permission denied"),
        (OSError("no space"), 3, "strand: error: no space"),
        (TypeError("radius: expected a number"), 2, "strand: error: radius: expected a number"),
    ],
)
def test_exit_codes(monkeypatch, capsys, error, code, line):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr(cli.inputs, "load_scene", fail)
    assert main(["reconstruct", "a.npz", "-o", "a.json"]) == code
    assert capsys.readouterr().err.splitlines() == [line]


def test_errors_of_ours_are_not_hidden(monkeypatch):
    def fail(*_, **__):
        raise ZeroDivisionError

    monkeypatch.setattr(cli.inputs, "load_scene", fail)
    with pytest.raises(ZeroDivisionError):
        main(["reconstruct", "a.npz", "-o", "a.json"])


PROGRAM = str(Path(sys.executable).with_name("strand"))


@pytest.mark.parametrize("program", [[PROGRAM], [sys.executable, "-m", "strand"]])
def test_installed_program(program, scene_npz, tmp_path):
    done = subprocess.run(
        [*program, "reconstruct", str(scene_npz), "-o", str(tmp_path / "a.json")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert strand.load_model(tmp_path / "a.json").chains


def test_closed_pipe_is_not_an_error(scene_npz, tmp_path):
    process = subprocess.Popen(
        [PROGRAM, "reconstruct", str(scene_npz), "-o", str(tmp_path / "a.json")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    process.stdout.close()
    err = process.stderr.read()
    process.stderr.close()
    assert process.wait() == 141
    assert "Error" not in err
    assert "Traceback" not in err


SLOW = """
import sys, time, strand, strand.cli

def reconstruct(*_, progress, **__):
    for stage in stages.split(","):
        progress(stage)
        time.sleep(float(seconds))
    return made

*sys.argv, stages, seconds = sys.argv
made = strand.Model((), __import__("numpy").eye(4)[None])
strand.reconstruct = reconstruct
sys.exit(strand.cli.main())
"""


def on_a_terminal(*command):
    """The exit code of a command, and what it shows on a terminal of its own, step by step."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        command, stdout=theirs, stderr=theirs, env=os.environ | {"TERM": "xterm", "COLUMNS": "80"}
    )
    os.close(theirs)
    shown = b""
    with contextlib.suppress(OSError):  # what a terminal says when its last user is gone
        while block := os.read(ours, 4096):
            shown += block
    os.close(ours)
    return process.wait(), shown.decode()


def test_stages_and_their_times_are_shown_on_a_terminal_if_they_last(scene_npz):
    command = [sys.executable, "-c", SLOW, "reconstruct", str(scene_npz)]
    code, shown = on_a_terminal(*command, "first,second,third", "0.7")
    assert code == 0
    pictures = re.sub(r"\x1b\[[0-9;]*m", "", shown).split("\x1b[2K")
    rows = [re.findall(r"(first|second|third) +(\d\.\d) s", picture) for picture in pictures]
    # the first second goes by in silence, and the last picture has all three
    begun = next(filter(None, rows))
    assert begun[0][0] == "first"
    assert sum(float(seconds) for _, seconds in begun) >= 1.0
    last = [row for row in rows if row][-1]
    assert [name for name, _ in last] == ["first", "second", "third"]
    assert float(last[0][1]) >= 0.7
    # it is taken away before the answer is printed
    after = shown[shown.rindex("third") :]
    assert "\x1b[?25h" in after
    assert after.index("\x1b[?25h") < after.index("confidence")
    assert "strand: " not in shown


def test_nothing_flashes_on_a_terminal(scene_npz):
    command = [sys.executable, "-c", SLOW, "reconstruct", str(scene_npz)]
    code, shown = on_a_terminal(*command, "one", "0.1")
    assert code == 0
    assert "\x1b" not in shown
    assert "one " not in shown


def test_errors_break_between_words_on_a_terminal(scene_npz):
    code, shown = on_a_terminal(PROGRAM, "reconstruct", "a.npz", "b.npz")
    assert code == 2
    lines = shown.splitlines()
    assert len(lines) == 2
    assert all(len(line) <= 80 for line in lines)
    assert " ".join(shown.split()).startswith(
        "strand: error: SCENE: expected one, got 2; files of several views"
    )


def test_a_model_as_json_is_all_of_the_output(scene_npz, tmp_path, capsys):
    out = tmp_path / "a.json"
    command = [
        "reconstruct",
        str(scene_npz),
        "--ropes",
        "2",
        "-o",
        str(out),
        "--tube",
        str(tmp_path / "a.ply"),
    ]
    assert main([*command, "--json"]) == 0
    printed, err = capsys.readouterr()
    written = json.loads(out.read_text())
    assert printed.count("\n") == 1
    assert json.loads(printed) | {"timings": 0} == written | {"timings": 0}
    assert "strand: warning: found fewer ropes" in err
    assert main(["reconstruct", "no.npz", "--json"]) == 3
    assert capsys.readouterr() == ("", "strand: error: no.npz: No such file or directory\n")


def test_what_speaks_against_an_answer_is_said_once_the_heaviest_first(scene_npz, monkeypatch, capsys):
    doubts = [Doubt("end", weight, "where", f"it is {weight}") for weight in np.linspace(0.9, 0.1, 15)]
    warnings = [
        ModelWarning("branch", "a branch"),
        ModelWarning("end", "an end", None, doubts[2].amount),
    ]
    made = strand.Model((), np.eye(4)[None], warnings=warnings, doubts=doubts, confidence=0.25)
    monkeypatch.setattr(strand, "reconstruct", lambda *_, **__: made)
    assert main(["reconstruct", str(scene_npz)]) == 0
    out, err = capsys.readouterr()
    assert "confidence: 0.25 " in out
    lines = err.splitlines()
    assert lines[:4] == [
        "strand: doubt: unsure where: it is 0.9, weight 0.9",
        "strand: doubt: unsure where: it is 0.8428571428571429, weight 0.84",
        "strand: warning: an end, weight 0.79",
        "strand: doubt: unsure where: it is 0.7285714285714286, weight 0.73",
    ]
    assert lines[10:] == [
        "strand: warning: a branch",
        "strand: and 5 doubts of less weight, which the model's file has",
    ]


def test_the_scene_is_never_overwritten(tmp_path, capsys):
    path = tmp_path / "scene.npz"
    strand.synthetic.scene("arc", seed=0).save(path)
    before = path.read_bytes()
    assert main(["reconstruct", str(path), "-o", str(path)]) == 2
    assert path.read_bytes() == before
    assert "part of the scene" in capsys.readouterr().err
    mask = tmp_path / "mask.npy"
    np.save(mask, np.ones((240, 320), dtype=bool))
    before = mask.read_bytes()
    assert main(["reconstruct", str(path), "-o", str(mask), "--mask", *[str(mask)] * 7]) == 2
    assert mask.read_bytes() == before
    assert "part of the scene" in capsys.readouterr().err


def test_negative_lengths_are_values(tmp_path, capsys):
    path = tmp_path / "scene.npz"
    strand.synthetic.scene("arc", seed=0).save(path)
    model = str(tmp_path / "model.json")
    assert main(["reconstruct", str(path), "-o", model, "--radius", "-4mm"]) == 2
    assert "radius" in capsys.readouterr().err
    bounds = ["-300mm", "-0.3", "2.5mm", "300mm", "0.3", "20mm"]
    assert main(["reconstruct", str(path), "-o", model, "--bounds", *bounds]) == 0


def test_report_writes_a_page(scene_npz, tmp_path, capsys):
    out = tmp_path / "report.html"
    assert main(["report", str(scene_npz), "-o", str(out), "--ropes", "1"]) == 0
    assert capsys.readouterr().out == f"{out}\n"
    text = out.read_text("utf-8")
    assert "<h1>arc</h1>" in text
    assert "<td>ropes</td><td>1</td>" in text
    assert "1 chain (" in text


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["report", "arc.npz", "-o", "arc.npz"], 2, "--out: arc.npz is part of the scene"),
        (["report", "arc.npz", "-o", "no/a.html"], 3, "no/a.html: No such file or directory"),
        (["report", "no.npz", "-o", "a.html"], 3, "no.npz: No such file or directory"),
        (["report", "arc.npz", "-o", "a.html", "--radius", "0"], 2, "radius: "),
        (["view", "arc.npz", "--save", "arc.npz"], 2, "--save: arc.npz is part of the scene"),
        (["view", "arc.npz", "--save", "no/a.rrd"], 3, "no/a.rrd: No such file or directory"),
    ],
)
def test_report_and_view_refuse_what_cannot_be(words, code, message, scene_npz, monkeypatch, capsys):
    monkeypatch.chdir(scene_npz.parent)
    monkeypatch.setitem(sys.modules, "rerun", sys)  # that it is there is enough
    before = scene_npz.read_bytes()
    assert main(words) == code
    assert message in capsys.readouterr().err
    assert scene_npz.read_bytes() == before
    assert [path.name for path in scene_npz.parent.iterdir()] == ["arc.npz"]


@pytest.mark.parametrize(
    ("words", "package"), [(["report", "-o", "a.html"], "plotly"), (["view", "--save", "a.rrd"], "rerun")]
)
def test_missing_packages_are_named_before_the_work(words, package, monkeypatch, capsys):
    for name in [name for name in sys.modules if name.split(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    assert main([words[0], "no.npz", *words[1:]]) == 3
    assert "is needed here: pip install" in capsys.readouterr().err


def test_view_saves_a_recording(scene_npz, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rerun", sys)
    monkeypatch.setattr(
        cli.view.rerun_view,
        "write_recording",
        lambda model, views, path, truth: path.write_text(f"{len(views)}"),
    )
    assert main(["view", str(scene_npz), "--save", str(tmp_path / "a.rrd")]) == 0
    assert (tmp_path / "a.rrd").read_text() == "3"
    assert capsys.readouterr().out == f"{tmp_path / 'a.rrd'}\n"
