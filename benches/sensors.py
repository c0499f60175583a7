"""Reconstruct scenes of imitated depth cameras and print tables by camera and by number of views.

python benches/sensors.py [DIR] [--only TEXT] [--estimate-radius] [--free-ropes] [--pictures DIR]

Without DIR the scenes are shapes and random ropes through each of `strand.synthetic.CAMERAS`, in one view and
in three. With DIR they are the `.npz` files there, as `SyntheticScene.save` writes them; a camera is what the
array `sensor` says or else the last but one part of the name, as in `loop_zed_1v`. The radius and the number
of ropes are told. A picture is drawn of each scene that is not right.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from lib import collection
from lib.collection import SHAPES
from lib.judging import format_summary, judge_scenes
from lib.results import make_parser, run_bench
from strand.synthetic import CAMERAS, Camera, Layout, Noise, Segmentation, SyntheticScene, random_ropes, scene
from strand.synthetic.camera import FOCAL_LENGTH

SIZE = (640, 480)
PIXELS = {"d435": 4.1, "d405": 6.3, "zed": 3.3, "sgbm": 3.3, "tof": 4.3}  # of the ropes' radius
RANDOM = 3  # scenes of random ropes for each camera
THREE = 3  # every so many scenes have three views


def draw_scenes(only: str) -> Iterator[tuple[str, SyntheticScene]]:
    """Yield camera and scene of the seeded set."""
    number = 0
    for camera in CAMERAS:
        for name in (*SHAPES, *(f"random{i}" for i in range(RANDOM))):
            number += 1
            views = 3 if number % THREE == 0 else 1
            called = f"{name}_{camera}_{views}v"
            if only in called:
                yield camera, draw_scene(called, name, camera, views, number)


def draw_scene(called: str, name: str, camera: str, views: int, seed: int) -> SyntheticScene:
    """A shape or random ropes as a camera would see them, its masks up to a pixel too wide or too narrow."""
    rng = np.random.default_rng(seed)
    radius = float(rng.uniform(3.4e-3, 6e-3))
    common: dict[str, Any] = {
        "radius": radius,
        "seed": seed,
        "views": views,
        "camera": Camera(camera, size=SIZE),
        "noise": Noise(turn=math.radians(0.4)),
        "mask": Segmentation(grow=int(rng.integers(-1, 2))),
        "layout": Layout(
            distance=FOCAL_LENGTH * SIZE[0] * radius / PIXELS[camera],
            elevation=math.radians(rng.uniform(50.0, 87.0)),
        ),
    }
    if name not in SHAPES:
        common["chains"] = random_ropes(int(rng.integers(1, 6)), 1, radius, seed)
    made = scene(name, **common)
    return dataclasses.replace(made, name=called)


def read_scenes(folder: Path, only: str) -> Iterator[tuple[str, SyntheticScene]]:
    """Yield camera and scene of the files of a folder."""
    for path in sorted(folder.glob("*.npz")):
        if only in path.stem:
            with np.load(path) as arrays:
                parts = path.stem.split("_")
                told = (
                    str(arrays["sensor"])
                    if "sensor" in arrays
                    else parts[-2]
                    if len(parts) > 2
                    else "unknown"
                )
            yield told, collection.load_stored(path)


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("folder", metavar="DIR", type=Path, nargs="?", help="a folder of .npz scenes")
    parser.add_argument("--only", metavar="TEXT", default="", help="scenes whose name holds this text")
    parser.add_argument("--estimate-radius", action="store_true", help="do not tell the radius")
    parser.add_argument("--free-ropes", action="store_true", help="do not tell the number of ropes")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="draw the scenes that are not right")
    arguments = parser.parse_args()
    cameras: dict[str, str] = {}

    def shown() -> Iterator[SyntheticScene]:
        chosen = (
            draw_scenes(arguments.only)
            if arguments.folder is None
            else read_scenes(arguments.folder, arguments.only)
        )
        for camera, synthetic in chosen:
            cameras[synthetic.name] = camera
            yield synthetic

    results = judge_scenes(
        shown(),
        arguments.pictures,
        tell_radius=not arguments.estimate_radius,
        tell_ropes=not arguments.free_ropes,
    )
    if not results:
        sys.exit(f"{arguments.folder or 'imitated scenes'}: no scene whose name holds {arguments.only!r}")
    by_camera = [
        (name, lambda found, name=name: cameras[found.scene] == name)
        for name in dict.fromkeys(cameras.values())
    ]
    counts = sorted({found.views for found in results})
    by_views = [(f"{count} of a scene", lambda found, count=count: found.views == count) for count in counts]
    print(f"\n{format_summary(results, 'camera', by_camera)}\n\n{format_summary(results, 'views', by_views)}")
    return 0


if __name__ == "__main__":
    run_bench(main)
