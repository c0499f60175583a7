"""Compare queries against a rope's tube with Open3D, trimesh and coal on the tube's mesh, and print tables.

python benches/queries.py [--points 1 1000 100000] [--repeats 7] [--sides 16]

The rope is one of `strand.synthetic.random_ropes`. strand asks its capsules; the others ask a mesh of them
with `sides` vertices around. Each query is asked of all by turns (A B C A B C ...), so that whatever else the
machine does falls on all; a time is the median of the turns. Structures for the search are built before.
Answers are compared as well: the greatest difference is printed, away from the rope's ends, which are flat in
the mesh.

Open3D comes with the test packages. trimesh (with rtree) and coal are asked if they are installed, in at most
200 queries a turn, as they take long.
"""

from __future__ import annotations

import importlib.util
import os
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

THREADS = 2
# Open3D's threads are as many as the processors that it may use when it is imported
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:THREADS])

import numpy as np  # noqa: E402
import open3d as o3d  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

import strand  # noqa: E402
from lib.results import make_parser, run_bench  # noqa: E402
from lib.tables import print_head, print_row  # noqa: E402

Array = NDArray[np.float64]
RADIUS = 0.0042
SPHERE = 0.01  # metres, radius of spheres that move
SLOW = 200  # most queries a turn of peers that take long
SINGLES = 15  # calls of a single query
PAUSE = 0.02  # seconds before each turn: peers' threads spin for a while after their work
QUERIES = ("signed distance", "rays", "swept spheres")


@dataclass(frozen=True)
class Asked:
    """Queries: points, directions of rays from them, and where spheres go."""

    points: Array
    directions: Array
    ends: Array


Ask = Callable[[Asked], Array]


def make_rope() -> strand.Chain:
    return strand.Chain(strand.synthetic.random_ropes(1, 1, seed=3)[0], RADIUS)


def make_queries(chain: strand.Chain, count: int, seed: int = 0) -> Asked:
    """Queries in and around the rope's box, of numbers that single precision holds."""
    rng = np.random.default_rng(seed)
    low, high = chain.points.min(axis=0) - 0.03, chain.points.max(axis=0) + 0.03
    points, ends = rng.uniform(low, high, (2, count, 3)).astype(np.float32).astype(float)
    way = ends - points
    return Asked(points, way / np.linalg.norm(way, axis=1, keepdims=True), ends)


def ask_strand(chain: strand.Chain) -> dict[str, Ask]:
    model = strand.Model((chain,), np.empty((0, 4, 4)))
    return {
        "signed distance": lambda a: model.signed_distance(a.points),
        "rays": lambda a: model.ray_hits(a.points, a.directions).distance,
        "swept spheres": lambda a: model.swept_spheres(a.points, a.ends, SPHERE).time,
    }


def ask_open3d(vertices: Array, triangles: NDArray[np.int32]) -> dict[str, Ask]:
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(vertices.astype(np.float32), triangles.astype(np.uint32))

    def distances(a: Asked) -> Array:
        return np.asarray(scene.compute_signed_distance(a.points.astype(np.float32)).numpy())

    def rays(a: Asked) -> Array:
        both = np.hstack([a.points, a.directions]).astype(np.float32)
        return np.asarray(scene.cast_rays(both)["t_hit"].numpy())

    return {"signed distance": distances, "rays": rays}


def ask_trimesh(vertices: Array, triangles: NDArray[np.int32]) -> dict[str, Ask]:
    import trimesh

    mesh = trimesh.Trimesh(vertices, triangles, process=False)

    def rays(a: Asked) -> Array:
        places, number, _ = mesh.ray.intersects_location(a.points, a.directions, multiple_hits=False)
        found = np.full(len(a.points), np.inf)
        found[number] = np.linalg.norm(places.reshape(-1, 3) - a.points[number], axis=1)
        return found

    return {
        "signed distance": lambda a: -trimesh.proximity.signed_distance(mesh, a.points),
        "rays": rays,
    }


def ask_coal(vertices: Array, triangles: NDArray[np.int32]) -> dict[str, Ask]:
    import coal

    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(len(triangles), len(vertices))
    mesh.addVertices(vertices)
    mesh.addTriangles(triangles)
    mesh.endModel()
    here, request = coal.Transform3s(), coal.DistanceRequest()
    dot, sphere = coal.Sphere(0.0), coal.Sphere(SPHERE)

    def distances(a: Asked) -> Array:
        found = np.empty(len(a.points))
        for i, point in enumerate(a.points):
            result = coal.DistanceResult()
            found[i] = coal.distance(mesh, here, dot, coal.Transform3s(np.eye(3), point), request, result)
        return found

    def sweeps(a: Asked) -> Array:
        # its Python has no continuous collision: steps by the distance, as in conservative advancement
        found = np.full(len(a.points), np.inf)
        for i, (start, end) in enumerate(zip(a.points, a.ends, strict=True)):
            length, gone = float(np.linalg.norm(end - start)), 0.0
            while gone <= length:
                place = coal.Transform3s(np.eye(3), start + (gone / length) * (end - start))
                apart = coal.distance(mesh, here, sphere, place, request, coal.DistanceResult())
                if apart < 1e-6:
                    found[i] = gone / length
                    break
                gone += apart
        return found

    return {"signed distance": distances, "swept spheres": sweeps}


