"""Compare queries against a rope's tube with Open3D, trimesh and coal on the tube's mesh.

python benches/queries.py [--points 1 1000 100000] [--repeats 7] [--sides 16]

The rope is one of `strand.synthetic.random_ropes`. strand asks its capsules, the others a mesh of them with
`sides` vertices around. All answer each query by turns (A B C A B C ...), so that other work of the machine
slows all. A time is the median of the turns, without the building of search structures. The bench also prints
the greatest difference of the answers, away from the rope's ends, which are flat in the mesh.

Open3D comes with the test packages. trimesh (with rtree) and coal take part if they are installed, with at
most 200 queries a turn, as they are slow.
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
# Open3D starts as many threads as the processors that it may use when it is imported
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:THREADS])

import numpy as np  # noqa: E402
import open3d as o3d  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

import strand  # noqa: E402
from lib.results import make_parser, run_bench  # noqa: E402
from lib.tables import print_head, print_row  # noqa: E402

Array = NDArray[np.float64]
RADIUS = 0.0042  # metres: the rope's
MARGIN = 0.03  # metres around the rope's box
SPHERE = 0.01  # metres: radius of spheres that move
MAX_SLOW = 200  # queries a turn of slow peers
SINGLES = 15  # calls of a single query
PAUSE = 0.02  # seconds before each turn: peers' threads spin for a while after their work
TOUCH = 1e-6  # metres: a sphere this near has met the rope
MIN_INCIDENCE = 0.5  # cosine: rays that graze the tube are not compared
QUERIES = ("signed distance", "rays", "swept spheres")


@dataclass(frozen=True)
class Queries:
    """Points, directions of rays from them, and ends of the spheres' ways."""

    points: Array
    directions: Array
    ends: Array


Ask = Callable[[Queries], Array]


def make_rope() -> strand.Chain:
    """Return the rope."""
    return strand.Chain(strand.synthetic.random_ropes(1, 1, seed=3)[0], RADIUS)


def make_queries(chain: strand.Chain, count: int, seed: int = 0) -> Queries:
    """Return queries in and around the rope's box, with numbers that single precision holds."""
    rng = np.random.default_rng(seed)
    low, high = chain.points.min(axis=0) - MARGIN, chain.points.max(axis=0) + MARGIN
    points, ends = rng.uniform(low, high, (2, count, 3)).astype(np.float32).astype(float)
    way = ends - points
    return Queries(points, way / np.linalg.norm(way, axis=1, keepdims=True), ends)


def ask_strand(chain: strand.Chain) -> dict[str, Ask]:
    """Return strand's queries."""
    model = strand.Model((chain,), np.empty((0, 4, 4)))
    return {
        "signed distance": lambda a: model.signed_distance(a.points),
        "rays": lambda a: model.ray_hits(a.points, a.directions).distance,
        "swept spheres": lambda a: model.swept_spheres(a.points, a.ends, SPHERE).time,
    }


def ask_open3d(vertices: Array, triangles: NDArray[np.int32]) -> dict[str, Ask]:
    """Return Open3D's queries."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(vertices.astype(np.float32), triangles.astype(np.uint32))

    def distances(a: Queries) -> Array:
        return np.asarray(scene.compute_signed_distance(a.points.astype(np.float32)).numpy())

    def rays(a: Queries) -> Array:
        both = np.hstack([a.points, a.directions]).astype(np.float32)
        return np.asarray(scene.cast_rays(both)["t_hit"].numpy())

    return {"signed distance": distances, "rays": rays}


def ask_trimesh(vertices: Array, triangles: NDArray[np.int32]) -> dict[str, Ask]:
    """Return trimesh's queries."""
    import trimesh

    mesh = trimesh.Trimesh(vertices, triangles, process=False)

    def rays(a: Queries) -> Array:
        places, number, _ = mesh.ray.intersects_location(a.points, a.directions, multiple_hits=False)
        found = np.full(len(a.points), np.inf)
        found[number] = np.linalg.norm(places.reshape(-1, 3) - a.points[number], axis=1)
        return found

    return {
        "signed distance": lambda a: -trimesh.proximity.signed_distance(mesh, a.points),
        "rays": rays,
    }


