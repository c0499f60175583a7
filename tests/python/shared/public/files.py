"""Calls of readers, recordings, batches, pictures and messages."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock, patch

import numpy as np
from PIL import Image

import strand
from lib.bag_files import Messages, record_film, write_bag
from lib.lerobot_files import make_ramp, write_data_set
from shared.public.scenes import (
    CHAIN,
    CLOUD,
    CUBE,
    LINE,
    MODEL,
    SHADES,
    K,
    R,
    make_cloud_message,
    make_model,
    make_published_model,
    make_scene,
    make_track,
    save_scene,
)
from shared.public.surface import Call
from strand import batch, figures, msgs
from strand.io.models import load_frames


def list_calls(folder: Path) -> dict[str, Call]:
    """Return the calls by their names."""
    return _list_readers(folder) | _list_batch(folder) | _list_pictures(folder) | _list_messages()


def _list_readers(folder: Path) -> dict[str, Call]:
    bag, model = write_bag(folder / "film", "mcap", record_film(make_scene(), 3)), folder / "model.json"
    make_model().save(model)
    frames = folder / "frames.jsonl"
    content = {"frame": 0, "stamp": 7, "model": json.loads(model.read_text(encoding="utf-8"))}
    frames.write_text(json.dumps(content), encoding="utf-8")
    known = {"intrinsics": K, "depth_scale": 0.001}
    cloud = folder / "cloud.npy"
    np.save(cloud, CLOUD)
    depth = folder / "depth.npy"
    np.save(depth, np.full((48, 64), 500, np.uint16))
    mask, color = folder / "mask.npy", folder / "color.png"
    np.save(mask, np.ones((48, 64), np.uint8))
    Image.fromarray(np.ones((48, 64, 3), np.uint8)).save(color)
    size = {"max_bytes": 10**8}

    def count(**given: Any) -> int:
        with strand.Recording(**given) as recording:
            return len(recording)

    def read(**given: Any) -> list[Any]:
        with strand.Recording(bag) as recording:
            return list(recording.read(**given))

    def read_undecoded(**given: Any) -> list[int]:
        with strand.Recording(bag) as recording:
            return [frame.number for frame in recording.read_undecoded(**given)]

    opened = strand.Recording(bag)
    undecoded = next(opened.read_undecoded())
    return {
        "load_scene": Call(
            strand.load_scene,
            {"path": cloud, "viewpoint": np.zeros(3), "outside": False, **size},
            {"path": cloud, "camera_frame": True},
            {"path": depth, "masks": [mask], "colors": [color], "occluders": [mask], **known},
        ),
        "load_model": Call(strand.load_model, {"path": model, **size}),
        "load_frames": Call(load_frames, {"path": frames}),
        "Recording": Call(
            count,
            {
                "path": bag,
                "topics": ["/depth"],
                "poses": [np.eye(4)],
                "tolerance": 0.02,
                "intrinsics": make_scene().intrinsics,
                "depth_scale": 0.001,
                "color_topics": None,
                "ignore_distortion": False,
                **size,
            },
            {"path": bag, "topics": ["/depth"], "world": "world"},
        ),
        "Recording.read": Call(read, {"start": 0, "stop": 2, "step": 1}),
        "Recording.read_undecoded": Call(read_undecoded, {"start": 0, "stop": 2, "step": 1}),
        "Recording.decode": Call(opened.decode, {"frame": undecoded}),
        "Recording.close": Call(strand.Recording(bag).close, {}),
    }


def _list_batch(folder: Path) -> dict[str, Call]:
    scene, out = save_scene(folder), folder / "out"
    settings, size = batch.Settings(ropes=1), {"max_bytes": 10**8}
    batch.run(scene, out, settings, root=folder, workers=1)
    units = list(batch.find_units([scene], settings, folder))
    values = {one.name: getattr(settings, one.name) for one in dataclasses.fields(settings)}
    values |= {"radius": R, "bounds": tuple(np.array(side) for side in CUBE), "length": 0.4, "intrinsics": K}
    values |= {
        "depth_scale": 1e-3,
        "stretch": 5,
        "topics": ["/depth"],
        "color_topics": ["/color"],
        "world": "world",
    }
    views = {"viewpoint": np.zeros(3), "radius": np.array([R]), "length": np.array([0.4])}

    def read(path: Any) -> bytes:
        return Path(path).read_bytes()

    def write_summary(**given: Any) -> bytes:
        batch.write_summary(**given)
        return read(given["page"])

    def write_tracks(**given: Any) -> bytes:
        batch.write_tracks(**given)
        return read(given["path"])

    data_set, numbers = write_data_set(folder / "set", make_ramp(3), (3,), "png"), iter(range(10**6))

    def write_lerobot(**given: Any) -> bytes:
        if isinstance(given.get("out"), Path):  # a new folder each time
            given["out"] = given["out"].with_name(f"new{next(numbers)}")
        batch.write_lerobot(**given)
        return read(given["out"] / "data/chunk-000/file-000.parquet")

    return {
        "batch.write_lerobot": Call(
            write_lerobot,
            {
                "models": [(0, make_model())],
                "data_set": data_set,
                "out": folder / "new",
                "points": 8,
                "ropes": 1,
                "feature": "observation.rope",
                **size,
            },
        ),
        "batch.Settings": Call(
            batch.Settings,
            {name: value for name, value in values.items() if name not in ("rate", "viewpoint", "deadline")},
            views | {"deadline": 5.0},
            {"track": True, "rate": 30.0},
        ),
        "batch.Settings.to_json": Call(batch.Settings(**views).to_json, {}),
        "batch.find_units": Call(
            batch.find_units, {"recordings": [scene], "settings": settings, "root": folder, "excluded": out}
        ),
        "batch.make_rows": Call(batch.make_rows, {"unit": units[0], "settings": settings}),
        "batch.make_schema": Call(batch.make_schema, {}),
        "batch.run": Call(
            batch.run,
            {
                "recordings": [scene],
                "out": out,
                "settings": settings,
                "engine": "local",
                "workers": 1,
                "threads": 1,
                "address": None,
                "root": folder,
                "retry_errors": False,
                "progress": print,
            },
        ),
        "batch.load_table": Call(batch.load_table, {"out": out, "columns": ["recording"], **size}),
        "batch.load_models": Call(batch.load_models, {"out": out, **size}),
        "batch.write_summary": Call(write_summary, {"out": out, "page": folder / "summary.html", **size}),
        "batch.write_tracks": Call(
            write_tracks, {"tracks": [make_track()], "path": folder / "tracks.parquet", "recording": "one"}
        ),
    }


def imitate_rerun() -> Any:
    """Let a stand-in take the place of Rerun's large package."""
    rerun = MagicMock()
    rerun.RecordingStream().memory_recording().drain_as_bytes.return_value = b"RRF"
    return patch.dict(sys.modules, {"rerun": rerun})


