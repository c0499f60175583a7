"""strand: ordered 3D centrelines of strings, ropes, cables and hoses from depth-camera point clouds."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from strand._core import (
    EndObservation,
    IcpResult,
    NotEnoughDataError,
    StrandError,
    TubeFit,
    __version__,
    centerline,
    count_neighbors,
    estimate_normals,
    fit_tubes,
    icp,
    num_threads,
    radius_outlier_mask,
    set_num_threads,
    trace_chains,
    trace_tubes,
)

if TYPE_CHECKING:
    from strand import batch, config, export, figures, msgs, synthetic
    from strand.config import Config
    from strand.io.models import load_model
    from strand.io.recordings import Recording
    from strand.io.scenes import load_scene
    from strand.reconstruction.color_masks.rope_mask import rope_mask
    from strand.reconstruction.finding.ropes import NoRopeError, find_ropes
    from strand.reconstruction.pipeline import reconstruct
    from strand.reconstruction.radius import estimate_radius
    from strand.reconstruction.tubes.registration import register_views
    from strand.ropes.chain import Chain
    from strand.ropes.diagram import knot_diagram
    from strand.ropes.grasps import Gripper
    from strand.ropes.knots import knot, linking_number
    from strand.ropes.model import Model
    from strand.ropes.netlist import Netlist
    from strand.support.files import FileFormatError
    from strand.tracking.tracker import Tracker
    from strand.views.box import Box
    from strand.views.pose import pose_from_angles, rotation_xyz, turntable_pose
    from strand.views.sensor import Sensor
    from strand.views.view import View

__all__ = [
    "Box",
    "Chain",
    "Config",
    "EndObservation",
    "FileFormatError",
    "Gripper",
    "IcpResult",
    "Model",
    "Netlist",
    "NoRopeError",
    "NotEnoughDataError",
    "Recording",
    "Sensor",
    "StrandError",
    "Tracker",
    "TubeFit",
    "View",
    "__version__",
    "batch",
    "centerline",
    "config",
    "count_neighbors",
    "estimate_normals",
    "estimate_radius",
    "export",
    "figures",
    "find_ropes",
    "fit_tubes",
    "icp",
    "knot",
    "knot_diagram",
    "linking_number",
    "load_model",
    "load_scene",
    "msgs",
    "num_threads",
    "pose_from_angles",
    "radius_outlier_mask",
    "reconstruct",
    "register_views",
    "rope_mask",
    "rotation_xyz",
    "set_num_threads",
    "synthetic",
    "trace_chains",
    "trace_tubes",
    "turntable_pose",
]

_MODULES = {  # each name that Python code defines, and its module: imported on first use
    "Box": "strand.views.box",
    "Chain": "strand.ropes.chain",
    "Config": "strand.config",
    "FileFormatError": "strand.support.files",
    "Gripper": "strand.ropes.grasps",
    "Model": "strand.ropes.model",
    "Netlist": "strand.ropes.netlist",
    "NoRopeError": "strand.reconstruction.finding.ropes",
    "Recording": "strand.io.recordings",
    "Sensor": "strand.views.sensor",
    "Tracker": "strand.tracking.tracker",
    "View": "strand.views.view",
    "batch": "strand.batch",
    "config": "strand.config",
    "estimate_radius": "strand.reconstruction.radius",
    "export": "strand.export",
    "figures": "strand.figures",
    "find_ropes": "strand.reconstruction.finding.ropes",
    "knot": "strand.ropes.knots",
    "knot_diagram": "strand.ropes.diagram",
    "linking_number": "strand.ropes.knots",
    "load_model": "strand.io.models",
    "load_scene": "strand.io.scenes",
    "msgs": "strand.msgs",
    "pose_from_angles": "strand.views.pose",
    "reconstruct": "strand.reconstruction.pipeline",
    "register_views": "strand.reconstruction.tubes.registration",
    "rope_mask": "strand.reconstruction.color_masks.rope_mask",
    "rotation_xyz": "strand.views.pose",
    "synthetic": "strand.synthetic",
    "turntable_pose": "strand.views.pose",
}


def __getattr__(name: str) -> object:
    """Import a public name when it is first used: all modules together take longer than a short command."""
    if name not in _MODULES:
        raise AttributeError(f"module 'strand' has no attribute {name!r}")
    module = importlib.import_module(_MODULES[name])
    value = module if module.__name__ == f"strand.{name}" else getattr(module, name)
    globals()[name] = value
    return value


__dir__ = __all__.copy
