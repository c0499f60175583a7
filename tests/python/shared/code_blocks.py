"""The code blocks of the documentation, and the data and files that they need."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import re
import shlex
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import strand
from lib.bag_files import START, Messages, convert_to_millimeters, record_cameras, record_film, write_bag
from lib.lerobot_files import write_data_set
from shared.scene_files import make_ply
from strand.cli import main
from strand.synthetic import SyntheticScene

ROOT = Path(__file__).resolve().parents[3]
PAGES = [
    path.relative_to(ROOT).as_posix()
    for path in (
        *sorted(ROOT.glob("*.md")),
        *sorted((ROOT / "docs").rglob("*.md")),
        ROOT / "examples" / "README.md",
        ROOT / "packaging" / "README.md",
    )
]


@dataclass(frozen=True)
class Block:
    """A fenced block: its place and its text."""

    page: str
    heading: str
    language: str
    text: str


def find_blocks(page: str) -> list[Block]:
    """Return the blocks of a page in order."""
    found, heading = [], ""
    text = (ROOT / page).read_text(encoding="utf-8")
    for title, language, content in re.findall(r"^(?:#+ (.+)|```(\w*)\n((?s:.*?))```)$", text, re.MULTILINE):
        heading = title or heading
        if not title:
            found.append(Block(page, heading, language, content))
    return found


# Data that blocks need.


@cache
def make_arc() -> SyntheticScene:
    """Return a scene of one rope from three sides."""
    return strand.synthetic.scene("arc", seed=0, views=3)


@cache
def make_two_ropes() -> SyntheticScene:
    return strand.synthetic.scene(chains=strand.synthetic.random_ropes(1, 2, seed=0), views=3)


@cache
def solve_arc() -> strand.Model:
    return strand.reconstruct(make_arc().views, radius=0.0042, bounds=make_arc().bounds)


def give_views() -> dict[str, Any]:
    """Return views of a rope, and their model."""
    model = solve_arc()
    return {"views": make_arc().views, "bounds": make_arc().bounds, "model": model, "chain": model.chains[0]}


def give_clouds() -> dict[str, Any]:
    """Return two clouds of a rope, for kernels."""
    source, target = (view.crop(make_arc().bounds).world_points for view in make_arc().views[:2])
    return {
        "points": target,
        "camera_center": make_arc().views[1].viewpoint,
        "source": source,
        "target": target,
    }


def give_image() -> dict[str, Any]:
    """Return a depth image with all its companions, and views of two ropes alone."""
    scene = make_two_ropes()
    depth = scene.depth[0] * scene.depth_scale
    return {
        "depth": depth,
        "K": scene.intrinsics,
        "pose": scene.poses[0],
        "mask": depth > 0,
        "image": np.zeros((*depth.shape, 3), dtype=np.uint8),
        "views": [view.crop(scene.bounds) for view in scene.views],
    }


def give_messages() -> dict[str, Any]:
    """Return messages of a camera."""
    made, depth = Messages(), convert_to_millimeters(make_arc())[1]
    return {
        "stamp": START,
        "image": made.image(depth, START),
        "camera_info": made.info(make_arc().intrinsics, depth.shape, START),
        "pose": make_arc().poses[1],
    }


# by page: names for its n-th block of Python, from 0 on; later blocks keep them
GIVEN: dict[str, dict[int, Callable[[], dict[str, Any]]]] = {
    "README.md": {1: give_image, 2: give_clouds},
    "docs/configuration.md": {0: give_views},
    "docs/export.md": {0: give_views},
    "docs/method.md": {0: give_views, 1: give_image},
    "docs/mistakes.md": {0: give_views, 1: give_image},
    "docs/pictures.md": {0: give_views},
    "docs/recordings.md": {0: lambda: {"BOUNDS": make_arc().bounds}, 1: give_messages},
    "docs/sensors.md": {0: give_views},
}


def make_scene_folder(folder: Path) -> None:
    """Make SCENE, a folder with a scene.toml and depth images."""
    (folder / "SCENE").mkdir()
    scene = make_arc()
    (fx, _, cx), (_, fy, cy), _ = scene.intrinsics.tolist()
    text = [f"[camera]\nfx = {fx}\nfy = {fy}\ncx = {cx}\ncy = {cy}\ndepth_scale = {scene.depth_scale}\n"]
    low, high = (corner.tolist() for corner in scene.bounds)
    text.append(f"[extract]\nlow = {low}\nhigh = {high}\n")
    for k, (depth, pose) in enumerate(zip(scene.depth, scene.poses, strict=True)):
        Image.fromarray(depth).save(folder / "SCENE" / f"{k}.png")
        text.append(f'[[view]]\nfile = "{k}.png"\npose = {pose.tolist()}\n')
    (folder / "SCENE" / "scene.toml").write_text("\n".join(text))


def make_single_files(folder: Path) -> None:
    """Make point clouds and depth images of one view each, and a camera's matrix."""
    view = make_arc().views[1].crop(make_arc().bounds)
    # where the camera is said to be on the command line
    points = view.world_points - view.viewpoint + (0.0, 0.0, 0.5)
    head = f"FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {len(points)}\nHEIGHT 1\n"
    rows = "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())
    (folder / "cloud.pcd").write_text(f"VERSION .7\n{head}POINTS {len(points)}\nDATA ascii\n{rows}")
    (folder / "cloud.ply").write_bytes(make_ply("ascii", points=view.points))
    matrix = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])
    camera = {"width": 640, "height": 480, "intrinsic_matrix": matrix.T.ravel().tolist()}
    (folder / "camera.json").write_text(json.dumps(camera))
    pose = strand.synthetic.camera_pose(0.0, 0.5)
    ropes = [strand.synthetic.shape("arc")]
    depth = strand.synthetic.render_depth(ropes, 0.0042, matrix, pose, size=(640, 480))
    alone = strand.synthetic.render_depth(ropes, 0.0042, matrix, pose, size=(640, 480), table=False)
    sensed = depth + np.random.default_rng(0).normal(scale=4e-4, size=depth.shape)
    Image.fromarray(np.round(sensed * 1e3).astype(np.uint16)).save(folder / "depth.png")
    Image.fromarray(sensed.astype(np.float32)).save(folder / "depth.tiff")
    Image.fromarray((255 * (alone > 0)).astype(np.uint8)).save(folder / "mask.png")
    shades = np.where((alone > 0)[..., None], (200, 40, 40), (120, 120, 120)).astype(np.uint8)
    Image.fromarray(shades).save(folder / "color.jpg")
    Image.fromarray(np.zeros(alone.shape, dtype=np.uint8)).save(folder / "robot.png")


