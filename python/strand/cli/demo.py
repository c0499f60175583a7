"""`strand demo`: a simulated rope by both methods."""

from __future__ import annotations

import argparse
from pathlib import Path

import strand
from strand.cli import values
from strand.cli.answers import warn
from strand.cli.outputs import require_folder
from strand.cli.progress import progress
from strand.report import figures, tables

HINT = "a simulated rope by both methods, compared with the truth"
DESCRIPTION = """\
Simulate the published experiment (one string, seven views), reconstruct it by
the default and by the published method, and compare both with the truth."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's words."""
    command.add_argument(
        "--out",
        type=values.path,
        default=Path("strand-demo"),
        metavar="DIR",
        help="where model.json and the figures go (default: %(default)s)",
    )
    command.add_argument(
        "--seed", type=int, default=0, help="seed of the simulated noise (default: %(default)s)"
    )


def run(options: argparse.Namespace) -> None:
    """Simulate the published experiment, reconstruct it by both methods, and compare them with the truth."""
    require_folder(options.out)
    with progress("simulate"):
        made = strand.synthetic.scene("paper", seed=options.seed)
    methods = {
        "default": (strand.Config(), options.out),
        "published": (strand.Config.published(), options.out / "published"),
    }
    written = []
    for name, (settings, folder) in methods.items():
        with progress() as show:
            model = strand.reconstruct(
                made.views,
                radius=made.radius,
                bounds=made.bounds,
                ropes=1,
                config=settings,
                keep_stages=True,
                progress=show,
            )
        warn(model)
        print(f"The {name} method", end="\n\n")
        print(tables.describe_stages(made.views, model), end="\n\n")
        print(tables.describe_counts(model), end="\n\n")
        print(tables.describe_accuracy(model, made.truth), end="\n\n")
        folder.mkdir(parents=True, exist_ok=True)
        model.save(folder / "model.json")
        with progress("figures"):
            drawn = figures.write_figures(model, folder, made.truth)
        written += [folder / "model.json", *drawn]
    for path in written:
        print(path)
