"""Damaged files of every kind that strand reads, made at random from whole files, and what comes of them."""

from __future__ import annotations

import os
import random
import struct
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import strand
from lib.mutations import (
    GENERAL,
    change_body,
    change_chunks,
    change_header,
    change_members,
    change_tags,
    change_values,
    nested,
    reencoded,
    reworded,
    rewritten,
)
from lib.whole_files import (
    CAMERA,
    COLOURS,
    DEPTH,
    DESCRIPTION,
    LABELS,
    POINTS,
    POSE,
    SETTINGS,
    make_archive,
    make_deflated_tiff,
    make_image,
    make_model,
    make_npy,
    make_pcd,
    make_ply,
)
from strand import config
from strand.support.files import FileFormatError

ALLOWED = ("answer", "FileFormatError", "OSError")  # outcomes that are no findings
MAX_BYTES = 1 << 23  # of a scene: the files are small


@dataclass(frozen=True)
class Kind:
    """A kind of file that strand reads.

    Attributes
    ----------
    name : str
        The file's name.
    whole : tuple of bytes
        Whole files of this kind.
    reader : str
        "scene", "model" or "config".
    view : str
        The lines of a `scene.toml` about a view that holds the file; empty if the file stands alone.
    mutations : tuple of functions
        Those that know the format.
    """

    name: str
    whole: tuple[bytes, ...]
    reader: str
    view: str
    mutations: tuple[Callable[[random.Random, bytes], bytes], ...]


def list_kinds() -> tuple[Kind, ...]:
    """Return every kind of file that strand reads."""
    extras = {
        "box": np.array([[-1.0, -2, -3], [1, 2, 3]]),
        "radius": np.float64(0.004),
        "name": np.array("knot"),
        "truth_0": POINTS.astype(np.float32),
        "mask": np.stack([LABELS, LABELS]),
        "color": np.stack([COLOURS, COLOURS]),
    }
    faces = "property uchar red\nelement face 1\nproperty list uchar int vertex_indices\n"
    colourful = b"".join(row.tobytes() + b"\7" for row in POINTS.astype("<f8"))
    whole_ply = make_ply("binary_little_endian", "double", faces)
    with_faces = (
        whole_ply[: whole_ply.index(b"end_header\n") + 11] + colourful + b"\3" + struct.pack("<3i", 0, 1, 2)
    )
    plys = (
        make_ply("ascii", "float"),
        make_ply("binary_little_endian", "float"),
        make_ply("binary_big_endian", "double"),
        with_faces,
    )
    shades = np.arange(POINTS.size, dtype=np.uint8).reshape(POINTS.shape)
    pcds = (
        make_pcd("ascii", POINTS, shades, "F"),
        make_pcd("binary", POINTS.astype(np.float32), shades, padded=True),
        make_pcd("binary_compressed", np.repeat(POINTS, 3, axis=0), np.repeat(shades, 3, axis=0)),
    )
    texts = tuple(
        head + b"\n".join(separator.join(str(x).encode() for x in row) for row in rows)
        for head, separator, rows in (
            (b"", b" ", POINTS.tolist()),
            (b"x,y,z,r,g,b\n", b",", np.hstack([POINTS, shades]).tolist()),
            (b"# made\n", b";", np.hstack([POINTS, shades / 255]).tolist()),
        )
    )
    tiffs = (
        make_image(DEPTH, "TIFF"),
        make_image((DEPTH * 0.001).astype(np.float32), "TIFF"),
        make_deflated_tiff(DEPTH),
    )
    depth = f'file = "depth.png"\n{POSE}'
    text = (nested, reencoded)
    masks = (make_image(LABELS), make_image(LABELS.astype(np.uint16)), make_image(LABELS > 0))
    return (
        Kind(
            "scene.npz",
            (make_archive(np.savez), make_archive(np.savez_compressed, **extras)),
            "scene",
            "",
            (change_members,) * 5,
        ),
        Kind("scene.toml", (DESCRIPTION.encode(),), "scene", "", text),
        Kind("config.toml", (SETTINGS.encode(), b'sensor = "d435"\n'), "config", "", text),
        Kind("model.json", (make_model(),), "model", "", (*text, *(change_values,) * 6)),
        Kind("a.png", (make_image(DEPTH),), "scene", f'file = "a.png"\n{POSE}', (change_chunks,) * 4),
        Kind("m.png", masks, "scene", f'{depth}mask = "m.png"\n', (change_chunks,) * 4),
        Kind(
            "m.npy",
            (make_npy(LABELS), make_npy(LABELS > 0)),
            "scene",
            f'{depth}mask = "m.npy"\n',
            (change_header,) * 4,
        ),
        Kind("c.png", (make_image(COLOURS),), "scene", f'{depth}color = "c.png"\n', (change_chunks,) * 4),
        Kind(
            "c.jpg",
            (make_image(COLOURS, "JPEG"), make_image(COLOURS, "BMP"), make_image(COLOURS, "PPM")),
            "scene",
            f'{depth}color = "c.jpg"\n',
            (),
        ),
        Kind(
            "a.npy",
            (make_npy(DEPTH), make_npy(DEPTH * 0.001), make_npy(POINTS)),
            "scene",
            f'file = "a.npy"\n{POSE}',
            (change_header,) * 4,
        ),
        Kind("a.ply", plys, "scene", f'file = "a.ply"\n{POSE}', (rewritten, reworded, reencoded)),
        Kind(
            "a.pcd", pcds, "scene", f'file = "a.pcd"\n{POSE}', (rewritten, reworded, reencoded, change_body)
        ),
        Kind("a.xyz", texts, "scene", f'file = "a.xyz"\n{POSE}', (rewritten, reworded, reencoded)),
        Kind("a.tiff", tiffs, "scene", f'file = "a.tiff"\n{POSE}', (change_tags,) * 4),
    )


