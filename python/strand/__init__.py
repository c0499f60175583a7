"""strand: ordered 3D centrelines of strings, ropes, cables and hoses from depth-camera point clouds."""

from strand import batch, config, export, figures, msgs, synthetic
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

__dir__ = __all__.copy
