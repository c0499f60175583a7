"""Reconstruct scenes of imitated depth cameras, and print tables by camera and by number of views.

python benches/sensors.py [DIR] [--only TEXT] [--estimate-radius] [--free-ropes] [--pictures DIR]

Without DIR the scenes are shapes and random ropes through each of `strand.synthetic.CAMERAS`, in one view or
in three. With DIR they are the `.npz` files there, as `SyntheticScene.save` writes them. The array `sensor`
names a file's camera, or else the last but one part of the file's name, as in `loop_zed_1v`. The radius and
the number of ropes are given. `--pictures` draws the scenes that are not right.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from lib import collection
from lib.collection import SHAPES
from lib.imitated_scenes import make_imitated
from lib.judging import format_summary, judge_scenes
from lib.results import make_parser, run_bench
from strand.synthetic import CAMERAS, SyntheticScene

RANDOM = 3  # scenes of random ropes for each camera
THREE = 3  # each third scene has three views


def draw_scenes(only: str) -> Iterator[tuple[str, SyntheticScene]]:
    """Yield the cameras and scenes of the seeded set."""
    number = 0
    for camera in CAMERAS:
        for name in (*SHAPES, *(f"random{i}" for i in range(RANDOM))):
            number += 1
            views = 3 if number % THREE == 0 else 1
            called = f"{name}_{camera}_{views}v"
            if only in called:
                yield camera, make_imitated(called, name, camera, views, number)


def read_scenes(folder: Path, only: str) -> Iterator[tuple[str, SyntheticScene]]:
    """Yield the cameras and scenes of the files of a folder."""
    for path in sorted(folder.glob("*.npz")):
        if only in path.stem:
            with np.load(path) as arrays:
                parts = path.stem.split("_")
                named = parts[-2] if len(parts) > 2 else "unknown"
                camera = str(arrays["sensor"]) if "sensor" in arrays else named
            yield camera, collection.load_stored(path)


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("folder", metavar="DIR", type=Path, nargs="?", help="a folder of .npz scenes")
    parser.add_argument("--only", metavar="TEXT", default="", help="scenes whose name holds this text")
    parser.add_argument("--estimate-radius", action="store_true", help="do not give the radius")
    parser.add_argument("--free-ropes", action="store_true", help="do not give the number of ropes")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="draw the scenes that are not right")
    arguments = parser.parse_args()
    cameras: dict[str, str] = {}

    def yield_scenes() -> Iterator[SyntheticScene]:
        chosen = (
            draw_scenes(arguments.only)
            if arguments.folder is None
            else read_scenes(arguments.folder, arguments.only)
        )
        for camera, synthetic in chosen:
            cameras[synthetic.name] = camera
            yield synthetic

    results = judge_scenes(
        yield_scenes(),
        arguments.pictures,
        give_radius=not arguments.estimate_radius,
        give_ropes=not arguments.free_ropes,
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
