"""Packages that only some uses need, asked for by the name under which strand was installed."""

from __future__ import annotations

import importlib
from importlib import metadata
from pathlib import Path
from typing import Any

_EXTRAS = {
    "rosbags": "recordings",
    "lz4": "recordings",
    "apsw": "recordings",
    "plotly": "report",
    "pyarrow": "batch",
    "ray": "ray",
    "rerun": "rerun",
}


def import_extra(module: str) -> Any:
    """Import a package that only some uses need.

    Parameters
    ----------
    module : str
        Its import name, such as "PIL.Image".

    Raises
    ------
    ImportError
        If it is not installed; the message says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        name = module.split(".")[0]
        package = {"PIL": "pillow", "rerun": "rerun-sdk"}.get(name, name)
        wanted = f"{_distribution()}[{_EXTRAS.get(name, 'cli')}]"
        raise ImportError(f'{package} is needed here: pip install "{wanted}" installs it') from error


def _distribution() -> str:
    """Return what strand is called where it was installed; "." if it runs as a checkout."""
    here = Path(__file__)
    for name in metadata.packages_distributions().get("strand", ()):
        if Path(str(metadata.distribution(name).locate_file(f"strand/support/{here.name}"))) == here:
            return name
    return "."
