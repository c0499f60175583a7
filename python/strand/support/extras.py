"""Import optional packages, and say which extra of strand installs a missing one."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

_EXTRAS = {  # the extra of strand that installs each package; others come with "cli"
    "lz4": "recordings",
    "backports": "recordings",
    "mujoco": "simulate",
    "plotly": "report",
    "av": "lerobot",
    "pyarrow": "batch",
    "ray": "ray",
    "rerun": "rerun",
}


def import_extra(module: str) -> Any:
    """Import an optional module, such as "PIL.Image"; an ImportError says how to install it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        name = module.split(".")[0]
        package = {"PIL": "pillow", "rerun": "rerun-sdk", "backports": "backports.zstd"}.get(name, name)
        wanted = f"{_find_distribution()}[{_EXTRAS.get(name, 'cli')}]"
        raise ImportError(f'{package} is needed here: pip install "{wanted}" installs it') from error


def _find_distribution() -> str:
    """Return the name of the distribution that strand was installed from; "." in a checkout."""
    from importlib import metadata  # takes longer to import than all checks of arguments

    here = Path(__file__)
    for name in metadata.packages_distributions().get("strand", ()):
        if Path(str(metadata.distribution(name).locate_file(f"strand/support/{here.name}"))) == here:
            return name
    return "."
