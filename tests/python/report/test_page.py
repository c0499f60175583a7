"""Tests of the HTML page: its content, and that a browser draws it without a network."""

from __future__ import annotations

import base64
import dataclasses
import io
import json
import re
import sys
import time

import numpy as np
import plotly.graph_objects as go
import pytest
from PIL import Image

import strand
from shared.browser import start_chromium
from shared.ropes import draw_circle, make_zigzags
from strand.figures import write_report, write_track_report
from strand.report import drawn_chains, page, space_figure
from strand.ropes.crossings import NOT_LISTED
from strand.ropes.doubt import Doubt, Join, ModelWarning
from strand.ropes.summary import format_confidence

LIMIT = 5_000_000  # bytes
ATTACK = "<script>alert('a')</script><img src=x onerror=alert(1)>&amp;\"'"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with start_chromium(tmp_path_factory.mktemp("chromium")) as opened:
        yield opened


@pytest.fixture(scope="module")
def report(paper, paper_model, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    given = {"radius": "4.20 mm", "scene": ATTACK}
    write_report(paper_model, paper.views, path, title=f"paper {ATTACK}", given=given, truth=paper.truth)
    return path


def read_figure(path):
    text = path.read_text("utf-8")
    return json.loads(re.search(r'<script type="application/json" id="figure">(.*?)</script>', text).group(1))


def unpack(entry):
    values = np.frombuffer(base64.b64decode(entry["bdata"]), dtype=entry["dtype"])
    return values.reshape([int(n) for n in entry["shape"].split(",")]) if "shape" in entry else values


def count_coloured(png, box):
    """Return the number of coloured pixels in a part of a picture."""
    left, top, right, bottom = (int(x) for x in box)
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)[top:bottom, left:right]
    return int((np.ptp(pixels, axis=2) > 60).sum())


def wait_for_change(browser, before=None):
    """Return a picture as soon as the browser shows something new."""
    end = time.monotonic() + 30
    while (picture := browser.screenshot()) == before:
        assert time.monotonic() < end, "nothing changed"
        time.sleep(0.2)
    return picture


def press(browser, label):
    return browser.value(
        "[...document.querySelectorAll('.updatemenu-button')].find(b => b.textContent === "
        f"{json.dumps(label)}).dispatchEvent(new MouseEvent('click'))"
    )


def test_a_browser_draws_the_page_without_requests(browser, report):
    browser.events.clear()
    browser.open(report)
    box = browser.value(
        "(() => {const b = document.querySelector('#space canvas').getBoundingClientRect();"
        "return [b.left, b.top, b.right, b.bottom]})()"
    )
    before = browser.screenshot()
    assert count_coloured(before, box) > 1000
    images = "[...document.querySelectorAll('.views svg image')].map(i => i.getBoundingClientRect().width)"
    assert min(browser.value(images)) > 100

    # the buttons
    about = "document.getElementById('space')"
    shown = f"{about}.data.filter(t => t.legendgroup === 'cameras').map(t => t.visible)"
    title = f"{about}.layout.coloraxis.colorbar.title.text"
    assert browser.value(shown) == ["legendonly", "legendonly"]
    assert browser.value(title) == "arc length / mm"
    press(browser, "ropes and cameras")
    press(browser, "standard deviation")
    press(browser, "no points")
    wait_for_change(browser, before)
    assert browser.value(shown) == [True, True]
    assert browser.value(title) == "standard deviation / mm"
    assert browser.value(f"{about}.data.slice(0, 7).map(t => t.visible)") == ["legendonly"] * 7

    # the only resources are pictures inside the page
    asked = [url for url in browser.asked_for() if not url.startswith(("data:image/jpeg", "blob:"))]
    assert asked == [report.as_uri()]
    assert browser.said() == []


def test_the_page_has_no_links_and_no_foreign_code(report):
    text = report.read_text("utf-8")
    assert ATTACK not in text
    assert "<script>alert" not in text
    assert "onerror=alert(1)>" not in text
    outside = re.sub(r'<script type="application/octet-stream" id="plotly">.*?</script>', "", text)
    assert re.findall(r"https?://[^\"' <]+", outside) == []
    assert re.findall(r"<(?:link|iframe|object|embed|base)\b", outside) == []
    assert "default-src 'none'" in text