def make_bags(folder: Path) -> None:
    """Make recordings: rope.mcap of one camera, rope.bag of three, and the folder rope of 41 frames."""
    table = [("table", "world", np.eye(4))]
    film_placed = [("/tf_static", START, Messages().tf(table, START)), *record_film(make_arc(), 2)]
    shades = np.full((*make_arc().depth.shape[1:], 3), 120, dtype=np.uint8)
    film_placed.append(("/camera/color/image_raw", START, Messages().color(shades, START)))
    write_bag(folder / "made", "mcap", film_placed).rename(folder / "rope.mcap")
    placed = [("/tf_static", START, Messages(True).tf(table, START)), *record_cameras(make_arc(), True)]
    write_bag(folder / "rope", "ros1", placed)
    write_bag(folder / "rope", "sqlite3", record_film(make_arc(), 41))
    depth = np.repeat(convert_to_millimeters(make_arc())[:1], 6, axis=0)
    write_data_set(folder / "cable", depth, (2, 4))


def make_recordings(folder: Path) -> None:
    """Make recordings: the first without a rope, a broken one, and two of a rope."""
    (folder / "recordings" / "monday").mkdir(parents=True)
    for name in ("arc", "loop"):
        made = strand.synthetic.scene(name, views=2, camera=strand.synthetic.Camera(size=(160, 120)), seed=1)
        made.save(folder / "recordings" / "monday" / f"{name}.npz")
    # a table and nothing else
    table = np.random.default_rng(0).normal(6000.0, 3.0, (1, 120, 160)).astype(np.uint16)
    one = strand.synthetic.scene("arc", views=1, camera=strand.synthetic.Camera(size=(160, 120)))
    known = {"K": one.intrinsics, "poses": one.poses, "depth_scale": one.depth_scale}
    np.savez(folder / "recordings" / "bare.npz", depth=table, **known)
    (folder / "recordings" / "broken.npz").write_bytes(b"nonsense")


# by page: the files in the folder in which its blocks run
FILES: dict[str, tuple[Callable[[Path], None], ...]] = {
    "README.md": (make_scene_folder, make_single_files),
    "docs/batch.md": (make_recordings,),
    "docs/command-line.md": (make_scene_folder, make_single_files),
    "docs/files.md": (make_single_files,),
    "docs/pictures.md": (make_scene_folder,),
    "docs/recordings.md": (make_bags,),
    "docs/tracking.md": (make_bags,),
}


@contextlib.contextmanager
def change_folder(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def run_python(page: str, folder: Path, skipped: frozenset[str] = frozenset()) -> dict[str, Any]:
    """Run a page's blocks of Python in order, but those under some headings; return all names."""
    for make in FILES.get(page, ()):
        make(folder)
    names: dict[str, Any] = {"strand": strand}
    with change_folder(folder):
        for number, block in enumerate(b for b in find_blocks(page) if b.language == "python"):
            names |= GIVEN.get(page, {}).get(number, dict)()
            if block.heading not in skipped:
                exec(compile(block.text, f"{page}, {block.heading}", "exec"), names)
    return names


def find_commands(page: str) -> list[tuple[str, ...]]:
    """Return the words of a page's shell commands, without comments and redirections."""
    lines = [
        line for block in find_blocks(page) if block.language == "sh" for line in block.text.splitlines()
    ]
    found = []
    for line in lines:
        lexer = shlex.shlex(re.sub(r"\d?> ?\S+", "", line), posix=True, punctuation_chars="|&")
        lexer.whitespace_split = True
        parts = itertools.groupby(lexer, key=lambda word: word in ("|", "&&"))
        found += [tuple(words) for between, words in parts if not between]
    return found


def run_strand(page: str, folder: Path) -> list[tuple[tuple[str, ...], int]]:
    """Run a page's commands of strand, and return each with its exit code."""
    for make in FILES.get(page, ()):
        make(folder)
    with change_folder(folder):
        return [(words, main(words[1:])) for words in find_commands(page) if words[0] == "strand"]
