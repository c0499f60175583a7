"""The recipes for live cameras run with stand-ins of the cameras' libraries."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

import strand
from lib.bag_files import convert_to_millimeters

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "recordings.md").read_text(encoding="utf-8")
SCENE = strand.synthetic.scene("arc", seed=0, views=3)
DEPTH = convert_to_millimeters(SCENE)[1]
K = SCENE.intrinsics
POSE = SCENE.poses[1]
BOUNDS = ([-0.5, -0.5, 0.05], [0.5, 0.5, 2.0])


def crop_depth():
    """Return the depth image, millimetres, without the table: no box in the camera's frame excludes it."""
    points = SCENE.views[1].world_points
    depth = DEPTH.copy()
    depth[depth > 0] *= ((points > SCENE.bounds[0]) & (points < SCENE.bounds[1])).all(axis=1)
    return depth


SEEN = crop_depth()


def find_recipe(title):
    return re.search(rf"^### {title}\n\n```python\n(.*?)```", PAGE, re.MULTILINE | re.DOTALL).group(1)


def make_lens(**names):
    return SimpleNamespace(fx=K[0, 0], fy=K[1, 1], **names)


def make_stream(*results):
    """Return a call that gives some results in turn, and then is interrupted."""
    return MagicMock(side_effect=[*results, KeyboardInterrupt])


def run_recipe(monkeypatch, title, **modules):
    for name, content in modules.items():
        module = ModuleType(name.replace("__", "."))
        module.__dict__.update(content)
        monkeypatch.setitem(sys.modules, module.__name__, module)
    names = {"BOUNDS": BOUNDS}
    code = find_recipe(title)
    assert len(code.strip().splitlines()) <= 23
    with pytest.raises(KeyboardInterrupt):
        exec(code, names)
    return names


def check_model(model):
    want = strand.View.from_depth(SEEN, K, depth_scale=0.001)
    (chain,) = strand.reconstruct([want], radius=0.004, bounds=BOUNDS).chains
    np.testing.assert_allclose(model.chains[0].points, chain.points, rtol=0, atol=1e-6)
    assert chain.length == pytest.approx(0.4, rel=0.05)


def test_realsense(monkeypatch, capsys):
    frame = MagicMock()
    frame.get_depth_frame().get_data.side_effect = [SEEN, np.zeros_like(SEEN)]
    pipeline = MagicMock()
    pipeline.wait_for_frames = make_stream(frame, frame)
    profile = pipeline.start()
    profile.get_device().first_depth_sensor().get_depth_scale.return_value = 0.001
    video = profile.get_stream().as_video_stream_profile()
    video.get_intrinsics.return_value = make_lens(ppx=K[0, 2], ppy=K[1, 2])
    check_model(
        run_recipe(
            monkeypatch,
            "RealSense",
            pyrealsense2={"pipeline": lambda: pipeline, "stream": SimpleNamespace(depth=1)},
        )["model"]
    )
    assert capsys.readouterr().out.splitlines()[-1].startswith("views: ")


def test_orbbec(monkeypatch):
    frame = MagicMock()
    frame.get_data.return_value = SEEN.tobytes()
    frame.get_height.return_value, frame.get_width.return_value = SEEN.shape
    frame.get_depth_scale.return_value = 1.0
    pipeline = MagicMock()
    pipeline.wait_for_frames = make_stream(None, MagicMock(get_depth_frame=lambda: frame))
    pipeline.get_camera_param().depth_intrinsic = make_lens(cx=K[0, 2], cy=K[1, 2])
    content = {
        "Pipeline": lambda: pipeline,
        "Config": MagicMock,
        "OBSensorType": SimpleNamespace(DEPTH_SENSOR=1),
    }
    check_model(run_recipe(monkeypatch, "Orbbec", pyorbbecsdk=content)["model"])


def test_zed(monkeypatch):
    depth = (SEEN * 0.001).astype(np.float32)
    depth[SEEN == 0] = np.resize([np.nan, np.inf, -np.inf], np.count_nonzero(SEEN == 0))
    camera = MagicMock()
    camera.open.return_value = 0
    camera.grab = make_stream(1, 0)
    camera.get_camera_information().camera_configuration.calibration_parameters.left_cam = make_lens(
        cx=K[0, 2], cy=K[1, 2]
    )
    sl = {
        "Camera": lambda: camera,
        "Mat": lambda: MagicMock(get_data=lambda: depth),
        "InitParameters": lambda coordinate_units: coordinate_units,
        "UNIT": SimpleNamespace(METER=1),
        "MEASURE": SimpleNamespace(DEPTH=1),
        "ERROR_CODE": SimpleNamespace(SUCCESS=0),
    }
    check_model(run_recipe(monkeypatch, "ZED", pyzed={}, pyzed__sl=sl)["model"])