def test_texts_of_a_model_are_escaped(browser, paper, paper_model, tmp_path):
    doubts = (Doubt("join", 0.3, ATTACK, "</script><b>" + ATTACK, paper_model.chains[0].points[9]),)
    warnings = (ModelWarning("branch", ATTACK),)
    model = dataclasses.replace(paper_model, doubts=doubts, warnings=warnings, stages={})
    write_report(model, paper.views, tmp_path / "a.html")
    browser.events.clear()
    browser.open(tmp_path / "a.html")
    assert browser.said() == []
    assert browser.value("document.querySelectorAll('script').length") == 4  # three of the page, and plotly
    assert browser.value("document.querySelectorAll('img').length") == 0
    assert ATTACK in browser.value("document.body.innerText")
    (doubt,) = [trace for trace in read_figure(tmp_path / "a.html")["data"] if trace["name"] == "doubt"]
    assert "<script" not in doubt["text"][0]


def test_chains_points_doubts_and_cameras_are_in_place(paper_model, report):
    figure = read_figure(report)
    traces = {trace["name"]: trace for trace in figure["data"]}
    (chain,) = paper_model.chains
    drawn = next(t for t in figure["data"] if "customdata" in t)
    x = unpack(drawn["x"])
    assert len(x) == len(chain.points) + 1
    seen = np.isfinite(x[:-1])
    assert seen.sum() > 0.9 * len(chain.points)
    np.testing.assert_allclose(x[:-1][seen], 1e3 * chain.points[seen, 0], rtol=1e-5, atol=1e-3)
    about = unpack(drawn["customdata"])[:-1]
    np.testing.assert_allclose(about[:, 1], 1e3 * chain.arc_length, rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(about[:, 2], 1e3 * drawn_chains.compute_deviations(chain), rtol=1e-5)
    assert f"chain 0: {chain.length * 1e3:.0f} mm" in traces
    clouds = paper_model.stages["registered"]
    for i, cloud in enumerate(clouds):
        assert len(unpack(traces[f"view {i}: {len(cloud):,} points"]["y"])) == len(cloud)
    with_place = [d for d in paper_model.doubts if d.place is not None]
    assert len(traces.get("doubts: " + str(len(with_place)), {"text": []})["text"]) == len(with_place)
    assert len(unpack(traces["ends: 2"]["z"])) == 2
    assert len(unpack(traces["cameras"]["x"])) == 7 * (6 + 4 * 3)
    (x, y, z) = (unpack(traces["next view"][axis])[0] for axis in "xyz")
    np.testing.assert_allclose([x, y, z], 1e3 * paper_model.next_view()[0].position, rtol=1e-5)
    assert figure["layout"]["scene"]["aspectmode"] == "manual"


def test_plotly_knows_every_property(report):
    figure = read_figure(report)
    assert len(go.Figure(figure).data) == len(figure["data"])


def test_tables_match_the_model(paper, paper_model, report):
    text = report.read_text("utf-8")
    (chain,) = paper_model.chains
    assert f"<td>{chain.length * 1e3:.1f}</td>" in text
    assert f"1 chain ({chain.length * 1e3:.0f} mm)" in text
    assert "whole" not in re.sub(r"<script.*", "", text, flags=re.DOTALL)
    assert f"with probability {format_confidence(paper_model.confidence)}" in text
    for name in paper_model.timings:
        assert f"<td>{name}</td>" in text
    for doubt in paper_model.doubts:
        assert doubt.reason in text
    assert text.count("<td>depth image, 320 x 240</td>") == len(paper.views)
    assert "<td>4.20 mm</td>" in text
    amounts = [float(x) for x in re.findall(r"<td>doubt</td><td>[^<]*</td><td>([\d.]+)</td>", text)]
    assert amounts == sorted(amounts, reverse=True)


def make_large():
    """Return a model and views with more of everything than a page shows."""
    rng = np.random.default_rng(0)
    count, side = 20, 500
    intrinsics = np.array([[400.0, 0, side / 2], [0, 400.0, side / 2], [0, 0, 1]])
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, 0, 3] = np.linspace(-0.1, 0.1, count)
    depth = rng.uniform(0.1, 5.0, (side, side))
    views = [strand.View.from_depth(depth, intrinsics, pose) for pose in poses]
    steps = np.cumsum(rng.normal(scale=2e-3, size=(220, 300, 3)), axis=1) * [1, 1, 0.2] + [0, 0, 0.5]
    covariance = np.tile(np.eye(3) * 1e-6, (300, 1, 1))
    seen = rng.integers(0, 2, 300)
    chains = tuple(strand.Chain(line, 1e-5, False, None, covariance, seen, seen) for line in steps)
    doubts = tuple(Doubt("join", 1.0, "w" * 3000, "<" * 3000, line[0]) for line in steps) * 5
    warnings = tuple(ModelWarning("branch", "&" * 10_000) for _ in range(2000))
    joins = tuple(Join(line[1], (0,), 1.0) for line in steps) * 5
    return strand.Model(chains, poses, {}, warnings, doubts=doubts, joins=joins), views