def time_queries(ask: Ask, queries: Asked) -> tuple[float, Array]:
    """Seconds of a call, of a single query the median of several, and the answers."""
    time.sleep(PAUSE)
    times = []
    for _ in range(SINGLES if len(queries.points) == 1 else 1):
        start = time.perf_counter()
        answer = ask(queries)
        times.append(time.perf_counter() - start)
    return statistics.median(times), answer


def compare_answers(query: str, answer: Array, expected: Array, chain: strand.Chain, queries: Asked) -> float:
    """How far answers are apart at most, micrometres: where both have one, and no flat end is near."""
    model = strand.Model((chain,), np.empty((0, 4, 4)))
    length = np.linalg.norm(queries.ends - queries.points, axis=1) if query == "swept spheres" else 1.0
    where = queries.points
    if query == "signed distance":
        # inside, the mesh's distance is another where strands touch
        compared = expected > 0
    else:
        compared = np.isfinite(answer) & np.isfinite(expected) & (expected > 0)
        ahead = np.where(compared, expected * length, 0.0)
        where = queries.points + ahead[:, None] * queries.directions
        # what grazes is ill posed
        s = model.nearest(where)
        out = (where - s.point) / np.maximum(s.distance, 1e-12)[:, None]
        compared &= (out * queries.directions).sum(axis=1) < -0.5
    s = model.nearest(where).s
    compared &= (s > 3 * RADIUS) & (s < chain.length - 3 * RADIUS)
    with np.errstate(invalid="ignore"):  # of rays that both say to meet nothing
        apart = np.abs(answer - expected) * length
    return float(np.nanmax(apart[compared], initial=0.0)) * 1e6


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--points", type=int, nargs="+", default=[1, 1000, 100_000], help="queries in a call")
    parser.add_argument("--repeats", type=int, default=7, help="turns")
    parser.add_argument("--sides", type=int, default=16, help="vertices around the tube's mesh")
    arguments = parser.parse_args()
    strand.set_num_threads(THREADS)
    chain = make_rope()
    vertices, triangles = chain.tube(arguments.sides)
    peers: dict[str, dict[str, Ask]] = {
        "strand": ask_strand(chain),
        "Open3D": ask_open3d(vertices, triangles),
    }
    for name, modules, make in (
        ("trimesh", ("trimesh", "rtree"), ask_trimesh),
        ("coal", ("coal",), ask_coal),
    ):
        missing = [module for module in modules if importlib.util.find_spec(module) is None]
        if missing:
            print(f"{name} is left out: {', '.join(missing)} not installed")
        else:
            peers[name] = make(vertices, triangles)
    print(f"{len(chain.points)} nodes, {chain.length:.2f} m, {len(triangles)} triangles, {THREADS} threads\n")
    for query in QUERIES:
        asks: dict[str, Any] = {name: peer[query] for name, peer in peers.items() if query in peer}
        print(f"\n{query}: microseconds for each query, and queries in a second\n")
        print_head("queries in a call", *asks, "greatest difference, µm")
        for count in arguments.points:
            cells, apart = measure_query(query, asks, count, chain, arguments.repeats)
            print_row(count, *cells, apart)
    return 0


def measure_query(
    query: str, asks: dict[str, Ask], count: int, chain: strand.Chain, repeats: int
) -> tuple[list[str], str]:
    """Times of one query in calls of so many, and how far answers are apart."""
    times: dict[str, list[float]] = {name: [] for name in asks}
    apart: dict[str, float] = {name: 0.0 for name in asks if name != "strand"}
    for ask in asks.values():
        ask(make_queries(chain, 1))  # some build what they search when they are first asked
    for turn in range(repeats):
        queries = make_queries(chain, count, seed=turn)
        few = make_queries(chain, min(count, SLOW), seed=turn)
        expected = {len(q.points): asks["strand"](q) for q in (queries, few)}
        for name, ask in asks.items():
            mine = few if name in ("trimesh", "coal") else queries
            took, answer = time_queries(ask, mine)
            times[name].append(took / len(mine.points))
            if name != "strand":
                off = compare_answers(query, answer, expected[len(mine.points)], chain, mine)
                apart[name] = max(apart[name], off)
    medians = {name: statistics.median(each) for name, each in times.items()}
    cells = [f"{1e6 * t:.3g} ({1.0 / t:,.0f})" for t in medians.values()]
    return cells, ", ".join(f"{name} {off:.0f}" for name, off in apart.items())


if __name__ == "__main__":
    run_bench(main)
