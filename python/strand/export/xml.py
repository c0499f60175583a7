"""Files of elements with attributes, as MJCF and URDF are."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike


def document(root: ElementTree.Element) -> bytes:
    """Return an indented file."""
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode").encode() + b"\n"


def numbers(values: ArrayLike) -> str:
    """Return numbers with blanks between them, to 12 digits."""
    return " ".join(f"{value:.12g}" for value in np.ravel(values).tolist())
