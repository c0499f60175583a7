"""Calls of the kernels."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import strand
from shared.public.scenes import CLOUD, LINE, NORMALS, R, make_scene
from shared.public.surface import Call
from strand._core import fit_spline


def list_calls(folder: Path) -> dict[str, Call]:
    """Return the calls by their names."""
    views = [view.crop(make_scene().bounds) for view in make_scene().views]
    cloud = {"points": CLOUD, "nonfinite": "raise"}
    fit = {
        "points": [view.world_points for view in views],
        "viewpoints": np.array([view.viewpoint for view in views]),
        "curves": [fit_spline(LINE, 1.5 * R, 0.0)],
        "motions": np.tile(np.eye(4), (len(views), 1, 1)),
        "radius": R,
        "radius_classes": [0],
        "pose_sd": (0.01, 0.002),
        "reference": 1,
        "fit_curves": True,
        "radius_prior": (R, 1e-4),
        "along_ray": False,
        "band": (0.6, 0.4),
        "iterations": 2,
        "tolerance": 0.1,
        "min_bend": 1.5,
        "noise": 7e-4,
        "shared": (1.0, 1.0),
        "bounds": np.array([[-1.0] * 3, [1.0] * 3]),
        "end_observations": (strand.EndObservation(0, 0, LINE[0], np.array([-1.0, 0.0, 0.0]), 1e-3),),
        "previous": None,
        "uncertainty": True,
    }
    fitted = strand.fit_tubes(**fit)
    normals = {
        "points": CLOUD,
        "viewpoint": np.array([0.0, 0.0, 9.0]),
        "variation": True,
        "nonfinite": "raise",
    }
    return {
        "radius_outlier_mask": Call(strand.radius_outlier_mask, cloud | {"radius": 0.2, "min_neighbors": 3}),
        "count_neighbors": Call(strand.count_neighbors, cloud | {"radius": 0.2}),
        "estimate_normals": Call(strand.estimate_normals, normals | {"k": 8}, normals | {"radius": 0.3}),
        "icp": Call(
            strand.icp,
            {
                "source": CLOUD,
                "target": CLOUD + 0.001,
                "max_correspondence_distance": 0.1,
                "start": np.eye(4),
                "target_normals": NORMALS,
                "max_iterations": 3,
                "tolerance": 1e-6,
                "nonfinite": "raise",
            },
        ),
        "centerline": Call(
            strand.centerline, cloud | {"normals": NORMALS, "radius": 0.2, "min_neighbors": 2}
        ),
        "trace_chains": Call(strand.trace_chains, cloud | {"near": 0.1, "far": 0.3, "start": 3}),
        "trace_tubes": Call(
            strand.trace_tubes,
            {
                "points": fit["points"][0],
                "viewpoint": fit["viewpoints"][0],
                "radius": R,
                "min_nodes": 4,
                "nonfinite": "raise",
            },
        ),
        "fit_tubes": Call(strand.fit_tubes, fit, fit | {"radius": np.array([R])}, fit | {"previous": fitted}),
        "TubeFit.replace": Call(fitted.replace, fitted.__getnewargs_ex__()[1]),
        "TubeFit.radius": Call(fitted.radius, {"curve": 0}),
        "TubeFit.band": Call(fitted.band, {"curve": 0}),
        "EndObservation": Call(
            strand.EndObservation,
            {"view": 0, "end": 0, "place": LINE[0], "outward": np.eye(3)[0], "sd": 1e-3},
        ),
        "num_threads": Call(strand.num_threads, {}),
        "set_num_threads": Call(strand.set_num_threads, {"threads": 0}),
    }
