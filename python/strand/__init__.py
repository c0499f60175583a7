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
from strand.box import Box
from strand.chain import Chain
from strand.config import Config
from strand.contacts import Contact
from strand.crossings import Crossing
from strand.diagram import Diagram, knot_diagram
from strand.doubt import Doubt
from strand.export.capsules import Capsules
from strand.export.spheres import Spheres
from strand.files import FileFormatError
from strand.finding.ropes import FoundRopes, NoRopeError, find_ropes
from strand.finding.strips import LeftOut
from strand.grasps import Grasp, Grasps, Refused
from strand.gripper import Gripper
from strand.io.models import load
from strand.io.recordings import Recording
from strand.io.scenes import load_scene
from strand.knots import Knot, knot
from strand.linking import linking_number
from strand.model import Alternative, Join, Model, ModelWarning
from strand.pipeline import reconstruct
from strand.pose import pose_from_angles, rotation_xyz, turntable_pose
from strand.pulls import Pull, PullPlan
from strand.queries import Nearest, RayHits, Sweeps
from strand.radius import estimate_radius
from strand.sensor import Sensor
from strand.shape import ShapeError
from strand.tubes.registration import register_views
from strand.view import View

__all__ = [
    "Alternative",
    "Box",
    "Capsules",
    "Chain",
    "Config",
    "Contact",
    "Crossing",
    "Diagram",
    "Doubt",
    "EndObservation",
    "FileFormatError",
    "FoundRopes",
    "Grasp",
    "Grasps",
    "Gripper",
    "IcpResult",
    "Join",
    "Knot",
    "LeftOut",
    "Model",
    "ModelWarning",
    "Nearest",
    "NoRopeError",
    "NotEnoughDataError",
    "Pull",
    "PullPlan",
    "RayHits",
    "Recording",
    "Refused",
    "Sensor",
    "ShapeError",
    "Spheres",
    "StrandError",
    "Sweeps",
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
    "load",
    "load_scene",
    "msgs",
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

__dir__ = __all__.copy
