"""Spheres as plain data for cuRobo."""

from __future__ import annotations

from typing import Any

from strand.export.spheres import Spheres


def curobo(spheres: Spheres) -> dict[str, dict[str, Any]]:
    """Return a world of cuRobo made of spheres, for `WorldConfig.from_dict`.

    Parameters
    ----------
    spheres : Spheres
        From `Model.spheres`.

    Returns
    -------
    dict
        `{"sphere": {"rope_0_0": {"pose": [x, y, z, 1, 0, 0, 0], "radius": r}, ...}}`, world frame, metres;
        quaternions start with w. Names hold the numbers of the rope and of the sphere.

    Raises
    ------
    TypeError
        If `spheres` is of another type.
    """
    if not isinstance(spheres, Spheres):
        raise TypeError(f"spheres: expected Spheres, got {type(spheres).__name__}")
    rows = zip(spheres.chain.tolist(), spheres.center.tolist(), spheres.radius.tolist(), strict=True)
    return {
        "sphere": {
            f"rope_{chain}_{i}": {"pose": [*center, 1.0, 0.0, 0.0, 0.0], "radius": radius}
            for i, (chain, center, radius) in enumerate(rows)
        }
    }
