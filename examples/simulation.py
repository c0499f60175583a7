"""A rope on a table in MuJoCo, depth cameras that draw without a screen, and a gripper that is led.

What the other examples act in; it needs MuJoCo 4 (`pip install mujoco`) and, to draw without a screen, an
EGL library: on Debian the packages libegl1 and libegl-mesa0, and `MUJOCO_GL=egl` in the environment.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

import strand
from strand.ropes.grasps import Grasp

RADIUS = 0.0042
WIDTH, HEIGHT = 640, 480
FIELD_OF_VIEW = np.radians(45.0)  # from the upper to the lower edge
DISTANCE = 0.75
# above the table, as far as the cameras see
BOUNDS = ([-0.5, -0.5, 0.001], [0.5, 0.5, 0.15])
TABLE = ((0.0, 0.0, 1.0), 0.0)
GRIPPER = strand.Gripper(opening=0.03, width=0.012, thickness=0.004, depth=0.05)

FRICTION = 0.4
YOUNG = 1e3  # pascals: so limp that friction keeps it as it is laid
SPEED = 0.2  # metres a second
RETREAT = 0.12  # metres that an open gripper stays away
HOLDS = 4  # strands that fit between the jaws

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
        Camera to world, metres.
    chance : Generator
        Where the images' noise comes from.
    fingers : (2, 3) ndarray
        From the gripper's place to the middles of its fingers, metres.
    film : list of (H, W, 3) ndarray, optional
        If it is a list, photos of all moves' ends are added.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    poses: np.ndarray
    chance: np.random.Generator
    fingers: np.ndarray
    film: list[np.ndarray] | None = None


def camera_poses(count: int) -> np.ndarray:
    """(V, 4, 4) Camera-to-world poses: one from above, the others evenly around the rope."""
    above = strand.synthetic.camera_pose(0.0, DISTANCE, np.radians(80.0))
    angles = np.linspace(0.0, 2.0 * np.pi, count - 1, endpoint=False)
    return np.stack([above, *(strand.synthetic.camera_pose(angle, DISTANCE) for angle in angles)])


def turned(nodes: np.ndarray, seed: int) -> np.ndarray:
    """(N, 3) Nodes of a rope on the table, turned at random and mirrored or not."""
    chance = np.random.default_rng(seed)
    turn, mirror = chance.uniform(0.0, 2.0 * np.pi), chance.choice([-1.0, 1.0])
    c, s = np.cos(turn), np.sin(turn)
    return nodes @ np.array([[c, s, 0.0], [-mirror * s, mirror * c, 0.0], [0.0, 0.0, 1.0]])


def lay(nodes: np.ndarray, views: int, seed: int = 0) -> World:
    """Lay a rope on the table, (N, 3) nodes in metres, and let it settle."""
    poses = camera_poses(views)
    rope = strand.Model((strand.Chain(nodes, RADIUS),), poses)
    size = " ".join(str(0.5 * edge) for edge in (GRIPPER.width, GRIPPER.thickness, GRIPPER.depth))
    finger = f'<body mocap="true" pos="0 0 2"><geom type="box" size="{size}" rgba="0.2 0.3 0.5 1"/></body>'
    holds = '<connect body1="gripper" body2="rope_0_0" anchor="0 0 0" active="false"/>' * HOLDS
    scene = SCENE.format(cameras="".join(map(_camera_element, poses)), fingers=2 * finger, holds=holds)
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


def rope(world: World) -> strand.Chain:
    """Return the rope as it is, which no planner sees."""
    return strand.Chain(world.data.flexvert_xpos.copy(), RADIUS)


def look(world: World, noise: float = 0.0003) -> list[strand.View]:
    """Take a depth image with each camera; the noise of each depth is in metres."""
    _put(world, np.array([0.0, 0.0, 2.0]))  # out of sight
    mujoco.mj_kinematics(world.model, world.data)
    images = []
    with mujoco.Renderer(world.model, HEIGHT, WIDTH) as renderer:
        renderer.enable_depth_rendering()
        for number in range(world.model.ncam):
            renderer.update_scene(world.data, camera=number, scene_option=_shown())
            images.append(renderer.render().astype(np.float64))
    depth = np.stack(images)
    depth += world.chance.normal(scale=noise, size=depth.shape)
    focal = 0.5 * HEIGHT / np.tan(0.5 * FIELD_OF_VIEW)
    # the middle of the image is between its pixels, whose centres have whole numbers
    intrinsics = [[focal, 0, 0.5 * (WIDTH - 1)], [0, focal, 0.5 * (HEIGHT - 1)], [0, 0, 1]]
    return [
        strand.View.from_depth(image, intrinsics, pose)
        for image, pose in zip(depth, world.poses, strict=True)
    ]


def take(world: World, grasp: Grasp) -> np.ndarray:
    """Open the gripper, reach for a place and close on all that lies between the jaws; return the place."""
    model, data = world.model, world.data
    axes, place = grasp.pose[:3, :3], grasp.pose[:3, 3]
    for number in range(3):
        mujoco.mju_mat2Quat(data.mocap_quat[number], axes.ravel())
    _set_fingers(world, grasp, grasp.width)
    _put(world, place - RETREAT * grasp.approach)
    carry(world, place)
    held = _between(world, grasp)[:HOLDS]
    for number, vertex in enumerate(held):
        model.eq_obj2id[number] = model.flex_vertbodyid[vertex]
        model.eq_data[number, :6] = [*(axes.T @ (data.flexvert_xpos[vertex] - place)), 0.0, 0.0, 0.0]
        data.eq_active[number] = 1
    # closed fingers would push what they hold
    _touch(world, False)
    _set_fingers(world, grasp, 2.0 * RADIUS)
    return place


def carry(world: World, *places: np.ndarray) -> None:
    """Lead the gripper in straight lines from place to place, (3,) each, metres."""
    for place in places:
        start = world.data.mocap_pos[0].copy()
        steps = int(np.linalg.norm(place - start) / SPEED / world.model.opt.timestep) + 1
        for step in range(steps):
            _put(world, start + (step + 1) / steps * (place - start))
            mujoco.mj_step(world.model, world.data)
        if world.film is not None:
            world.film.append(photo(world))


def release(world: World) -> None:
    """Let go, retreat, and wait until the rope lies still."""
    world.data.eq_active[:HOLDS] = 0
    carry(world, world.data.mocap_pos[0] + [0.0, 0.0, RETREAT])
    _touch(world, True)
    wait(world, 0.5)


def wait(world: World, seconds: float) -> None:
    """Let time pass."""
    until = world.data.time + seconds
    while world.data.time < until:
        mujoco.mj_step(world.model, world.data)


def photo(world: World) -> np.ndarray:
    """(H, W, 3) What the first camera sees, in colour."""
    with mujoco.Renderer(world.model, HEIGHT, WIDTH) as renderer:
        renderer.update_scene(world.data, camera=0, scene_option=_shown())
        return renderer.render()


def _shown() -> mujoco.MjvOption:
    shown = mujoco.MjvOption()
    shown.flags[mujoco.mjtVisFlag.mjVIS_FLEXVERT] = True  # round joints and ends
    return shown


def _camera_element(pose: np.ndarray) -> str:
    """Return a camera of MuJoCo, whose y goes up and whose z goes back."""
    words = [" ".join(map(str, part)) for part in (pose[:3, 3], np.concatenate([pose[:3, 0], -pose[:3, 1]]))]
    return f'<camera pos="{words[0]}" xyaxes="{words[1]}" fovy="{np.degrees(FIELD_OF_VIEW)}"/>'


def _put(world: World, place: np.ndarray) -> None:
    world.data.mocap_pos[0] = place
    world.data.mocap_pos[1:3] = place + world.fingers


def _set_fingers(world: World, grasp: Grasp, width: float) -> None:
    """Open or close the fingers, with their tips where the grasp has them."""
    aside = 0.5 * (width + GRIPPER.thickness)
    local = [[0.0, side * aside, grasp.tip - 0.5 * GRIPPER.depth] for side in (-1.0, 1.0)]
    world.fingers = np.array(local) @ grasp.pose[:3, :3].T
    _put(world, world.data.mocap_pos[0])


def _touch(world: World, touching: bool) -> None:
    """Let the fingers push what they meet, or go through it."""
    fingers = world.model.body_mocapid[world.model.geom_bodyid] > 0
    world.model.geom_contype[fingers] = world.model.geom_conaffinity[fingers] = touching


def _between(world: World, grasp: Grasp) -> list[int]:
    """Return one vertex for each strand between the jaws."""
    chain = rope(world)
    s = np.arange(0.0, chain.length, 0.001)
    local = (chain.at(s) - world.data.mocap_pos[0]) @ grasp.pose[:3, :3]
    inside = np.abs(local[:, 0]) < 0.5 * GRIPPER.width
    inside &= np.abs(local[:, 1]) < 0.5 * grasp.width
    inside &= (local[:, 2] > grasp.tip - GRIPPER.depth) & (local[:, 2] < grasp.tip + RADIUS)
    numbers = np.flatnonzero(inside)
    strands = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1) if len(numbers) else []
    return [int(np.abs(chain.arc_length - s[strand_].mean()).argmin()) for strand_ in strands]