def test_the_page_is_small_for_any_model(tmp_path):
    model, views = make_large()
    write_report(model, views, tmp_path / "a.html", title="t" * 10_000)
    assert (tmp_path / "a.html").stat().st_size < LIMIT
    figure = read_figure(tmp_path / "a.html")
    points = sum(len(unpack(t["x"])) for t in figure["data"] if t["name"].startswith("view"))
    assert 0.2 * space_figure.MAX_POINTS < points <= space_figure.MAX_POINTS
    assert "16 of 20 views are shown. The 50 longest of 220 chains are drawn." in (
        tmp_path / "a.html"
    ).read_text("utf-8")


@pytest.fixture(scope="module")
def table():
    """A rope on a table that one camera sees, which is turned about its axis."""
    made = strand.synthetic.cluttered_scene(4)
    turned = np.array([[0.0, -1.0, 0, 0], [1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]])
    views = [strand.View.from_depth(made.depth[0], made.intrinsics, turned, depth_scale=made.depth_scale)]
    return strand.reconstruct(views), views


def test_points_are_dense_near_ropes_and_the_view_is_the_cameras(table, tmp_path):
    model, views = table
    write_report(model, views, tmp_path / "a.html")
    figure = read_figure(tmp_path / "a.html")
    (cloud,) = (trace for trace in figure["data"] if trace["name"].startswith("view 0"))
    points = 1e-3 * np.column_stack([unpack(cloud[axis]) for axis in "xyz"])
    reach = 3.0 * model.chains[0].radius
    everywhere = (model.nearest(views[0].points).distance < reach).mean()
    near = (model.nearest(points).distance < reach).mean()
    assert everywhere < 0.05
    assert near > 0.5
    camera = figure["layout"]["scene"]["camera"]
    up, eye, center = (np.array([camera[key][axis] for axis in "xyz"]) for key in ("up", "eye", "center"))
    np.testing.assert_allclose(up, -views[0].pose[:3, 1])
    towards = views[0].viewpoint - model.chains[0].points.mean(axis=0)
    np.testing.assert_allclose(
        (eye - center) / np.linalg.norm(eye - center), towards / np.linalg.norm(towards)
    )


def test_crossings_doubts_and_unseen_nodes_have_symbols_of_their_own(table, tmp_path):
    model, views = table
    write_report(model, views, tmp_path / "a.html")
    traces = read_figure(tmp_path / "a.html")["data"]
    symbols = [trace["marker"]["symbol"] for trace in traces if "symbol" in trace.get("marker", {})]
    assert len(symbols) == len(set(symbols)) + symbols.count("diamond") - ("diamond" in symbols)
    names = [trace["name"] for trace in traces]
    # crossings are drawn over doubts
    assert names.index("doubts: 3") < names.index("crossings: 3")
    svg = re.search(r"<svg.*?</svg>", (tmp_path / "a.html").read_text("utf-8"), re.DOTALL).group(0)
    assert svg.count('class="crossing"') == 3
    colours = re.findall(r'class="(?:seen|hidden|bridged)"[^>]* stroke="([^"]+)"', svg)
    assert len(set(colours)) > 12


def test_names_and_buttons_leave_the_view_free_on_a_narrow_page(browser, table, tmp_path):
    model, views = table
    write_report(model, views, tmp_path / "a.html")
    browser.open(tmp_path / "a.html", width=420)
    (top, bottom), (legend, _), (_, buttons) = browser.value(
        "['canvas', '.legend', '.updatemenu-container'].map(name => {"
        "const b = document.querySelector('#space ' + name).getBoundingClientRect();"
        "return [b.top, b.bottom]})"
    )
    assert legend >= bottom - 1
    assert buttons <= top + 1


