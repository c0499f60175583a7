"""The simulation of the other examples: a rope on a table in MuJoCo, depth cameras and grippers.

It needs MuJoCo 4 (`pip install mujoco`). To draw without a screen, it also needs an EGL library and
`MUJOCO_GL=egl` in the environment; on Debian, the packages libegl1 and libegl-mesa0.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

import strand
from strand.ropes.grasps import Grasp

RADIUS = 0.0042  # metres: radius of the rope
WIDTH = 640  # pixels of an image
HEIGHT = 480  # pixels of an image
FIELD_OF_VIEW = np.radians(45.0)  # radians: vertical field of view
DISTANCE = 0.75  # metres from the cameras to the origin
BOUNDS = ([-0.5, -0.5, 0.001], [0.5, 0.5, 0.15])  # metres: space above the table that the cameras see
TABLE = ((0.0, 0.0, 1.0), 0.0)  # normal, and height in metres
GRIPPER = strand.Gripper(opening=0.03, width=0.012, thickness=0.004, depth=0.05)

FRICTION = 0.4  # friction coefficient of the rope and the table
YOUNG = 1e3  # pascals: Young's modulus of a rope so limp that friction keeps its shape
SPEED = 0.2  # metres per second
FRAME = 1.0 / 30.0  # seconds from one image of a camera to the next
RETREAT = 0.12  # metres from an open gripper to the rope
MAX_HELD = 4  # strands between the jaws
_HAND = 3  # number of the second gripper among the bodies that are moved

SCENE = """
<mujoco>
  <include file="rope.xml"/>
  <statistic extent="1"/>
  <visual><map znear="0.1" zfar="3"/></visual>
  <worldbody>
    <geom type="plane" size="1 1 0.1" rgba="0.45 0.5 0.55 1"/>
    <light pos="0.3 -0.5 1.5" dir="-0.2 0.3 -1" diffuse="0.4 0.4 0.4"/>
    <body name="gripper" mocap="true" pos="0 0 2">
      <geom type="box" pos="0 0 -0.055" size="0.02 0.025 0.008" rgba="0.2 0.3 0.5 1" {ghost}/>
    </body>
    {fingers}
    <body name="hand" mocap="true" pos="0 0 2">
      <geom type="box" pos="0 0 0.02" size="0.012 0.012 0.025" rgba="0.3 0.5 0.3 1" {ghost}/>
    </body>
    {cameras}
  </worldbody>
  <equality>
    {holds}
    <connect body1="hand" body2="rope_0_0" anchor="0 0 0" active="false"/>
  </equality>
</mujoco>
"""


@dataclass
class World:
    """A simulated table.

    Attributes
    ----------
    model, data : MjModel, MjData
    poses : (V, 4, 4) ndarray
        Camera-to-world poses, metres.
    rng : Generator
        Source of the images' noise.
    renderer : Renderer
    fingers : (2, 3) ndarray
        Centres of the fingers relative to the gripper, metres.
    film : list of (H, W, 3) ndarray, optional
        Collects a photo at the end of each move, if it is a list.
    path : callable, optional
        Where the second gripper is at a time in seconds: it returns (3,) metres.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    poses: np.ndarray
    rng: np.random.Generator
    renderer: mujoco.Renderer
    fingers: np.ndarray
    film: list[np.ndarray] | None = None
    path: Callable[[float], np.ndarray] | None = None


def make_poses(count: int) -> np.ndarray:
    """Return (V, 4, 4) camera poses: the first from above, the others evenly around the rope."""
    above = strand.synthetic.camera_pose(0.0, DISTANCE, np.radians(80.0))
    angles = np.linspace(0.0, 2.0 * np.pi, count - 1, endpoint=False)
    return np.stack([above, *(strand.synthetic.camera_pose(angle, DISTANCE) for angle in angles)])


