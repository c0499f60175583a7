"""Call every kernel and public function with mad arguments, and print what breaks.

python benches/attack.py [--calls N] [--seed N] [--only NAME ...]

Numbers are NaN, infinite, huge, tiny, zero or negative, arrays empty, of other shapes, kinds and
strides, read-only, or not arrays at all. Calls run in a process of their own with little memory. A
finding is the end of that process, an exception that is not among those below, NaN in an answer, or a
call that takes longer than some seconds; the exit code says whether there is one.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import resource
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np

import strand
from lib.results import make_parser, run_bench
from strand import _core

ALLOWED = (TypeError, ValueError, strand.StrandError, MemoryError)
# what else may be raised: numbers of what is not public are made by Python, and are no arguments of a user's
ALSO = {"fit.radius": (IndexError, OverflowError)}
PRIVATE = (IndexError, OverflowError)
SECONDS, MEMORY = 10.0, 3 << 30
NUMBERS = (
    0.0,
    -0.0,
    1.0,
    -1.0,
    1e-3,
    1e3,
    1e9,
    -1e9,
    1e-9,
    1e99,
    1e100,
    1e154,
    1e300,
    -1e300,
    1e-160,
    1e-300,
    5e-324,
)
WILD = (*NUMBERS, math.nan, math.inf, -math.inf)
COUNTS = (0, 1, 2, 3, 7, 255, 10**4, 2**31 - 1, 2**31, 2**53, 2**63 - 1, 2**63, 2**64, -1, -(2**63), True)
OTHERS = (
    None,
    "points",
    b"",
    [],
    {},
    (),
    object(),
    1 + 2j,
    [[1.0, 2.0], [3.0]],
    "1.0",
    np.datetime64("2020"),
)
KINDS = ("f2", "f4", "f8", ">f8", "i1", "i8", "u8", "c16", "bool", "O", "U3", "longdouble")

RNG = np.random.default_rng(0)
TUBE = np.stack(
    [RNG.uniform(0, 0.3, 400), *(0.005 * f(RNG.uniform(0, np.pi, 400)) for f in (np.cos, np.sin))], axis=1
)
TUBE[:, 2] = np.sqrt(np.maximum(0.005**2 - np.clip(TUBE[:, 1], -0.005, 0.005) ** 2, 0.0)) + 0.5
NORMALS = np.stack([np.zeros(400), TUBE[:, 1] / 0.005, np.sqrt(1 - (TUBE[:, 1] / 0.005) ** 2)], axis=1)
NODES = np.stack([np.linspace(0, 0.3, 12), np.zeros(12), np.full(12, 0.5)], axis=1)
DEPTH = np.full((48, 64), 0.5)
MASK = np.zeros((48, 64), bool)
MASK[22:27, 4:60] = True
DEPTH[MASK] = 0.495
EYE, CAMERA = np.eye(4), ((200.0, 200.0), (32.0, 24.0))
IMAGES = _core.RopeImages([DEPTH], [MASK], [CAMERA], [EYE], 0.005)
SEEN = _core.Visibility([TUBE], [TUBE], [EYE])
FIT = strand.fit_tubes([TUBE], [[0.1, 0.0, 9.0]], [NODES], [EYE], 0.005, pose_sd=(0.01, 0.01), reference=0)
K = np.array([[200.0, 0, 32.0], [0, 200.0, 24.0], [0, 0, 1.0]])
CHAIN, VIEW = strand.Chain(NODES, 0.005), strand.View(TUBE)
# a rope on a table
ON_TABLE = np.repeat(np.repeat(np.where(MASK, 0.49, 0.5), 3, axis=0), 3, axis=1)
CLOUD = SimpleNamespace(**strand.msgs.make_point_cloud2(TUBE, "camera"))
CLOUD.fields = [SimpleNamespace(**field) for field in CLOUD.fields]

# function, positional arguments, keyword arguments
CALLS: dict[str, tuple[Callable, tuple, dict]] = {
    "radius_outlier_mask": (strand.radius_outlier_mask, (TUBE, 0.01, 3), {"nonfinite": "raise"}),
    "count_neighbors": (strand.count_neighbors, (TUBE, 0.01), {"nonfinite": "drop"}),
    "count_neighbors_each": (_core.count_neighbors_each, ([TUBE, TUBE], 0.01), {}),
    "normals_k": (strand.estimate_normals, (TUBE,), {"k": 8, "viewpoint": (0, 0, 9.0), "variation": True}),
    "normals_radius": (
        strand.estimate_normals,
        (TUBE,),
        {"radius": 0.01, "viewpoint": TUBE + 1.0, "nonfinite": "drop"},
    ),
    "estimate_normals_each": (_core.estimate_normals_each, ([TUBE, TUBE], 0.01), {}),
    "icp": (strand.icp, (TUBE, TUBE, 0.01), {"start": EYE, "max_iterations": 3, "tolerance": 1e-6}),
    "icp_planes": (strand.icp, (TUBE, TUBE, 0.01), {"target_normals": NORMALS, "max_iterations": 3}),
    "register_in_turn": (_core.register_in_turn, ([TUBE, TUBE], 0.01, 3, 1e-6), {}),
    "centerline": (strand.centerline, (TUBE, NORMALS, 0.005, 3), {}),
    "trace_chains": (strand.trace_chains, (TUBE, 0.005, 0.01), {"start": 3}),
    "trace_tubes": (strand.trace_tubes, (TUBE, (0.0, 0.0, 9.0), 0.005), {"min_nodes": 4}),
    "apparent_radii": (_core.apparent_radii, (TUBE, (0.0, 0.0, 9.0), 0.02, 20), {}),
    "fit_tubes": (
        strand.fit_tubes,
        ([TUBE], [[0.1, 0.0, 9.0]], [NODES], [EYE], 0.005),
        {
            "radius_classes": [0],
            "pose_sd": (0.01, 0.01),
            "reference": 0,
            "radius_prior": (0.005, 0.001),
            "band": (0.6, 0.4),
            "iterations": 2,
            "tolerance": 0.1,
            "min_bend": 1.5,
            "noise": 1e-4,
            "shared": (1.0, 1.0),
            "bounds": [[-1.0] * 3, [1.0] * 3],
        },
    ),
    "rope_extents": (_core.rope_extents, (FIT, [1e-3]), {}),
    "fit.replace": (FIT.replace, (), {"radii": np.array([0.005]), "curve": FIT.curve, "sigma": 1.0}),
    "fit.radius": (FIT.radius, (0,), {}),
    "EndObservation": (strand.EndObservation, (0, 0, (0.0, 0.0, 0.5), (1.0, 0.0, 0.0), 0.01), {}),
    "spline_through": (_core.spline_through, (NODES, 0.02, 0.01), {}),
    "spline_places": (_core.spline_places, (NODES, np.linspace(0, 9, 20)), {}),
    "arc_lengths": (_core.arc_lengths, (NODES, 0.0, 9.0), {}),
    "overlapping": (
        _core.overlapping,
        (NODES, np.zeros(12, np.int64), np.linspace(0, 1, 12), 0.01, 0.05),
        {},
    ),
    "path_length": (_core.path_length, (NODES,), {}),
    "end_direction": (_core.end_direction, (NODES, 0.0, 0.05), {}),
    "bridge": (_core.bridge, (NODES, NODES + 0.5, 0.05, 0.01, (1.0, 1.0)), {}),
    "straighten": (_core.straighten, (NODES, 0.005, 0.02), {}),
    "bending": (_core.bending, (NODES,), {}),
    "join_cost": (_core.join_cost, ((0.0, 0, 0), (1.0, 0, 0), (1.0, 0, 0), (-1.0, 0, 0), 0.005), {}),
    "typical_neighbors": (_core.typical_neighbors, (TUBE, 0.01), {}),
    "occupied_voxels": (_core.occupied_voxels, ([TUBE], 0.01), {}),
    "occludes": (_core.occludes, (TUBE, NODES, (0.0, 0.0, 0.0), 0.01), {}),
    "Visibility": (_core.Visibility, ([TUBE], [NODES], [EYE]), {}),
    "Visibility of an image": (_core.Visibility, ([(DEPTH, *CAMERA)], [NODES], [EYE]), {}),
    "visibility.states": (SEEN.states, (NODES, 0.005), {}),
    "visibility.free": (SEEN.free, (NODES, 0.005), {}),
    "visibility.seen_through": (SEEN.seen_through, (NODES, (1.0, 0.0, 0.0), 0.005), {}),
    "copy_depth": (_core.copy_depth, (DEPTH, 65.0), {}),
    "unproject": (_core.unproject, (DEPTH, *CAMERA), {}),
    "crop": (_core.crop, (TUBE, EYE, (-1.0,) * 3, (1.0,) * 3, TUBE), {}),
    "crop_images": (_core.crop_images, ([DEPTH], [CAMERA], [EYE], (-1.0,) * 3, (1.0,) * 3), {}),
    "convolved": (_core.convolved, (DEPTH.astype(np.float32), [0.5, 0.25]), {}),
    "largest_blob": (_core.largest_blob, (MASK,), {}),
    "blob_numbers": (_core.blob_numbers, (MASK,), {}),
    "edge_distances": (_core.edge_distances, (MASK, 40), {}),
    "short_outlines": (_core.short_outlines, (DEPTH.astype(np.float32) - 0.5, [1.0], 3), {}),
    "shown_radius": (_core.shown_radius, (MASK,), {}),
    "RopeImages": (_core.RopeImages, ([DEPTH], [MASK], [CAMERA], [EYE], 0.005), {}),
    "images.readings": (IMAGES.readings, (1, 2, [0]), {}),
    "images.reading_cost": (IMAGES.reading_cost, (0, [np.array([[4.0, 24.0], [60.0, 24.0]])]), {}),
    "images.fit": (
        IMAGES.fit,
        (
            [(0, [np.array([[4.0, 24.0], [60.0, 24.0]])])],
            ((0.0, 0.0, 1.0), 0.5),
            0,
            (0.01, 0.01),
            (None, 4.0, 0.5, 0.0),
            2,
            True,
        ),
        {},
    ),
    "images.depth_gains": (IMAGES.depth_gains, ([([NODES], [[0.0] * 6])], ((0.0, 0.0, 1.0), 0.5), 0.01), {}),
    "images.end_gains": (IMAGES.end_gains, ([NODES], [NODES], [[0.0] * 6], ((0.0, 0.0, 1.0), 0.5), 0.01), {}),
    "View": (strand.View, (TUBE, EYE), {"colors": np.abs(NORMALS)}),
    "View.from_depth": (strand.View.from_depth, (DEPTH, K, EYE), {"depth_scale": 1.0, "mask": MASK}),
    "estimate_radius": (
        lambda *points: strand.estimate_radius([strand.View(p) for p in points]),
        (TUBE,),
        {},
    ),
    "turntable_pose": (strand.turntable_pose, (0.3, 0.5, 0.4), {}),
    "pose_from_angles": (strand.pose_from_angles, ((0.1, 0.2, 0.3), (0.0, 0.0, 0.5)), {}),
    "rotation_xyz": (strand.rotation_xyz, ((0.1, 0.2, 0.3),), {}),
    "Chain": (strand.Chain, (NODES, 0.005), {"closed": False}),
    "chain.at": (CHAIN.at, (np.linspace(-0.01, 0.4, 20),), {}),
    "chain.nearest": (CHAIN.nearest, (NODES[3] + 0.01,), {}),
    "Model": (lambda *nodes: strand.Model([strand.Chain(n, 0.005) for n in nodes], [EYE]), (NODES,), {}),
    "View.crop": (VIEW.crop, (([-1.0] * 3, [1.0] * 3),), {}),
    "View.from_world": (strand.View.from_world, (TUBE, (0.0, 0.0, 9.0)), {"colors": np.abs(NORMALS)}),
    "variances_around": (_core.variances_around, (TUBE, NODES, 0.02, 5), {}),
    "squared_distances": (_core.squared_distances, (TUBE, NODES), {}),
    "depth_bends": (_core.depth_bends, ([DEPTH], [CAMERA], [TUBE], 3), {}),
    "seen_behind": (_core.seen_behind, (DEPTH, CAMERA, EYE, NODES, 0.1), {}),
    "constant_copy": (_core.constant_copy, (TUBE,), {}),
    "reconstruct": (
        lambda depth, *arguments, **more: strand.reconstruct(
            [strand.View.from_depth(depth, K)], *arguments, **more
        ),
        (DEPTH, 0.005, ([-1.0, -1.0, 0.4], [1.0, 1.0, 0.51]), 1),
        {"length": 0.14, "deadline": 5.0},
    ),
    "reconstruct of all that is seen": (
        lambda depth, intrinsics, **more: strand.reconstruct(
            [strand.View.from_depth(depth, intrinsics)], deadline=5.0, **more
        ),
        (ON_TABLE, K),
        {"radius": 0.005, "ropes": 1},
    ),
    "find_ropes": (
        lambda depth, *more: strand.find_ropes([strand.View.from_depth(depth, K)], *more).radius,
        (ON_TABLE, 0.005),
        {},
    ),
    "Box": (
        lambda points, *box: strand.View(points).crop(strand.Box(*box)),
        (TUBE, [-1.0] * 3, [1.0] * 3, EYE),
        {},
    ),
    "register_views": (
        lambda points, *more: strand.register_views([strand.View(points), strand.View(TUBE)], *more),
        (TUBE, 0.005, ([-1.0] * 3, [1.0] * 3)),
        {},
    ),
    "chain.tube": (CHAIN.tube, (16,), {}),
    "msgs.make_path": (
        lambda nodes, *more: strand.msgs.make_path(strand.Chain(nodes, 0.005), *more),
        (NODES, "world", 7),
        {},
    ),
    "msgs.make_marker_array": (
        lambda nodes, *more: strand.msgs.make_marker_array(
            strand.Model([strand.Chain(nodes, 0.005)], [EYE]), *more
        ),
        (NODES, "world", 7),
        {},
    ),
    "msgs.make_point_cloud2": (
        strand.msgs.make_point_cloud2,
        (TUBE, "world", 7),
        {"colors": np.abs(NORMALS)},
    ),
    "msgs.read_view": (strand.msgs.read_view, (CLOUD, None, EYE), {"depth_scale": 0.001}),
}
# as many iterations as are asked for, unless they converge
ITERATE = ("icp", "icp_planes", "register_in_turn", "fit_tubes")
# NaN where it is not known
MAY_BE_NAN = ("confidence",)
# of a call that takes long this share is made
SELDOM = {
    "reconstruct": 0.05,
    "reconstruct of all that is seen": 0.05,
    "find_ropes": 0.1,
    "register_views": 0.1,
}
# where NaN has a meaning, or what is asked of the core was checked before in Python
UNCHECKED = {
    "spline_places",
    "arc_lengths",
    "join_cost",
    "bending",
    "path_length",
    "end_direction",
    "straighten",
    "bridge",
    "unproject",
    "convolved",
    "fit.replace",
    "fit.radius",
    "images.reading_cost",
    "images.depth_gains",
    "images.end_gains",
    "crop",
    "crop_images",
    "constant_copy",
    "seen_behind",
    "depth_bends",
    "variances_around",
}


def mad_array(array: np.ndarray, chance: random.Random) -> object:
    """An array with something wrong with it, or only odd."""
    array = np.array(array)
    way = chance.randrange(16)
    if way < 5 and array.size and array.dtype.kind == "f":
        flat = array.reshape(-1)
        for _ in range(chance.choice((1, 1, 5, flat.size))):
            flat[chance.randrange(flat.size)] = chance.choice(WILD)
        return array
    if way == 5 and array.dtype.kind == "f":
        with np.errstate(all="ignore"):
            return array * chance.choice(NUMBERS)
    if way == 6 and array.dtype.kind == "f":
        return array + chance.choice((1e3, 1e6, 1e9, 1e15, 1e99))
    if way == 7:
        return array[: chance.choice((0, 1, 2, 3, 5))] if array.ndim else array
    if way == 8:
        return np.resize(
            array,
            chance.choice(
                ((), (0,), (3,), (0, 3), (1, 3), (3, 1), (5, 2), (4, 4), (2, 3, 3), (1, 0), (3, 0))
            ),
        )
    if way == 9:
        # words are not whole numbers
        kind = "O" if array.dtype.kind in "UO" else chance.choice(KINDS)
        with np.errstate(all="ignore"):
            return array.astype(kind)
    if way == 10:
        return np.repeat(array, 2, axis=0)[::2] if array.ndim else array
    if way == 11:
        array.flags.writeable = False
        return np.asfortranarray(array)
    if way == 12:
        return array[::-1] if array.ndim else array
    if way == 13:
        return array.tolist()
    if way == 14:
        return np.zeros_like(array)
    return np.ma.masked_array(array, mask=False)


def mad(value: object, chance: random.Random) -> object:
    """Something else than a value."""
    if chance.random() < 0.08:
        return chance.choice(OTHERS)
    if isinstance(value, np.ndarray):
        return mad_array(value, chance)
    if isinstance(value, bool) or value is None:
        return chance.choice((True, False, None, 1, "no"))
    if isinstance(value, int):
        return chance.choice(COUNTS)
    if isinstance(value, float):
        return chance.choice((*WILD, 10**400, np.float32(1.0), "1"))
    if isinstance(value, (list, tuple)):
        items = list(value)
        way = chance.random()
        if way < 0.1:
            items = items[:-1]
        elif way < 0.2:
            items = items + items[-1:]
        elif items:
            place = chance.randrange(len(items))
            items[place] = mad(items[place], chance)
        return type(value)(items)
    return chance.choice(OTHERS)


def numbers(value: object) -> list[np.ndarray]:
    """All arrays and numbers of an answer."""
    if isinstance(value, (np.ndarray, float, np.floating)):
        return [np.asarray(value)]
    if isinstance(value, (list, tuple)):
        return [each for part in value for each in numbers(part)]
    if isinstance(value, strand.Model):
        return numbers([value.poses, *value.chains])
    if isinstance(value, (strand.IcpResult, strand.TubeFit, strand.Chain, strand.View)):
        return [
            each
            for name in dir(value)
            if name[0] != "_" and name not in MAY_BE_NAN
            for each in numbers(getattr(value, name))
        ]
    return []


def allowed(name: str) -> tuple[type[Exception], ...]:
    """What a call may raise."""
    function = CALLS[name][0]
    owner, short = getattr(function, "__self__", None), function.__name__
    private = isinstance(owner, (_core.RopeImages, _core.Visibility)) or (
        hasattr(_core, short) and not hasattr(strand, short)
    )
    return (*ALLOWED, *(PRIVATE if private else ALSO.get(name, ())))


def attack(first: int, calls: int, only: list[str]) -> None:
    """Make calls; tell each before it is made where it is slow or ends the process."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    def ring(*_: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, ring)
    names, told, met = only or sorted(CALLS), sys.stdout, Counter()
    for number in range(first, first + calls):
        chance = random.Random(number)
        name = chance.choice(names)
        while chance.random() > SELDOM.get(name, 1.0):
            name = chance.choice(names)
        function, arguments, options = CALLS[name]
        arguments, options, expected = list(arguments), dict(options), allowed(name)
        for _ in range(chance.choice((0, 1, 1, 1, 2, 3))):
            place = chance.randrange(len(arguments) + len(options))
            if place < len(arguments):
                arguments[place] = mad(arguments[place], chance)
            else:
                key = sorted(options)[place - len(arguments)]
                options[key] = mad(options[key], chance)
        told.seek(0)
        told.write(json.dumps([number, name]) + " " * 40)
        told.flush()
        start = time.perf_counter()
        signal.setitimer(signal.ITIMER_REAL, SECONDS)
        try:
            answer = function(*arguments, **options)
            outcome = "answers"
            if name not in UNCHECKED and any(
                each.dtype.kind == "f" and np.isnan(each).any() for each in numbers(answer)
            ):
                outcome = "NaN in the answer"
        except TimeoutError:
            asked = [*arguments, *options.values()]
            endless = name in ITERATE and any(isinstance(each, int) and each > 10**4 for each in asked)
            outcome = "as long as asked" if endless else "takes too long"
        except expected as error:
            outcome = type(error).__name__
            if "internal error" in str(error):
                outcome = str(error)
        except BaseException as error:
            outcome = f"{type(error).__name__}: {error}"
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        met[outcome] += 1
        known = {"answers", "as long as asked", "NotEnoughDataError", "NoRopeError"}
        if outcome not in known | {kind.__name__ for kind in expected}:
            taken = round(time.perf_counter() - start, 1)
            print(json.dumps([number, name, outcome[:300], taken]), file=sys.stderr, flush=True)
    print(json.dumps(["met", met, first + calls - 1]), file=sys.stderr, flush=True)


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--calls", type=int, default=20_000, metavar="N", help="how many (default: 20000)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="the first call's seed (default: 0)")
    parser.add_argument(
        "--only", nargs="*", default=[], metavar="NAME", choices=sorted(CALLS), help="these kernels"
    )
    parser.add_argument("--within", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.within:
        attack(arguments.seed, arguments.calls, arguments.only)
        return 0
    seed, last = arguments.seed, arguments.seed + arguments.calls
    findings, met = [], Counter()
    at = Path(f"attack.{arguments.seed}.at")
    while seed < last:
        command = [
            sys.executable,
            __file__,
            "--within",
            "--seed",
            str(seed),
            "--calls",
            str(min(last - seed, 100_000)),
        ]
        command += ["--only", *arguments.only] if arguments.only else []
        with at.open("w+") as told:
            done = subprocess.run(command, stdout=told, stderr=subprocess.PIPE, text=True, check=False)
            told.seek(0)
            place = json.loads(told.read().strip() or f'[{seed}, "start"]')
        for line in done.stderr.splitlines():
            try:
                found = json.loads(line)
            except ValueError:
                continue
            if found[0] == "met":
                met.update(found[1])
                place = [found[2], "end"]
            else:
                findings.append(found)
                print(*found, flush=True)
        if done.returncode:
            findings.append([*place, f"ends the process with {done.returncode}"])
            print(*findings[-1], done.stderr[-300:], flush=True)
        seed = place[0] + 1
    at.unlink()
    print(f"{arguments.calls} calls, {len(findings)} findings; {dict(met)}")
    return 1 if findings else 0


if __name__ == "__main__":
    run_bench(main)
