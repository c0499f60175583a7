"""strand: ordered 3D centrelines of strings, ropes, cables and hoses from depth-camera point clouds."""

from strand import synthetic
from strand._core import (
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
from strand.config import Config
from strand.io import FileFormatError, load_scene
from strand.model import Alternative, Chain, Doubt, Join, Model, load
from strand.pipeline import reconstruct
from strand.radius import estimate_radius
from strand.tubes import register_views
from strand.view import View, pose_from_angles, rotation_xyz, turntable_pose

__all__ = [
    "Alternative",
    "Chain",
    "Config",
    "Doubt",
    "FileFormatError",
    "IcpResult",
    "Join",
    "Model",
    "NotEnoughDataError",
    "StrandError",
    "TubeFit",
    "View",
    "__version__",
    "centerline",
    "count_neighbors",
    "estimate_normals",
    "estimate_radius",
    "fit_tubes",
    "icp",
    "load",
    "load_scene",
    "num_threads",
    "pose_from_angles",
    "radius_outlier_mask",
    "reconstruct",
    "register_views",
    "rotation_xyz",
    "set_num_threads",
    "synthetic",
    "trace_chains",
    "trace_tubes",
    "turntable_pose",
]
