"""A rope on a table in MuJoCo, seen by depth cameras that are drawn without a screen, and reconstructed.

    MUJOCO_GL=egl python examples/simulated_rope.py --shape overhand --views 3

It needs MuJoCo 4 (`pip install mujoco`) and, on Debian, the packages libegl1 and libegl-mesa0. The rope
settles under its weight; then each camera takes a depth image with noise. What strand makes of these is
compared with the rope's own places in the simulation.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import mujoco
import numpy as np

import strand

RADIUS = 0.0042
WIDTH, HEIGHT = 320, 240
FIELD_OF_VIEW = np.radians(35.0)  # from the upper to the lower edge
DISTANCE = 0.45
# above the table
BOUNDS = ([-0.3, -0.3, 0.0015], [0.3, 0.3, 0.1])

SCENE = """
<mujoco>
  <include file="rope.xml"/>
  <statistic extent="1"/>
  <visual><map znear="0.1" zfar="3"/></visual>
  <worldbody>
    <geom type="plane" size="1 1 0.1"/>
    {cameras}
  </worldbody>
</mujoco>
"""


def camera_poses(count: int) -> np.ndarray:
    """(V, 4, 4) Camera-to-world poses: one from above, the others evenly around the rope."""
    above = strand.synthetic.camera_pose(0.0, DISTANCE, np.radians(80.0))
    angles = np.linspace(0.0, 2.0 * np.pi, count - 1, endpoint=False)
    return np.stack([above, *(strand.synthetic.camera_pose(angle, DISTANCE) for angle in angles)])


def camera_element(pose: np.ndarray) -> str:
    """Return a camera of MuJoCo, whose y goes up and whose z goes back."""
    words = [" ".join(map(str, part)) for part in (pose[:3, 3], np.concatenate([pose[:3, 0], -pose[:3, 1]]))]
    return f'<camera pos="{words[0]}" xyaxes="{words[1]}" fovy="{np.degrees(FIELD_OF_VIEW)}"/>'


def settled(shape: str, poses: np.ndarray, seconds: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Lay a rope on the table and let it settle."""
    rope = strand.Chain(strand.synthetic.shape(shape), RADIUS)
    with tempfile.TemporaryDirectory() as folder:
        strand.Model((rope,), poses).to_mjcf(Path(folder, "rope.xml"), spacing=2.5 * RADIUS)
        scene = Path(folder, "scene.xml")
        scene.write_text(SCENE.format(cameras="".join(map(camera_element, poses))))
        model = mujoco.MjModel.from_xml_path(str(scene))
    data = mujoco.MjData(model)
    while data.time < seconds:
        mujoco.mj_step(model, data)
    return model, data


def depth_images(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """(V, H, W) What each camera sees: metres along its z axis."""
    shown = mujoco.MjvOption()
    shown.flags[mujoco.mjtVisFlag.mjVIS_FLEXVERT] = True  # round joints and ends
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
        renderer.enable_depth_rendering()
        images = []
        for number in range(model.ncam):
            renderer.update_scene(data, camera=number, scene_option=shown)
            images.append(renderer.render().astype(np.float64))
    return np.stack(images)


def main() -> None:
    """Simulate, look, reconstruct, compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shape", default="overhand", help="a name that strand.synthetic.shape knows")
    parser.add_argument("--views", type=int, default=3, choices=range(1, 8), metavar="1 to 7")
    parser.add_argument("--noise", type=float, default=0.0003, help="of each depth, metres")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()

    poses = camera_poses(options.views)
    model, data = settled(options.shape, poses, seconds=0.5)
    depth = depth_images(model, data)
    depth += np.random.default_rng(options.seed).normal(scale=options.noise, size=depth.shape)

    focal = 0.5 * HEIGHT / np.tan(0.5 * FIELD_OF_VIEW)
    # the middle of the image is between its pixels, whose centres have whole numbers
    intrinsics = [[focal, 0, 0.5 * (WIDTH - 1)], [0, focal, 0.5 * (HEIGHT - 1)], [0, 0, 1]]
    views = [
        strand.View.from_depth(image, intrinsics, pose) for image, pose in zip(depth, poses, strict=True)
    ]
    found = strand.reconstruct(views, radius=RADIUS, bounds=BOUNDS, ropes=1)

    chain, truth = found.chains[0], strand.Chain(data.flexvert_xpos, RADIUS)
    places = truth.at(np.linspace(0.0, truth.length, 400))
    off = np.array([chain.nearest(place)[1] for place in places])
    print(f"off by {np.sqrt((off**2).mean()) * 1e3:.2f} mm (RMS), {off.max() * 1e3:.2f} mm at most")
    # the simulated rope has round ends
    whole = truth.length + 2.0 * RADIUS
    print(f"{chain.length * 1e3:.0f} mm of {whole * 1e3:.0f} mm, confidence {found.confidence:.2f}")


if __name__ == "__main__":
    main()
