"""The collection: simulated scenes with names and known truth, for benches and tests.

- `paper_mid`, `overhand_mid`, `figure8_low`, `loop_mid`, `heap06`, `hard00`, `two_ropes`: stored in
  tests/data/scenes, rendered by another ray caster than strand's.
- `straight_0.3mm` to `paper_1.5mm`: each shape of `SHAPES` at three levels of depth noise. The seed is the
  shape's index. `paper_fine` has four times the pixels.
- `heap00` to `hard06`: settled ropes of tests/data/settled_ropes.npz. The seed is their number.
- `random_1` to `random_6`: one to three random ropes with 1 to 6 crossings. The seed is the number of
  crossings.

All else is the default of `strand.synthetic.scene`.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from strand import synthetic
from strand.synthetic import SyntheticScene

DATA = Path(__file__).resolve().parents[2] / "tests" / "data"
# shapes of the tables in benches/results
SHAPES = ("straight", "arc", "s", "coil", "loop", "figure8", "overhand", "paper")
NOISES = (0.3e-3, 0.7e-3, 1.5e-3)  # metres
FINE = (640, 480)  # pixels of `paper_fine`
RANDOM = {1: 1, 2: 1, 3: 2, 4: 2, 6: 3}  # ropes by crossings

_ARRAYS = ("depth", "depth_scale", "K", "poses", "poses_true", "box", "radius", "noise")


def load_stored(path: Path) -> SyntheticScene:
    """Read a file of `SyntheticScene.save`. The scene has the file's name.

    Raises
    ------
    ValueError
        If the file lacks an array.
    """
    with np.load(path) as arrays:
        missing = [key for key in _ARRAYS if key not in arrays]
        if missing:
            raise ValueError(f"{path}: missing {', '.join(missing)}")
        ropes = sum(key.startswith("truth_") for key in arrays)
        low, high = arrays["box"]
        return SyntheticScene(
            name=path.stem,
            depth=arrays["depth"],
            depth_scale=float(arrays["depth_scale"]),
            intrinsics=arrays["K"].astype(np.float64),
            poses=arrays["poses"].astype(np.float64),
            poses_true=arrays["poses_true"].astype(np.float64),
            bounds=(low, high),
            radius=float(arrays["radius"]),
            truth=tuple(arrays[f"truth_{i}"].astype(np.float64) for i in range(ropes)),
            noise=round(float(arrays["noise"]), 9),  # some files have it in single precision
            mask=arrays.get("mask"),
        )


def _make_settled(name: str) -> SyntheticScene:
    with np.load(DATA / "settled_ropes.npz") as ropes:
        nodes = ropes[name].astype(np.float64)
    return synthetic.scene(name, chains=[nodes], seed=int(name[-2:]))


def _make_random(crossings: int) -> SyntheticScene:
    chains = synthetic.random_ropes(crossings, RANDOM[crossings], seed=crossings)
    return synthetic.scene(f"random_{crossings}", chains=chains, seed=crossings)


def _list_makers() -> dict[str, Callable[[], SyntheticScene]]:
    makers: dict[str, Callable[[], SyntheticScene]] = {
        path.stem: partial(load_stored, path) for path in sorted((DATA / "scenes").glob("*.npz"))
    }
    for seed, shape in enumerate(SHAPES):
        for noise in NOISES:
            name = f"{shape}_{noise * 1e3:.1f}mm"
            makers[name] = partial(synthetic.scene, shape, seed=seed, noise=synthetic.Noise(depth=noise))
    makers["paper_fine"] = partial(
        synthetic.scene, "paper", seed=SHAPES.index("paper"), camera=synthetic.Camera(size=FINE)
    )
    with np.load(DATA / "settled_ropes.npz") as ropes:
        makers |= {name: partial(_make_settled, name) for name in ropes}
    return makers | {f"random_{count}": partial(_make_random, count) for count in RANDOM}


_MAKERS = _list_makers()


def list_names() -> list[str]:
    """Return the names of all scenes."""
    return list(_MAKERS)


def make_scene(name: str) -> SyntheticScene:
    """Make or read one scene, with the same bits each time.

    Parameters
    ----------
    name : str
        A scene's name, or the path of an `.npz` file.
    """
    if name.endswith(".npz"):
        return load_stored(Path(name))
    return dataclasses.replace(_MAKERS[name](), name=name)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Let the command line choose scenes."""
    parser.add_argument(
        "folder",
        metavar="DIR",
        type=Path,
        nargs="?",
        help="a folder of .npz scenes as tests/data/README.md describes them (default: the collection)",
    )
    parser.add_argument("--only", metavar="TEXT", default="", help="scenes whose name holds this text")


def choose_scenes(arguments: argparse.Namespace) -> Iterator[SyntheticScene]:
    """Yield the scenes that the command line chose. End the program if there are none."""
    folder: Path | None = arguments.folder
    paths = list_names() if folder is None else [str(path) for path in sorted(folder.glob("*.npz"))]
    kept = [path for path in paths if arguments.only in Path(path).name.removesuffix(".npz")]
    if not kept:
        sys.exit(f"{folder or 'collection'}: no scene whose name holds {arguments.only!r}")
    yield from map(make_scene, kept)
