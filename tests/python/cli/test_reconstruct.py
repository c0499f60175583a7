"""`strand reconstruct`: its options, and what it prints and writes."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from PIL import Image

import strand
from shared.ropes import find_rope_pixels
from strand.cli import main
from strand.report import figures
from strand.ropes.doubt import Doubt, ModelWarning
from strand.ropes.summary import format_confidence

STAGES = ["extract", "filter", "register", "arcs", "link", "fit", "ends"]
PUBLISHED_STAGES = ["extract", "filter", "normals", "register", "centerline", "trace", "split", "reconnect"]
SCENE = strand.synthetic.scene("arc", views=3)


def write_folder(folder, radius='radius = "4.2mm"'):
    """Write SCENE as a folder with a description and depth images."""
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


def test_reconstruct_npz(scene_npz, tmp_path, capsys):
    assert main(["reconstruct", str(scene_npz), "-o", str(tmp_path / "a.json"), "--ropes", "1"]) == 0
    out, err = capsys.readouterr()
    model = strand.load_model(tmp_path / "a.json")
    (chain,) = model.chains
    row = f"0 +{chain.length * 1e3:.1f} +{len(chain.points)} +{chain.radius * 1e3:.2f} +open"
    assert re.search(rf"^{row} +{format_confidence(chain.confidence)}( +[a-z ,+0-9]+)?$", out, re.MULTILINE)
    assert f" with probability {format_confidence(model.confidence)}.\n" in out
    assert re.findall(r"^([a-z]+) +\d+\.\d$", out, re.MULTILINE) == [*STAGES, "total"]
    assert out.splitlines()[-1] == str(tmp_path / "a.json")
    assert [line for line in err.splitlines() if "warning" not in line] == [
        f"strand: {name}" for name in STAGES
    ]
    want = strand.reconstruct(SCENE.views, radius=SCENE.radius, bounds=SCENE.bounds, ropes=1)
    np.testing.assert_array_equal(chain.points, want.chains[0].points)
    assert "estimated" not in out


def test_an_unknown_radius_is_estimated_and_printed(tmp_path, capsys):
    write_folder(tmp_path, radius="")
    assert main(["reconstruct", str(tmp_path), "-o", str(tmp_path / "a.json")]) == 0
    out, err = capsys.readouterr()
    pattern = r"^radius: (\d\.\d\d) ± (\d\.\d\d) mm, estimated from the views$"
    ((shown, sd),) = re.findall(pattern, out, re.MULTILINE)
    (chain,) = strand.load_model(tmp_path / "a.json").chains
    assert (shown, sd) == (f"{1e3 * chain.radius:.2f}", f"{1e3 * chain.radius_sd:.2f}")
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

    monkeypatch.setattr(figures, "write_figures", write_figures)
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


def test_json_prints_only_the_model(scene_npz, tmp_path, capsys):
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


def test_remarks_are_printed_once_the_heaviest_first(scene_npz, monkeypatch, capsys):
    doubts = [Doubt("end", weight, "where", f"it is {weight}") for weight in np.linspace(0.9, 0.1, 15)]
    warnings = [
        ModelWarning("branch", "a branch"),
        ModelWarning("end", "an end", None, doubts[2].amount),
    ]
    made = strand.Model((), np.eye(4)[None], warnings=warnings, doubts=doubts, confidence=0.25)
    monkeypatch.setattr(strand, "reconstruct", lambda *_, **__: made)
    assert main(["reconstruct", str(scene_npz)]) == 0
    out, err = capsys.readouterr()
    assert "Do not act on it" in out
    lines = err.splitlines()
    assert lines[:4] == [
        "strand: doubt: unsure where: it is 0.9, weight 0.9",
        "strand: doubt: unsure where: it is 0.8428571428571429, weight 0.84",
        "strand: warning: an end, weight 0.79",
        "strand: doubt: unsure where: it is 0.7285714285714286, weight 0.73",
    ]
    assert lines[10:] == [
        "strand: warning: a branch",
        "strand: and 5 lighter doubts, which the model's JSON holds",
    ]


def test_the_scene_is_never_overwritten(tmp_path, capsys):
    path = tmp_path / "scene.npz"
    strand.synthetic.scene("arc", seed=0).save(path)
    before = path.read_bytes()
    assert main(["reconstruct", str(path), "-o", str(path)]) == 2
    assert path.read_bytes() == before
    assert "expected another file than the inputs" in capsys.readouterr().err
    mask = tmp_path / "mask.npy"
    np.save(mask, np.ones((240, 320), dtype=bool))
    before = mask.read_bytes()
    assert main(["reconstruct", str(path), "-o", str(mask), "--mask", *[str(mask)] * 7]) == 2
    assert mask.read_bytes() == before
    assert "expected another file than the inputs" in capsys.readouterr().err


def test_negative_lengths_are_values(tmp_path, capsys):
    path = tmp_path / "scene.npz"
    strand.synthetic.scene("arc", seed=0).save(path)
    model = str(tmp_path / "model.json")
    assert main(["reconstruct", str(path), "-o", model, "--radius", "-4mm"]) == 2
    assert "radius" in capsys.readouterr().err
    bounds = ["-300mm", "-0.3", "2.5mm", "300mm", "0.3", "20mm"]
    assert main(["reconstruct", str(path), "-o", model, "--bounds", *bounds]) == 0


def test_branches_are_printed_with_nodes_and_wires(tmp_path, capsys):
    made = strand.synthetic.harness("tree", seed=5, views=1)
    made.save(tmp_path / "harness.npz")
    wire = min(made.radii) / min(count for count in made.wires if count) ** 0.5
    words = ["reconstruct", str(tmp_path / "harness.npz"), "--branches", "--wire", f"{wire * 1e3}mm"]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert sorted(map(int, re.findall(r"(\d+) wires?", out))) == sorted(made.wires)
    assert main([*words[:2], "--wire", "1mm"]) == 2
    assert "wire: expected None without branches=True" in capsys.readouterr().err