def ask_coal(vertices: Array, triangles: NDArray[np.int32]) -> dict[str, Ask]:
    """Return coal's queries."""
    import coal

    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(len(triangles), len(vertices))
    mesh.addVertices(vertices)
    mesh.addTriangles(triangles)
    mesh.endModel()
    here, request = coal.Transform3s(), coal.DistanceRequest()
    dot, sphere = coal.Sphere(0.0), coal.Sphere(SPHERE)

    def distances(a: Queries) -> Array:
        found = np.empty(len(a.points))
        for i, point in enumerate(a.points):
            result = coal.DistanceResult()
            found[i] = coal.distance(mesh, here, dot, coal.Transform3s(np.eye(3), point), request, result)
        return found

    def sweeps(a: Queries) -> Array:
        # coal's Python has no continuous collision: conservative advancement steps by the distance
        found = np.full(len(a.points), np.inf)
        for i, (start, end) in enumerate(zip(a.points, a.ends, strict=True)):
            length, gone = float(np.linalg.norm(end - start)), 0.0
            while gone <= length:
                place = coal.Transform3s(np.eye(3), start + (gone / length) * (end - start))
                distance = coal.distance(mesh, here, sphere, place, request, coal.DistanceResult())
                if distance < TOUCH:
                    found[i] = gone / length
                    break
                gone += distance
        return found

    return {"signed distance": distances, "swept spheres": sweeps}


def time_queries(ask: Ask, queries: Queries) -> tuple[float, Array]:
    """Return the seconds of a call, with a single query the median of several, and the answers."""
    time.sleep(PAUSE)
    times = []
    for _ in range(SINGLES if len(queries.points) == 1 else 1):
        start = time.perf_counter()
        answer = ask(queries)
        times.append(time.perf_counter() - start)
    return statistics.median(times), answer


def compare_answers(
    query: str, answer: Array, expected: Array, chain: strand.Chain, queries: Queries
) -> float:
    """Return the greatest difference of answers, micrometres, away from the flat ends."""
    model = strand.Model((chain,), np.empty((0, 4, 4)))
    length = np.linalg.norm(queries.ends - queries.points, axis=1) if query == "swept spheres" else 1.0
    where = queries.points
    if query == "signed distance":
        # inside, the mesh's distance differs where strands touch
        compared = expected > 0
    else:
        compared = np.isfinite(answer) & np.isfinite(expected) & (expected > 0)
        ahead = np.where(compared, expected * length, 0.0)
        where = queries.points + ahead[:, None] * queries.directions
        # a grazing ray is ill-posed
        s = model.nearest(where)
        out = (where - s.point) / np.maximum(s.distance, 1e-12)[:, None]
        compared &= (out * queries.directions).sum(axis=1) < -MIN_INCIDENCE
    s = model.nearest(where).s
    compared &= (s > 3 * RADIUS) & (s < chain.length - 3 * RADIUS)
    with np.errstate(invalid="ignore"):  # both answers are infinite: the rays meet nothing
        differences = np.abs(answer - expected) * length
    return float(np.nanmax(differences[compared], initial=0.0)) * 1e6


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--points", type=int, nargs="+", default=[1, 1000, 100_000], help="queries in a call")
    parser.add_argument("--repeats", type=int, default=7, help="turns (default: 7)")
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
            print(f"{name} is skipped: {', '.join(missing)} not installed")
        else:
            peers[name] = make(vertices, triangles)
    print(f"{len(chain.points)} nodes, {chain.length:.2f} m, {len(triangles)} triangles, {THREADS} threads\n")
    for query in QUERIES:
        asks: dict[str, Any] = {name: peer[query] for name, peer in peers.items() if query in peer}
        print(f"\n{query}: microseconds for each query, and queries in a second\n")
        print_head("queries in a call", *asks, "greatest difference, µm")
        for count in arguments.points:
            cells, differences = measure_query(query, asks, count, chain, arguments.repeats)
            print_row(count, *cells, differences)
    return 0


def measure_query(
    query: str, asks: dict[str, Ask], count: int, chain: strand.Chain, repeats: int
) -> tuple[list[str], str]:
    """Return the times of one kind of query, and the greatest differences of the answers."""
    times: dict[str, list[float]] = {name: [] for name in asks}
    differences: dict[str, float] = {name: 0.0 for name in asks if name != "strand"}
    for ask in asks.values():
        ask(make_queries(chain, 1))  # some build their search structures at the first call
    for turn in range(repeats):
        queries = make_queries(chain, count, seed=turn)
        few = make_queries(chain, min(count, MAX_SLOW), seed=turn)
        expected = {len(q.points): asks["strand"](q) for q in (queries, few)}
        for name, ask in asks.items():
            mine = few if name in ("trimesh", "coal") else queries
            took, answer = time_queries(ask, mine)
            times[name].append(took / len(mine.points))
            if name != "strand":
                off = compare_answers(query, answer, expected[len(mine.points)], chain, mine)
                differences[name] = max(differences[name], off)
    medians = {name: statistics.median(each) for name, each in times.items()}
    cells = [f"{1e6 * t:.3g} ({1.0 / t:,.0f})" for t in medians.values()]
    return cells, ", ".join(f"{name} {off:.0f}" for name, off in differences.items())


if __name__ == "__main__":
    run_bench(main)
