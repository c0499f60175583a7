"""XML text, for MJCF and URDF."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike


def format_document(root: ElementTree.Element) -> bytes:
    """Return an element as an indented file."""
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode").encode() + b"\n"


def format_numbers(values: ArrayLike) -> str:
    """Return numbers to 12 digits, separated by spaces."""
    return " ".join(f"{value:.12g}" for value in np.ravel(values).tolist())