def turned(nodes: np.ndarray, seed: int) -> np.ndarray:
    """Return the (N, 3) nodes of a rope on the table, turned and maybe mirrored at random."""
    rng = np.random.default_rng(seed)
    turn, mirror = rng.uniform(0.0, 2.0 * np.pi), rng.choice([-1.0, 1.0])
    c, s = np.cos(turn), np.sin(turn)
    return nodes @ np.array([[c, s, 0.0], [-mirror * s, mirror * c, 0.0], [0.0, 0.0, 1.0]])


def lay(nodes: np.ndarray, views: int, seed: int = 0) -> World:
    """Return a world with a rope of (N, 3) nodes, metres, that has settled on the table."""
    poses = make_poses(views)
    rope = strand.Model((strand.Chain(nodes, RADIUS),), poses)
    size = " ".join(str(0.5 * edge) for edge in (GRIPPER.width, GRIPPER.thickness, GRIPPER.depth))
    finger = f'<body mocap="true" pos="0 0 2"><geom type="box" size="{size}" rgba="0.2 0.3 0.5 1"/></body>'
    holds = '<connect body1="gripper" body2="rope_0_0" anchor="0 0 0" active="false"/>' * MAX_HELD
    cameras = "".join(map(_make_camera_element, poses))
    ghost = 'contype="0" conaffinity="0"'  # touches nothing
    scene = SCENE.format(cameras=cameras, fingers=2 * finger, holds=holds, ghost=ghost)
    with tempfile.TemporaryDirectory() as folder:
        rope.save_mjcf(Path(folder, "rope.xml"), spacing=2.5 * RADIUS, young=YOUNG)
        Path(folder, "scene.xml").write_text(scene)
        model = mujoco.MjModel.from_xml_path(str(Path(folder, "scene.xml")))
    model.flex_rgba[:] = 0.9, 0.45, 0.1, 1.0
    model.flex_friction[:, 0] = FRICTION
    model.geom_friction[:, 0] = FRICTION
    renderer = mujoco.Renderer(model, HEIGHT, WIDTH)
    world = World(model, mujoco.MjData(model), poses, np.random.default_rng(seed), renderer, np.zeros((2, 3)))
    wait(world, 0.5)
    return world


def stiffen(world: World) -> None:
    """Keep the rope's length when it is pulled hard; else it stretches by up to 5 %."""
    edges = world.model.eq_type == int(mujoco.mjtEq.mjEQ_FLEX)
    world.model.eq_solref[edges] = 0.004, 1.0
    world.model.eq_solimp[edges, :2] = 0.99, 0.999


def get_rope(world: World) -> strand.Chain:
    """Return the true rope of the simulation."""
    return strand.Chain(world.data.flexvert_xpos.copy(), RADIUS)


def look(world: World, noise: float = 0.0003) -> list[strand.View]:
    """Return a view from each camera, with independent noise of this standard deviation, metres.

    The gripper is out of view, and nothing tells the rope's pixels.
    """
    put_gripper(world, np.array([0.0, 0.0, 2.0]))
    return [_make_view(world, camera, noise) for camera in range(world.model.ncam)]


def watch(world: World, noise: float = 0.0003) -> list[strand.View]:
    """Return views like `look`, with the grippers in view; masks tell what is rope and what is gripper."""
    moved = world.model.body_mocapid[world.model.geom_bodyid] >= 0
    views = []
    for camera in range(world.model.ncam):
        world.renderer.enable_segmentation_rendering()
        numbers, kinds = np.moveaxis(_draw(world, camera), 2, 0)
        world.renderer.disable_segmentation_rendering()
        # comparisons with a member of an enumeration are slow
        of_gripper = (kinds == int(mujoco.mjtObj.mjOBJ_GEOM)) & moved[np.maximum(numbers, 0)]
        views.append(_make_view(world, camera, noise, kinds == int(mujoco.mjtObj.mjOBJ_FLEX), of_gripper))
    return views


