"""`strand demo`: a simulated rope, reconstructed with both methods."""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np

import strand
from strand.cli import values
from strand.cli.model_output import print_remarks
from strand.cli.outputs import require_folder
from strand.cli.progress import show_progress
from strand.cli.terminal import print_message
from strand.report import figures, tables
from strand.support.extras import import_extra
from strand.support.files import check_suffix, require_writable, write_bytes

DESCRIPTION = """\
Simulate the published experiment (one string, seven views), reconstruct it
with the default and the published method, and compare both with the truth.
With --simulate, also lay the rope on a table in MuJoCo and open its viewer.
With --recording, only write a recording to try the other commands with."""

_TABLE = b"""<mujoco>
  <include file="rope.xml"/>
  <worldbody>
    <light pos="0 0 1"/>
    <geom type="plane" size="0.5 0.5 0.1"/>
  </worldbody>
</mujoco>
"""
_MOTION = "carry"  # kind of the sequence that is recorded
_FRAMES = 30  # of the recording: 46 MB
_SECONDS = 1.0  # of simulation before the viewer opens


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument(
        "--out",
        type=values.parse_path,
        default=Path("strand-demo"),
        metavar="DIR",
        help="the folder for model.json and the figures (default: %(default)s)",
    )
    command.add_argument(
        "--seed", type=int, default=0, help="seed of the simulated noise (default: %(default)s)"
    )
    command.add_argument(
        "--simulate",
        action="store_true",
        help='show the rope in MuJoCo, which the extra "simulate" installs',
    )
    command.add_argument(
        "--recording",
        type=values.parse_path,
        metavar="FILE",
        help="only write this .mcap file of ROS 2: one second of a gripper that carries a rope, with depth, "
        "colours, CameraInfo and TF",
    )


def run(options: argparse.Namespace) -> None:
    """Simulate the published experiment, reconstruct it with both methods, and compare with the truth."""
    if options.recording is not None:
        _write_recording(options.recording, options.seed)
        return
    require_folder(options.out)
    if options.simulate:
        import_extra("mujoco")  # report a missing package before the work
    draws = _can_draw()
    with show_progress("simulate"):
        scene = strand.synthetic.scene("paper", seed=options.seed)
    methods = {
        "default": (strand.Config(), options.out),
        "published": (strand.Config.published(), options.out / "published"),
    }
    written, found = [], []
    for name, (settings, folder) in methods.items():
        with show_progress() as show:
            model = strand.reconstruct(
                scene.views,
                radius=scene.radius,
                bounds=scene.bounds,
                ropes=1,
                config=settings,
                keep_stages=True,
                progress=show,
            )
        print_remarks(model)
        print(f"The {name} method", end="\n\n")
        print(tables.describe_stages(scene.views, model), end="\n\n")
        print(tables.describe_counts(model), end="\n\n")
        print(tables.describe_accuracy(model, scene.truth), end="\n\n")
        found.append(model)
        folder.mkdir(parents=True, exist_ok=True)
        model.save(folder / "model.json")
        written.append(folder / "model.json")
        if draws:
            with show_progress("figures"):
                written += figures.write_figures(model, folder, scene.truth)
    if options.simulate:
        written += _write_simulation(found[0], options.out)
    for path in written:
        print(path)
    if options.simulate:
        _simulate(written[-1])


def _can_draw() -> bool:
    """Tell whether figures can be drawn, and say how if they cannot."""
    try:
        import_extra("matplotlib")
    except ImportError as error:
        print_message(f"strand: warning: no figures: {error}")
        return False
    return True


def _write_recording(path: Path, seed: int) -> None:
    """Write a recording, and print commands that read it."""
    check_suffix(path, ("mcap",))
    require_writable(path)
    with show_progress("simulate"):
        made = strand.synthetic.sequence(_MOTION, seed, frames=_FRAMES, color=True)
        made.save(path)
    known = f"{path} --world table --radius {1e3 * made.radius:.2f}mm"
    print(f"{path}\n\nstrand info {path}\nstrand reconstruct {known}")
    print(f"strand track {known} --ropes 1 -o tracks.parquet --report tracks.html")


def _write_simulation(model: strand.Model, folder: Path) -> list[Path]:
    """Write the ropes, and a scene of them on a table, for the installed MuJoCo."""
    rope, scene = folder / "rope.xml", folder / "simulation.xml"
    version = int(import_extra("mujoco").__version__.split(".")[0])
    model.save_mjcf(rope, version)
    write_bytes(scene, _TABLE)
    return [rope, scene]


def _simulate(path: Path) -> None:
    """Say in a line how the ropes move in MuJoCo, then show them in its viewer."""
    mujoco = import_extra("mujoco")
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    start = data.xpos.copy()
    with show_progress("simulate in MuJoCo"):
        while data.time < _SECONDS:
            mujoco.mj_step(model, data)
    moved = np.linalg.norm(data.xpos - start, axis=1).max()
    print(f"MuJoCo {mujoco.__version__}: in {_SECONDS:g} s on a table the rope moves by {moved * 1e3:.1f} mm")
    # a process of its own, as MuJoCo ends the process that it finds no screen in
    command = [sys.executable, "-m", "mujoco.viewer", f"--mjcf={path}"]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        print("strand: the viewer did not open, which needs a screen; " + " ".join(command), file=sys.stderr)
