"""Print digests of the answers of kernels and both methods on the stored scenes, to compare machines.

python packaging/bits.py

Kernels and the published method give the same bits on every processor. The default method also uses NumPy's
linear algebra. Its last bits depend on the processor, so a second digest has the nodes rounded to 0.1 nm.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import strand

SCENES = Path(__file__).resolve().parent.parent / "tests/data/scenes"
ROUGH = 1e-10  # metres: the second digest's rounding
RADIUS = 0.0042  # metres: of scenes without one


def list_arrays(value: object) -> Iterator[np.ndarray]:
    """Yield all arrays and numbers of an answer."""
    if isinstance(value, (list, tuple)):
        for part in value:
            yield from list_arrays(part)
    else:
        yield np.ascontiguousarray(value)


def compute_digest(*values: object) -> str:
    """Return the start of the SHA-256 of all bits."""
    found = hashlib.sha256()
    for array in list_arrays(values):
        found.update(array.tobytes())
    return found.hexdigest()[:16]


def run_kernels(source: np.ndarray, target: np.ndarray, radius: float) -> Iterator[object]:
    """Yield the answers of all kernels."""
    yield strand.radius_outlier_mask(target, 2 * radius, 5)
    yield strand.count_neighbors(target, radius)
    yield strand.estimate_normals(target, k=16, viewpoint=(0, 0, 0))
    normals = strand.estimate_normals(target, radius=2 * radius, viewpoint=(0, 0, 0))
    yield normals
    # points with few neighbours have no normal
    normals = np.where(np.isfinite(normals).all(axis=1, keepdims=True), normals, (0.0, 0.0, 1.0))
    for along in (None, normals):
        found = strand.icp(source, target, 2 * radius, target_normals=along)
        yield found.transformation, found.inlier_rmse
    yield strand.centerline(target, normals, radius, 3)
    yield strand.trace_chains(target, radius, 3 * radius)
    yield strand.trace_tubes(target, (0.0, 0.0, 0.0), radius)


def main() -> None:
    print(platform.machine(), "NumPy", np.__version__)
    for path in sorted(SCENES.glob("*.npz")):
        scene = strand.load_scene(path)
        radius = RADIUS if scene.radius is None else float(np.ravel(scene.radius)[0])
        source, target = (view.points[np.isfinite(view.points).all(axis=1)] for view in scene.views[2:4])
        of_kernels = compute_digest([*run_kernels(source, target, radius)])
        published = strand.reconstruct(scene.views, radius, scene.bounds, config=strand.Config.published())
        default = strand.reconstruct(scene.views, radius, scene.bounds)
        nodes = [chain.points for chain in default.chains]
        digests = {
            "kernels": of_kernels,
            "published": compute_digest([chain.points for chain in published.chains]),
            "default": compute_digest(nodes),
            "to 0.1 nm": compute_digest([np.round(own / ROUGH) for own in nodes]),
        }
        print(path.stem, ", ".join(f"{name} {found}" for name, found in digests.items()))


if __name__ == "__main__":
    main()