def grasp_rope(world: World, grasp: Grasp) -> np.ndarray:
    """Close the gripper on all strands between its jaws; return its (3,) position, metres."""
    place = grasp.pose[:3, 3]
    aim(world, grasp)
    put_gripper(world, place - RETREAT * grasp.approach)
    carry(world, place)
    close(world, grasp)
    return place


def aim(world: World, grasp: Grasp) -> None:
    """Turn and open the gripper as a grasp has it, wherever it is."""
    for number in range(3):
        mujoco.mju_mat2Quat(world.data.mocap_quat[number], grasp.pose[:3, :3].ravel())
    _set_fingers(world, grasp, grasp.width)


def close(world: World, grasp: Grasp) -> None:
    """Hold all strands between the jaws."""
    model, data = world.model, world.data
    axes, place = grasp.pose[:3, :3], data.mocap_pos[0]
    held = _find_held(world, grasp)[:MAX_HELD]
    for number, vertex in enumerate(held):
        model.eq_obj2id[number] = model.flex_vertbodyid[vertex]
        model.eq_data[number, :6] = [*(axes.T @ (data.flexvert_xpos[vertex] - place)), 0.0, 0.0, 0.0]
        data.eq_active[number] = 1
    # closed fingers would push the held strands away
    _set_contacts(world, False)
    _set_fingers(world, grasp, 2.0 * RADIUS)


def drag(world: World, vertex: int, path: Callable[[float], np.ndarray]) -> None:
    """Let the second gripper hold a vertex of the rope; `path` returns its (3,) place at a time, seconds."""
    world.path = path
    world.model.eq_obj2id[MAX_HELD] = world.model.flex_vertbodyid[vertex]
    world.model.eq_data[MAX_HELD, :6] = 0.0
    world.data.eq_active[MAX_HELD] = 1
    world.data.mocap_pos[_HAND] = path(world.data.time)
    mujoco.mj_forward(world.model, world.data)


def put_gripper(world: World, place: np.ndarray) -> None:
    """Put the gripper at a (3,) place, metres, at once."""
    world.data.mocap_pos[0] = place
    world.data.mocap_pos[1:3] = place + world.fingers


def carry(world: World, *places: np.ndarray) -> None:
    """Move the gripper in straight lines to (3,) places, one after the other, metres."""
    for place in places:
        start = world.data.mocap_pos[0].copy()
        steps = int(np.linalg.norm(place - start) / SPEED / world.model.opt.timestep) + 1
        for step in range(steps):
            put_gripper(world, start + (step + 1) / steps * (place - start))
            _step(world)
        if world.film is not None:
            world.film.append(take_photo(world))


def steer(world: World, place: np.ndarray, arrival: float = 0.0, speed: float = SPEED) -> None:
    """Move the gripper for a frame towards a (3,) place, metres.

    It arrives there at the time `arrival`, seconds, or as soon as its speed allows, metres per second.
    """
    timestep, end = world.model.opt.timestep, world.data.time + FRAME
    while world.data.time < end:
        way = (place - world.data.mocap_pos[0]) / max(round((arrival - world.data.time) / timestep), 1)
        way *= min(1.0, speed * timestep / max(float(np.linalg.norm(way)), 1e-9))
        put_gripper(world, world.data.mocap_pos[0] + way)
        _step(world)


def release(world: World) -> None:
    """Open the gripper, retreat, and wait until the rope rests."""
    let_go(world)
    carry(world, world.data.mocap_pos[0] + [0.0, 0.0, RETREAT])
    touch(world)
    wait(world, 0.5)


def let_go(world: World) -> None:
    """Hold nothing any more; the fingers pass through the rope until `touch`."""
    world.data.eq_active[:MAX_HELD] = 0


def touch(world: World) -> None:
    """Let the fingers push what they touch again."""
    _set_contacts(world, True)


