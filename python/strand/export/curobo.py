"""Spheres as plain data for cuRobo."""

from __future__ import annotations

from typing import Any

from strand.export.spheres import Spheres


def curobo(spheres: Spheres) -> dict[str, dict[str, Any]]:
    """World of cuRobo out of spheres: what `WorldConfig.from_dict` takes.

    Parameters
    ----------
    spheres : Spheres
        Of `Model.spheres`. Spheres have no direction that frames could mistake; a held rope's
        `collision_spheres` are spheres too.

    Returns
    -------
    dict
        `{"sphere": {"rope_0_0": {"pose": [x, y, z, 1, 0, 0, 0], "radius": r}, ...}}`, metres, world frame;
        quaternions begin with w. Names have the number of the rope and of the sphere.

    Raises
    ------
    TypeError
        If `spheres` is something else.
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
