"""The ament packages are whole: manifests, build files, launch file and parameters agree with the sources."""

from __future__ import annotations

import ast
import re
import runpy
import sys
from pathlib import Path
from types import ModuleType
from unittest.mock import MagicMock
from xml.etree import ElementTree

import pytest

from lib.ros_stub import run_node
from strand_ros.parameters import PARAMETERS

ROS = Path(__file__).resolve().parents[3] / "ros"
MESSAGES, NODE = ROS / "strand_msgs", ROS / "strand_ros"


def read_dependencies(package):
    root = ElementTree.parse(package / "package.xml").getroot()
    assert root.findtext("name") == package.name
    assert [one.text for one in root.findall("license")] == ["MIT", "Apache-2.0"]
    return {one.text for one in root if one.tag.endswith("depend")}


def find_imports(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module.split(".")[0]


def test_every_message_is_built():
    built = re.findall(r'"(msg/\w+\.msg)"', (MESSAGES / "CMakeLists.txt").read_text(encoding="utf-8"))
    assert built == [f"msg/{path.name}" for path in sorted((MESSAGES / "msg").iterdir())]


def test_manifests_name_what_is_used():
    words = " ".join(path.read_text(encoding="utf-8") for path in (MESSAGES / "msg").iterdir())
    used = set(re.findall(r"\b(\w+)/[A-Z]\w+", words))
    assert used == {"builtin_interfaces", "geometry_msgs", "std_msgs"} <= read_dependencies(MESSAGES)
    sources = [*(NODE / "strand_ros").glob("*.py"), *(NODE / "launch").glob("*.py")]
    imported = {name for path in sources for name in find_imports(path)} - set(sys.stdlib_module_names)
    known = read_dependencies(NODE)
    assert imported - {"numpy", "strand", "strand_ros"} == known - {"python3-numpy"}


def test_the_setup_installs_every_file(monkeypatch):
    given = {}
    monkeypatch.chdir(NODE)
    tools = ModuleType("setuptools")
    tools.setup = given.update
    monkeypatch.setitem(sys.modules, "setuptools", tools)
    runpy.run_path("setup.py")
    installed = {name for _, names in given["data_files"] for name in names}
    patterns = ("package.xml", "launch/*.py", "config/*", "resource/*")
    assert installed == {path.relative_to(NODE).as_posix() for one in patterns for path in NODE.glob(one)}
    assert given["version"] == ElementTree.parse("package.xml").getroot().findtext("version")
    assert given["entry_points"] == {"console_scripts": ["ropes = strand_ros.node:main"]}


@pytest.fixture
def launched(monkeypatch):
    """Return the arguments of the node that the launch file starts, with a stand-in for launch."""
    modules = {
        "launch": ["LaunchDescription"],
        "launch.actions": ["DeclareLaunchArgument"],
        "launch.substitutions": ["LaunchConfiguration", "PathJoinSubstitution"],
        "launch_ros": [],
        "launch_ros.actions": ["Node"],
        "launch_ros.parameter_descriptions": ["ParameterValue"],
        "launch_ros.substitutions": ["FindPackageShare"],
    }
    for name, contents in modules.items():
        module = ModuleType(name)
        module.__dict__.update({content: MagicMock() for content in contents})
        monkeypatch.setitem(sys.modules, name, module)
    runpy.run_path(str(NODE / "launch" / "ropes.launch.py"))["generate_launch_description"]()
    return sys.modules["launch_ros.actions"].Node.call_args.kwargs


def test_the_launch_file_names_every_topic_of_the_node(launched):
    with run_node(use_color=True, use_mask=True, use_occluders=True) as (bus, _):
        topics = {*bus.subscribed, *bus.published}
    assert {name for name, _ in launched["remappings"]} == topics - {"/tf", "/tf_static", "/diagnostics"}
    assert (launched["package"], launched["executable"], launched["name"]) == (
        "strand_ros",
        "ropes",
        "strand",
    )


def test_the_file_of_parameters_has_parameters_of_the_node():
    text = (NODE / "config" / "ropes.yaml").read_text(encoding="utf-8")
    names = re.findall(r"^    (\w+): \S", text, re.MULTILINE)
    assert len(names) > 3
    assert set(names) <= {one.name for one in PARAMETERS}