def wait(world: World, seconds: float) -> None:
    """Simulate this many seconds."""
    until = world.data.time + seconds
    while world.data.time < until:
        _step(world)


def take_photo(world: World) -> np.ndarray:
    """Return the (H, W, 3) colour image of the first camera."""
    return _draw(world, 0, shadows=True)


def _step(world: World) -> None:
    if world.path is not None:
        world.data.mocap_pos[_HAND] = world.path(world.data.time)
    mujoco.mj_step(world.model, world.data)


def _draw(world: World, camera: int, shadows: bool = False) -> np.ndarray:
    """Return an image of the kind that the renderer is set to."""
    mujoco.mj_kinematics(world.model, world.data)
    world.renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
    world.renderer.update_scene(world.data, camera=camera, scene_option=_make_options())
    return world.renderer.render()


def _make_view(
    world: World,
    camera: int,
    noise: float,
    mask: NDArray[np.bool_] | None = None,
    occluders: NDArray[np.bool_] | None = None,
) -> strand.View:
    world.renderer.enable_depth_rendering()
    depth = _draw(world, camera).astype(np.float64)
    world.renderer.disable_depth_rendering()
    depth += world.rng.normal(scale=noise, size=depth.shape)
    focal = 0.5 * HEIGHT / np.tan(0.5 * FIELD_OF_VIEW)
    # pixel centres have integer coordinates, so the image's middle is between pixels
    intrinsics = [[focal, 0, 0.5 * (WIDTH - 1)], [0, focal, 0.5 * (HEIGHT - 1)], [0, 0, 1]]
    return strand.View.from_depth(depth, intrinsics, world.poses[camera], mask=mask, occluders=occluders)


def _make_options() -> mujoco.MjvOption:
    options = mujoco.MjvOption()
    options.flags[mujoco.mjtVisFlag.mjVIS_FLEXVERT] = True  # round joints and ends
    return options


def _make_camera_element(pose: np.ndarray) -> str:
    """Return a camera in MuJoCo's XML; its y axis points up and its z axis backwards."""
    words = [" ".join(map(str, part)) for part in (pose[:3, 3], np.concatenate([pose[:3, 0], -pose[:3, 1]]))]
    return f'<camera pos="{words[0]}" xyaxes="{words[1]}" fovy="{np.degrees(FIELD_OF_VIEW)}"/>'


def _set_fingers(world: World, grasp: Grasp, width: float) -> None:
    """Set the distance between the fingers, with their tips as in the grasp."""
    aside = 0.5 * (width + GRIPPER.thickness)
    local = [[0.0, side * aside, grasp.tip - 0.5 * GRIPPER.depth] for side in (-1.0, 1.0)]
    world.fingers = np.array(local) @ grasp.pose[:3, :3].T
    put_gripper(world, world.data.mocap_pos[0])


def _set_contacts(world: World, touching: bool) -> None:
    """Let the fingers push the rope, or pass through it."""
    fingers = np.isin(world.model.body_mocapid[world.model.geom_bodyid], (1, 2))
    world.model.geom_contype[fingers] = world.model.geom_conaffinity[fingers] = touching


def _find_held(world: World, grasp: Grasp) -> list[int]:
    """Return a vertex of each strand between the jaws."""
    chain = get_rope(world)
    s = np.arange(0.0, chain.length, 0.001)
    local = (chain.at(s) - world.data.mocap_pos[0]) @ grasp.pose[:3, :3]
    inside = np.abs(local[:, 0]) < 0.5 * GRIPPER.width
    inside &= np.abs(local[:, 1]) < 0.5 * grasp.width
    inside &= (local[:, 2] > grasp.tip - GRIPPER.depth) & (local[:, 2] < grasp.tip + RADIUS)
    numbers = np.flatnonzero(inside)
    strands = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1) if len(numbers) else []
    return [int(np.abs(chain.arc_length - s[strand_].mean()).argmin()) for strand_ in strands]