def _list_pictures(folder: Path) -> dict[str, Call]:
    scene, model, tracks = make_scene(), make_model(), [make_track()]
    published = ("axis_points", "chains", "normals", "segments", "separation")
    draw = [name for name in figures.__all__ if name.startswith("draw_")]
    truth = {"truth": [LINE]}
    shown = {"model": model, "views": scene.views, **truth}

    def drawn(name: str) -> Call:
        own = make_published_model() if name.removeprefix("draw_") in published else model
        return Call(getattr(figures, name), {"model": own} | (truth if name == "draw_ropes" else {}))

    def written(name: str, path: str, options: dict[str, Any]) -> Call:
        def write(**given: Any) -> bytes:
            with imitate_rerun():
                getattr(figures, name)(**given)
            return Path(given["path"]).read_bytes()

        return Call(write, {"path": folder / path, **options})

    def show(**given: Any) -> None:
        with imitate_rerun():
            figures.show(**given)

    return {
        **{f"figures.{name}": drawn(name) for name in draw},
        "figures.plot_over_points": written(
            "plot_over_points", "over.png", {"model": model, "points": CLOUD}
        ),
        "figures.write_figures": Call(figures.write_figures, {"model": model, "directory": folder, **truth}),
        "figures.write_report": written(
            "write_report", "page.html", shown | {"title": "Ropes", "given": {"radius": "4 mm"}}
        ),
        "figures.write_mcap": written(
            "write_mcap",
            "ropes.mcap",
            {"models": [model], "frame_id": "table", "topic": "/rope", "lifetime": 1.0}
            | {"pulls": True, "gripper": strand.Gripper(0.05, 0.01, 0.01, 0.04)},
        ),
        "figures.write_recording": written("write_recording", "model.rrd", shown),
        "figures.show": Call(show, shown),
        "figures.write_track_report": written(
            "write_track_report", "tracks.html", {"tracks": tracks, "title": "Ropes", "numbers": [3]}
        ),
        "figures.write_track_recording": written(
            "write_track_recording", "tracks.rrd", {"tracks": tracks, "numbers": [3], "clouds": [CLOUD]}
        ),
    }


def _list_messages() -> dict[str, Call]:
    head = {"frame_id": "world", "stamp": 7}
    made, depth = Messages(), np.full((48, 64), 500, np.uint16)
    return {
        "msgs.make_path": Call(msgs.make_path, {"chain": CHAIN, **head}),
        "msgs.make_marker_array": Call(
            msgs.make_marker_array, {"model": MODEL, **head, "namespace": "ropes"}
        ),
        "msgs.make_planning_scene": Call(msgs.make_planning_scene, {"model": MODEL, "error": 1e-3, **head}),
        "msgs.make_point_cloud2": Call(msgs.make_point_cloud2, {"points": CLOUD, **head, "colors": SHADES}),
        "msgs.read_pose": Call(
            msgs.read_pose, {"message": made.tf([("world", "camera", np.eye(4))], 7).transforms[0]}
        ),
        "msgs.read_view": Call(
            msgs.read_view,
            {"message": make_cloud_message(), "pose": np.eye(4)},
            {
                "message": made.image(depth, 7, encoding="mono16"),
                "camera_info": made.info(K, depth.shape, 7),
                "depth_scale": 1e-3,
                "rectified": False,
                "ignore_distortion": False,
                "color": made.color(np.zeros((*depth.shape, 3), np.uint8), 7),
                "mask": made.image(depth, 7, encoding="16UC1"),
                "occluders": made.image(depth, 7, encoding="16UC1"),
            },
        ),
    }