@pytest.mark.parametrize("page", ["report", "tracks"])
@pytest.mark.parametrize("width", [420, 1400])
def test_the_first_view_shows_whole_ropes(browser, table, tmp_path, page, width):
    if page == "report":
        model, views = table
        write_report(model, views, tmp_path / "a.html")
        nodes = np.vstack([chain.points for chain in model.chains])
    else:
        frames = strand.synthetic.sequence("loop", seed=1, frames=3)
        tracker = strand.Tracker(radius=frames.radius, ropes=1)
        tracks = [tracker.update([frame.view()], frame.time) for frame in frames]
        write_track_report(tracks, tmp_path / "a.html")
        nodes = np.vstack([track.ropes[0].points for track in tracks])
    browser.open(tmp_path / "a.html", width=width)
    camera, ranges, (high, wide) = browser.value(
        "(() => { const s = document.getElementById('space').layout.scene;"
        "const b = document.querySelector('#space canvas').getBoundingClientRect();"
        "return [s.camera, [s.xaxis.range, s.yaxis.range, s.zaxis.range], [b.height, b.width]] })()"
    )
    up, eye, center = (np.array([camera[key][axis] for axis in "xyz"]) for key in ("up", "eye", "center"))
    low, top = np.array(ranges).T
    # plotly's units: the longest axis, from the middle of the box
    placed = (1e3 * nodes - (low + top) / 2) / (top - low).max() - eye
    ahead = (center - eye) / np.linalg.norm(center - eye)
    right = np.cross(ahead, up) / np.linalg.norm(np.cross(ahead, up))
    field = np.tan(np.radians(22.5)) * placed @ ahead
    assert np.abs(placed @ right / field).max() < 0.97 * wide / high
    assert np.abs(placed @ np.cross(right, ahead) / field).max() < 1.0


def test_the_page_says_that_crossings_are_too_many_to_list(tmp_path):
    write_report(make_zigzags(200), [strand.View(np.array([[0.0, 0.0, 1.0]]))], tmp_path / "a.html")
    assert NOT_LISTED in (tmp_path / "a.html").read_text("utf-8")


@pytest.mark.parametrize("chains", [(), (draw_circle(0.05, 40, True),), (draw_circle(0.05, 40, False),) * 3])
def test_views_of_points_and_odd_models(browser, tmp_path, chains):
    rng = np.random.default_rng(0)
    cloud = rng.normal(scale=0.05, size=(500, 3)) * [1, 1, 0.1]
    views = [
        strand.View.from_world(cloud, [0.0, 0.0, 0.5]),
        strand.View(np.empty((0, 3))),
        strand.View.from_depth(np.zeros((4, 6)), np.diag([5.0, 5.0, 1.0])),
    ]
    model = strand.Model(chains, np.array([view.pose for view in views]))
    write_report(model, views, tmp_path / "a.html")
    text = (tmp_path / "a.html").read_text("utf-8")
    assert f"{len(chains)} {'chain' if len(chains) == 1 else 'chains'}" in text
    assert "view 0, drawn from its points" in text
    if not chains:
        browser.events.clear()
        browser.open(tmp_path / "a.html")
        assert browser.said() == []


def test_scenes_far_from_the_origin_keep_their_shape(tmp_path):
    far = np.array([4000.0, -7000.0, 100.0])
    chain = strand.Chain(draw_circle(0.05, 40, False).points + far, 0.004)
    views = [strand.View.from_world(chain.points, far + np.array([0.0, 0.0, 0.5]))]
    model = strand.Model((chain,), views[0].pose[None])
    write_report(model, views, tmp_path / "a.html")
    figure = read_figure(tmp_path / "a.html")
    drawn = next(t for t in figure["data"] if "customdata" in t)
    np.testing.assert_allclose(unpack(drawn["x"])[:-1], 1e3 * (chain.points[:, 0] - 4000.0), atol=1e-3)
    assert figure["layout"]["scene"]["xaxis"]["title"]["text"] == "(x − 4000 m) / mm"


def test_wrong_arguments_are_named(paper, paper_model, tmp_path):
    with pytest.raises(ValueError, match="views: expected the 7 views of the model, got 6"):
        write_report(paper_model, paper.views[:6], tmp_path / "a.html")
    with pytest.raises(TypeError, match="views"):
        write_report(paper_model, [1], tmp_path / "a.html")
    with pytest.raises(ValueError, match=r"truth\[0\]"):
        write_report(paper_model, paper.views, tmp_path / "a.html", truth=[np.zeros((3, 2))])
    with pytest.raises(FileNotFoundError):
        write_report(paper_model, paper.views, tmp_path / "no" / "a.html")
    assert list(tmp_path.iterdir()) == []


def test_names_the_missing_package(paper, paper_model, tmp_path, monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "plotly"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "plotly", None)
    with pytest.raises(ImportError, match=r'plotly is needed here: pip install "[\w.-]+\[report\]"'):
        write_report(paper_model, paper.views, tmp_path / "a.html")
    assert list(tmp_path.iterdir()) == []


def test_an_existing_page_stays_if_anything_fails(paper, paper_model, tmp_path, monkeypatch):
    (tmp_path / "a.html").write_text("mine")
    monkeypatch.setattr(page, "_tabulate_stages", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_report(paper_model, paper.views, tmp_path / "a.html")
    assert (tmp_path / "a.html").read_text() == "mine"
