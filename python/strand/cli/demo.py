"""`strand demo`: a simulated rope, reconstructed with both methods."""

from __future__ import annotations

import argparse
from pathlib import Path

import strand
from strand.cli import values
from strand.cli.model_output import print_remarks
from strand.cli.outputs import require_folder
from strand.cli.progress import show_progress
from strand.report import figures, tables

HINT = "reconstruct a simulated rope with both methods"
DESCRIPTION = """\
Simulate the published experiment (one string, seven views), reconstruct it
with the default and the published method, and compare both with the truth."""


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


def run(options: argparse.Namespace) -> None:
    """Simulate the published experiment, reconstruct it with both methods, and compare with the truth."""
    require_folder(options.out)
    with show_progress("simulate"):
        scene = strand.synthetic.scene("paper", seed=options.seed)
    methods = {
        "default": (strand.Config(), options.out),
        "published": (strand.Config.published(), options.out / "published"),
    }
    written = []
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
        folder.mkdir(parents=True, exist_ok=True)
        model.save(folder / "model.json")
        with show_progress("figures"):
            drawn = figures.write_figures(model, folder, scene.truth)
        written += [folder / "model.json", *drawn]
    for path in written:
        print(path)
