"""The simulation of the other examples: a rope on a table in MuJoCo, depth cameras and a gripper.

It needs MuJoCo 4 (`pip install mujoco`). To draw without a screen, it also needs an EGL library and
`MUJOCO_GL=egl` in the environment; on Debian, the packages libegl1 and libegl-mesa0.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

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
RETREAT = 0.12  # metres from an open gripper to the rope
MAX_HELD = 4  # strands between the jaws

SCENE = """
<mujoco>
  <include file="rope.xml"/>
  <statistic extent="1"/>
  <visual><map znear="0.1" zfar="3"/></visual>
  <worldbody>
    <geom type="plane" size="1 1 0.1" rgba="0.45 0.5 0.55 1"/>
    <light pos="0.3 -0.5 1.5" dir="-0.2 0.3 -1" diffuse="0.4 0.4 0.4"/>
    <body name="gripper" mocap="true" pos="0 0 1"/>
    {fingers}
    {cameras}
  </worldbody>
  <equality>{holds}</equality>
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
    fingers : (2, 3) ndarray
        Centres of the fingers relative to the gripper, metres.
    film : list of (H, W, 3) ndarray, optional
        Collects a photo at the end of each move, if it is a list.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    poses: np.ndarray
    rng: np.random.Generator
    fingers: np.ndarray
    film: list[np.ndarray] | None = None


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
    scene = SCENE.format(cameras="".join(map(_make_camera_element, poses)), fingers=2 * finger, holds=holds)
    with tempfile.TemporaryDirectory() as folder:
        rope.save_mjcf(Path(folder, "rope.xml"), spacing=2.5 * RADIUS, young=YOUNG)
        Path(folder, "scene.xml").write_text(scene)
        model = mujoco.MjModel.from_xml_path(str(Path(folder, "scene.xml")))
    model.flex_rgba[:] = 0.9, 0.45, 0.1, 1.0
    model.flex_friction[:, 0] = FRICTION
    model.geom_friction[:, 0] = FRICTION
    world = World(model, mujoco.MjData(model), poses, np.random.default_rng(seed), np.zeros((2, 3)))
    wait(world, 0.5)
    return world


def get_rope(world: World) -> strand.Chain:
    """Return the true rope of the simulation."""
    return strand.Chain(world.data.flexvert_xpos.copy(), RADIUS)


def look(world: World, noise: float = 0.0003) -> list[strand.View]:
    """Return a view from each camera, with independent noise of this standard deviation, metres."""
    _place_gripper(world, np.array([0.0, 0.0, 2.0]))  # out of view
    mujoco.mj_kinematics(world.model, world.data)
    images = []
    with mujoco.Renderer(world.model, HEIGHT, WIDTH) as renderer:
        renderer.enable_depth_rendering()
        for number in range(world.model.ncam):
            renderer.update_scene(world.data, camera=number, scene_option=_make_options())
            images.append(renderer.render().astype(np.float64))
    depth = np.stack(images)
    depth += world.rng.normal(scale=noise, size=depth.shape)
    focal = 0.5 * HEIGHT / np.tan(0.5 * FIELD_OF_VIEW)
    # pixel centres have integer coordinates, so the image's middle is between pixels
    intrinsics = [[focal, 0, 0.5 * (WIDTH - 1)], [0, focal, 0.5 * (HEIGHT - 1)], [0, 0, 1]]
    return [
        strand.View.from_depth(image, intrinsics, pose)
        for image, pose in zip(depth, world.poses, strict=True)
    ]


def grasp_rope(world: World, grasp: Grasp) -> np.ndarray:
    """Close the gripper on all strands between its jaws; return its (3,) position, metres."""
    model, data = world.model, world.data
    axes, place = grasp.pose[:3, :3], grasp.pose[:3, 3]
    for number in range(3):
        mujoco.mju_mat2Quat(data.mocap_quat[number], axes.ravel())
    _set_fingers(world, grasp, grasp.width)
    _place_gripper(world, place - RETREAT * grasp.approach)
    carry(world, place)
    held = _find_held(world, grasp)[:MAX_HELD]
    for number, vertex in enumerate(held):
        model.eq_obj2id[number] = model.flex_vertbodyid[vertex]
        model.eq_data[number, :6] = [*(axes.T @ (data.flexvert_xpos[vertex] - place)), 0.0, 0.0, 0.0]
        data.eq_active[number] = 1
    # closed fingers would push the held strands away
    _set_contacts(world, False)
    _set_fingers(world, grasp, 2.0 * RADIUS)
    return place


def carry(world: World, *places: np.ndarray) -> None:
    """Move the gripper in straight lines to (3,) places, one after the other, metres."""
    for place in places:
        start = world.data.mocap_pos[0].copy()
        steps = int(np.linalg.norm(place - start) / SPEED / world.model.opt.timestep) + 1
        for step in range(steps):
            _place_gripper(world, start + (step + 1) / steps * (place - start))
            mujoco.mj_step(world.model, world.data)
        if world.film is not None:
            world.film.append(take_photo(world))


def release(world: World) -> None:
    """Open the gripper, retreat, and wait until the rope rests."""
    world.data.eq_active[:MAX_HELD] = 0
    carry(world, world.data.mocap_pos[0] + [0.0, 0.0, RETREAT])
    _set_contacts(world, True)
    wait(world, 0.5)


def wait(world: World, seconds: float) -> None:
    """Simulate this many seconds."""
    until = world.data.time + seconds
    while world.data.time < until:
        mujoco.mj_step(world.model, world.data)


def take_photo(world: World) -> np.ndarray:
    """Return the (H, W, 3) colour image of the first camera."""
    with mujoco.Renderer(world.model, HEIGHT, WIDTH) as renderer:
        renderer.update_scene(world.data, camera=0, scene_option=_make_options())
        return renderer.render()


def _make_options() -> mujoco.MjvOption:
    options = mujoco.MjvOption()
    options.flags[mujoco.mjtVisFlag.mjVIS_FLEXVERT] = True  # round joints and ends
    return options


def _make_camera_element(pose: np.ndarray) -> str:
    """Return a camera in MuJoCo's XML; its y axis points up and its z axis backwards."""
    words = [" ".join(map(str, part)) for part in (pose[:3, 3], np.concatenate([pose[:3, 0], -pose[:3, 1]]))]
    return f'<camera pos="{words[0]}" xyaxes="{words[1]}" fovy="{np.degrees(FIELD_OF_VIEW)}"/>'


def _place_gripper(world: World, place: np.ndarray) -> None:
    world.data.mocap_pos[0] = place
    world.data.mocap_pos[1:3] = place + world.fingers


def _set_fingers(world: World, grasp: Grasp, width: float) -> None:
    """Set the distance between the fingers, with their tips as in the grasp."""
    aside = 0.5 * (width + GRIPPER.thickness)
    local = [[0.0, side * aside, grasp.tip - 0.5 * GRIPPER.depth] for side in (-1.0, 1.0)]
    world.fingers = np.array(local) @ grasp.pose[:3, :3].T
    _place_gripper(world, world.data.mocap_pos[0])


def _set_contacts(world: World, touching: bool) -> None:
    """Let the fingers push the rope, or pass through it."""
    fingers = world.model.body_mocapid[world.model.geom_bodyid] > 0
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
