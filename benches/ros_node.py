"""The ROS 2 node on recorded bags, with a stand-in for ROS: frames a second, latency, gaps in TF.

python benches/ros_node.py [--kind KIND] [--seed SEED] [--frames N]

A sequence of `strand.synthetic` is written as a bag by rosbags, read back, and given to the node at the
times of its messages. `ms` is the processor time from a complete depth image to the values of its messages.
Reconstructions beside the tracking are counted apart, per answer, and both in frames a second. What the
stand-in for ROS does is not counted. In a gap, TF is silent after a third of the bag. `near` counts frames in
which all nodes of the answer are within 5 radii of the true rope, `whole` those in which all true nodes are
within 5 radii of the answer: a gripper hides an end, which a tracker goes on with. `longest wait` is that of
a depth image for what belongs to it, by the clock of the bag.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any
from unittest.mock import patch

import numpy as np

import strand
from lib.bag_files import START, Entry, write_bag
from lib.results import make_parser, run_bench
from lib.ros_bags import SECOND, read_bag, record_sequence
from lib.ros_stub import run_node
from lib.tables import print_head, print_row
from lib.tracking_truth import Beside

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "ros" / "strand_ros"))
from strand_ros.waiting import read_stamp

WAYS = {
    "track, masks": {"use_mask": True, "use_color": False},
    "track, colours": {},
    "reconstruct, masks": {"mode": "reconstruct", "use_mask": True, "use_color": False},
}
GAPS = (0.0, 0.1, 0.3, 1.0)  # s without TF
DROPPED = ("tf", "bad tf", "queue", "late", "color", "mask", "skipped", "wrong image")
RIGHT = 5.0  # radii: a rope that is nearer everywhere is right


def silence_tf(entries: list[Entry], gap: float) -> Iterator[Entry]:
    """Yield entries without TF for a while, after a third of the time."""
    begun = START + (entries[-1][1] - START) // 3
    for topic, at, message in entries:
        if topic != "/tf" or not begun <= at < begun + gap * SECOND:
            yield topic, at, message


def run(entries: list[Entry], radius: float, parameters: dict[str, Any]) -> tuple[Any, list[float], float]:
    """Run the node; return its bus, the processor time of each answer, and that beside, s."""
    spent: list[float] = []
    given = {"world_frame": "world", "radius": radius, "ropes": 1}
    beside = Beside()
    with run_node(**given, **parameters) as (bus, node):
        node._follower._tracker._opinions._pool = beside
        answer = node._follower.answer

        def timed(frame: Any) -> Any:
            begun, other = time.process_time(), beside.seconds
            try:
                return answer(frame)
            finally:
                spent.append(time.process_time() - begun - (beside.seconds - other))

        with patch.object(node._follower, "answer", timed):
            bus.play(entries)
            bus.advance(bus.now + SECOND)
    return bus, spent, beside.seconds


def count_right(bus: Any, frames: list[Any], radius: float) -> tuple[int, int]:
    """Return in how many frames the rope is where the true one is, and in how many it is all there."""
    truth = {START + round(frame.time * SECOND): frame.nodes[0] for frame in frames}
    near = whole = 0
    for message in bus.sent["ropes"]:
        if len(message.ropes) == 1:
            nodes = np.array([[p.x, p.y, p.z] for p in message.ropes[0].points])
            found, true = strand.Chain(nodes, radius), strand.Chain(truth[read_stamp(message)], radius)
            near += true.nearest(nodes).distance.max() < RIGHT * radius
            whole += found.nearest(true.points).distance.max() < RIGHT * radius
    return near, whole


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--kind", default="carry", choices=strand.synthetic.SEQUENCES)
    parser.add_argument("--seed", type=int, default=71)
    parser.add_argument("--frames", type=int, default=60)
    arguments = parser.parse_args()
    made = strand.synthetic.sequence(arguments.kind, arguments.seed, frames=arguments.frames, color=True)
    frames, radius = list(made), float(made.radius)
    with tempfile.TemporaryDirectory() as folder:
        write_bag(Path(folder) / "film", "mcap", record_sequence(frames))
        entries = list(read_bag(Path(folder) / "film"))
    rope = np.median(frames[0].color[0][frames[0].labels[0] > 0], axis=0)
    ways = WAYS | {"track, named colour": {"rope_color": rope.astype(int).tolist()}}
    titles = ("near, whole", "points", "ms: median, most", "beside / ms", "frames a second")
    print_head("node", "TF silent / s", "answers", *titles, "longest wait / ms", "dropped")
    for way, parameters in ways.items():
        for gap in GAPS if way == "track, masks" else GAPS[:1]:
            bus, spent, beside = run(list(silence_tf(entries, gap)), radius, parameters)
            (status,) = bus.sent["/diagnostics"][-1].status
            values = {one.key: one.value for one in status.values}
            dropped = [f"{values[kind]} x {kind}" for kind in DROPPED if kind in values]
            near, whole = count_right(bus, frames, radius)
            print_row(
                way,
                gap,
                f"{len(bus.sent['ropes'])} of {len(frames)}",
                f"{near}, {whole}",
                len(bus.sent["points"]),
                f"{1e3 * median(spent):.1f}, {1e3 * max(spent):.0f}",
                f"{1e3 * beside / len(spent):.1f}",
                f"{len(spent) / (sum(spent) + beside):.0f}",
                round(float(values["ms since the image, most"])),
                ", ".join(dropped) or "none",
            )
    return 0


if __name__ == "__main__":
    run_bench(main)
