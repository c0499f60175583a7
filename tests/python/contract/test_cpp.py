"""The example in C++ compiles, and gets from its process what Python gets."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import strand

FOLDER = Path(__file__).resolve().parents[3] / "examples" / "cpp"
SCENE = strand.synthetic.scene("arc", views=2)

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the example uses pipes of POSIX")


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    made = tmp_path_factory.mktemp("cpp") / "ropes"
    flags = ["-std=c++17", "-O1", "-Wall", "-Wextra", "-Werror"]
    subprocess.run(["c++", *flags, FOLDER / "ropes.cpp", "-o", made], check=True)
    return made


def ask(program, folder, images, server=FOLDER / "serve_ropes.py", more=()):
    """Run the program on depth images."""
    (fx, _, cx), (_, fy, cy), _ = SCENE.intrinsics.tolist()
    height, width = SCENE.depth[0].shape
    for k, image in enumerate(images):
        image.astype(np.uint16).tofile(folder / f"{k}.raw")
    camera = map(str, (width, height, fx, fy, cx, cy, SCENE.depth_scale))
    files = [folder / f"{k}.raw" for k in range(len(images))]
    command = [program, sys.executable, server, str(SCENE.radius), *camera, *files, *more]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


def test_ropes_come_as_from_python_and_errors_end_nothing(program, tmp_path):
    images = [SCENE.depth[0], np.zeros_like(SCENE.depth[0]), SCENE.depth[1]]
    done = ask(program, tmp_path, images)
    assert (done.returncode, done.stderr) == (0, "")
    first, error, second = done.stdout.splitlines()
    assert re.fullmatch(r"no answer: views: no view has a point; .+", error)
    previous = None
    for depth, line in ((SCENE.depth[0], first), (SCENE.depth[1], second)):
        view = strand.View.from_depth(depth, SCENE.intrinsics, depth_scale=SCENE.depth_scale)
        previous = strand.reconstruct([view], radius=SCENE.radius, previous=previous)
        (chain,) = previous.chains
        count, *place, radius, confidence = map(float, re.findall(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", line))
        assert count == len(chain.points)
        np.testing.assert_allclose(place, chain.points[0], atol=1e-6)
        np.testing.assert_allclose([radius, confidence], [chain.radius, chain.confidence], atol=1e-5)


def test_a_process_that_ends_is_an_error(program, tmp_path):
    done = ask(program, tmp_path, [SCENE.depth[0]], server=tmp_path / "nowhere.py")
    assert done.returncode == 1
    assert "strand has ended; see its standard error" in done.stderr


def test_short_and_missing_files_are_named_and_the_next_is_asked(program, tmp_path):
    done = ask(program, tmp_path, [SCENE.depth[0][:100], SCENE.depth[0]], more=["nowhere.raw"])
    assert (done.returncode, done.stderr) == (0, "")
    short, rope, missing = done.stdout.splitlines()
    height, width = SCENE.depth[0].shape
    wanted = f"expected {2 * width * height} bytes for {width} x {height} pixels, got"
    assert short.endswith(f"0.raw: {wanted} {2 * width * 100}")
    assert re.match(r"\d+ nodes, first at ", rope)
    assert missing == f"no answer: nowhere.raw: {wanted} no file"


def serve(request, *words):
    """Return the status, the answers and the standard error of the server."""
    server = [sys.executable, FOLDER / "serve_ropes.py", *words]
    done = subprocess.run(server, input=request, capture_output=True, timeout=60)
    return done.returncode, done.stdout.decode().splitlines(), done.stderr


@pytest.mark.parametrize(
    ("request_", "reason"),
    [
        (b"4 4 1 1 1 1 1\n12", "expected 32 bytes of pixels, the input ends after 2"),
        (b"100000 100000 1 1 1 1 1\n", "expected 1 to 100000000 pixels, got 100000 x 100000"),
        (b"-1 4 1 1 1 1 1\n", "expected 1 to 100000000 pixels, got -1 x 4"),
        (b"-1 -4 1 1 1 1 1\n" + bytes(8), "expected 1 to 100000000 pixels, got -1 x -4"),
        (b"\n", r"expected a line .+, got b'\\n'"),
        (b"4 4 1 1 1 1\n" + bytes(32), "expected a line .+, got b'4 4 1 1 1 1.+'"),
        (b"4 4 1 1 1 1 1 1\n" + bytes(32), "expected a line .+"),
        (b"4 4 a 1 1 1 1\n" + bytes(32), "expected a line .+"),
        (b"\xff\xfe\n" + bytes(32), "expected a line .+"),
        (b"4 4 1 1 1 1 1", "expected a line .+"),
        (b"1" * 100_000, "expected a line .+"),
    ],
)
def test_requests_after_which_none_is_found_end_the_server(request_, reason):
    status, answers, said = serve(request_, "0.004")
    assert (status, said) == (1, b"")
    (answer,) = answers
    assert re.fullmatch(f"error request: {reason}", answer)


@pytest.mark.parametrize("words", [["thin"], ["nan"], ["-1"], [], ["1", "2"]])
def test_a_wrong_radius_ends_the_server(words):
    status, answers, said = serve(b"4 4 1 1 1 1 1\n" + bytes(32), *words)
    assert (status, said) == (1, b"")
    assert answers == [f"error RADIUS: expected a positive number of metres, got {' '.join(words)!r}"]


def test_wrong_values_of_a_request_are_named_and_the_next_is_read():
    wrong = [b"4 4 0 1 1 1 1\n", b"4 4 1 1 nan 1 1\n", b"4 4 1 1 1 1 -1\n", b"4 4 1 1 1 1 1\n"]
    status, answers, said = serve(b"".join(line + bytes(32) for line in wrong), "0.004")
    assert (status, said) == (0, b"")
    for answer, name in zip(answers, ("intrinsics", "intrinsics", "depth_scale", "views"), strict=True):
        assert answer.startswith(f"error {name}: ")