def damage_file(
    seed: int, number: int, chosen: tuple[Kind, ...], others: tuple[Kind, ...]
) -> tuple[Kind, bytes]:
    """Return the kind and the content of the damaged file with a seed and a number."""
    draw = random.Random(f"{seed} {number}")
    kind = draw.choice(chosen)
    return kind, mutate(draw, kind, others)


def mutate(draw: random.Random, kind: Kind, others: tuple[Kind, ...]) -> bytes:
    """Damage a file by one to three mutations, or join the start of one file and the end of another."""
    data = draw.choice(kind.whole)
    if draw.random() < 0.03:
        other = draw.choice(draw.choice((kind, *others)).whole)
        return data[: draw.randrange(len(data) + 1)] + other[draw.randrange(len(other) + 1) :]
    first, *rest = draw.choices((*GENERAL, *kind.mutations), k=draw.choice((1, 1, 1, 2, 3)))
    data = first(draw, data)
    for again in rest:  # mutations that know a format need whole files
        data = (again if again in (*GENERAL, nested, reencoded) else draw.choice(GENERAL))(draw, data)
    return data


class TooLong(BaseException):
    """Reading a file took too long."""


def make_folder(parent: Path, kind: Kind) -> Path:
    """Make a folder with all files that a kind's files need beside them."""
    folder = parent / kind.name.replace(".", "_")
    folder.mkdir()
    if kind.view:
        (folder / "scene.toml").write_text(f"{CAMERA}[[view]]\n{kind.view}")
    if kind.name == "scene.toml" or kind.view:
        for name, data in {
            "depth.png": make_image(DEPTH),
            "mask.png": make_image(LABELS),
            "color.png": make_image(COLOURS),
            "depth.npy": make_npy(DEPTH * 0.001),
            "points.ply": make_ply("ascii", "double"),
        }.items():
            (folder / name).write_bytes(data)
        os.mkfifo(folder / "fifo.npy")
        (folder / "loop.npy").symlink_to("loop.npy")
        (folder / "endless.npy").symlink_to("/dev/zero")
        (folder / "folder.npy").mkdir()
    return folder


def read_file(kind: Kind, folder: Path) -> object:
    """Read the file of a kind in its folder, and look at its values as a user would."""
    path = folder / kind.name
    if kind.reader == "config":
        return repr(config.load(path))
    if kind.reader == "model":
        made = strand.load_model(path)
        repr(made), [str(one) for one in (*made.warnings, *made.doubts)], [one.length for one in made.chains]
        made.save(folder / "again.json")
        again = strand.load_model(folder / "again.json")
        np.testing.assert_array_equal(again.poses, made.poses)
        return again
    scene = strand.load_scene(folder if kind.view else path, max_bytes=MAX_BYTES)
    assert scene.views, "a scene without views"
    scene.name.encode()
    for view in scene.views:
        assert np.isfinite(view.points).all(), "points that are not finite"
        assert view.colors is None or len(view.colors) == len(view.points), "colours of other points"
    return scene


def try_file(kind: Kind, folder: Path) -> str:
    """Return "answer", "FileFormatError" or "OSError" for a file, or why it is a finding."""
    try:
        read_file(kind, folder)
    except FileFormatError as error:
        if not error.file.startswith(str(folder)) or len(error.reason) > 1000:
            return f"message: {str(error)[:100]}"
        return "FileFormatError"
    except OSError as error:
        return locate_error(error) if kind.name != "scene.toml" or error.filename is None else "OSError"
    except (KeyboardInterrupt, TooLong):
        raise
    except BaseException as error:
        return locate_error(error)
    return "answer"


def locate_error(error: BaseException) -> str:
    """Return the type of an error, and the last function of strand in its traceback."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "/strand/" in frame.filename]
    place = f"{Path(frames[-1].filename).name}:{frames[-1].name}" if frames else "?"
    return f"{type(error).__name__} in {place}"
