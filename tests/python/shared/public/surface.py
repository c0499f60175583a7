"""The public functions and methods, found in the package and in the pages about it."""

from __future__ import annotations

import importlib
import inspect
import re
import types
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import strand

API = Path(__file__).resolve().parents[4] / "docs" / "api"
FUNCTIONS = (types.FunctionType, types.BuiltinFunctionType, types.MethodDescriptorType)
METHODS = (classmethod, staticmethod, types.ClassMethodDescriptorType, *FUNCTIONS)

# fmt: off
ANSWERS = {
    "Contact", "Crossing", "Diagram", "EdgeMatch", "Event", "FoundRopes", "Grasp", "Grasps", "Knot",
    "Nearest", "NetEdge", "NetMatch", "NoGrasp",
    "OtherObject", "Pull", "PullPlan", "RayHits", "RopeMask", "ShapeError", "SweepHits", "Track",
    "Capsules", "IcpResult", "NextView", "Spheres", "TrackedRope", "TubeFit",
    "batch.Counts", "batch.Unit",
    "synthetic.ColorScene", "synthetic.Gripper", "synthetic.HarnessScene", "synthetic.SequenceFrame",
    "synthetic.SyntheticScene", "synthetic.SyntheticSequence", "synthetic.TrueCrossing",
}  # classes that only strand makes, of what it knows
# fmt: on


@dataclass(frozen=True)
class Call:
    """A function, and valid arguments by their names; several sets of them where some exclude others."""

    function: Callable[..., Any]
    variants: tuple[dict[str, Any], ...]

    def __init__(self, function: Callable[..., Any], *variants: dict[str, Any]) -> None:
        object.__setattr__(self, "function", function)
        object.__setattr__(self, "variants", variants)


def find_public() -> dict[str, Callable[..., Any]]:
    """Return all public functions, classes that callers make, and methods, by their names below `strand`."""
    found: dict[str, Callable[..., Any]] = {}
    named = {id(value): name for name, value in reversed([*_list_names(strand, ""), *_list_pages()])}
    for name, value in [*_list_names(strand, ""), *_list_pages()]:
        if named[id(value)] != name:
            continue
        if inspect.isclass(value) and not issubclass(value, BaseException):
            if name not in ANSWERS:
                found[name] = value
            found |= dict(_list_methods(name, value))
        elif inspect.isroutine(value):
            found[name] = value
    return found


def _list_names(module: types.ModuleType, before: str) -> Iterator[tuple[str, Any]]:
    own = [
        name for name, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__
    ]
    for name in getattr(module, "__all__", [name for name in own if name[0] != "_"]):
        value = getattr(module, name)
        if isinstance(value, types.ModuleType):
            yield from _list_names(value, f"{before}{name}.")
        else:
            yield before + name, value


def _list_pages() -> Iterator[tuple[str, Any]]:
    """Yield the names on the pages that are not names of the package itself."""
    for page in sorted(API.glob("*.md")):
        for path in re.findall(
            r"^::: strand\.(\w+\.[\w.]+)$", page.read_text(encoding="utf-8"), re.MULTILINE
        ):
            module, _, name = path.rpartition(".")
            value = getattr(importlib.import_module(f"strand.{module}"), name)
            if not isinstance(value, types.ModuleType):
                yield name, value


def _list_methods(name: str, owner: type) -> Iterator[tuple[str, Callable[..., Any]]]:
    for method in dir(owner):
        held = inspect.getattr_static(owner, method)
        first = next(base for base in owner.__mro__ if method in vars(base))
        # methods of a base are that class's; `Line` itself is on no page
        own = first is owner or (name == "Chain" and first.__module__.startswith("strand."))
        if method[0] != "_" and isinstance(held, METHODS) and own:
            yield f"{name}.{method}", getattr(owner, method)


def list_parameters(function: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    """Return a function's parameters by their names, without `self`."""
    found = dict(inspect.signature(function).parameters)
    if "changes" in found:
        # they are the fields
        return list_parameters(strand.TubeFit)
    return {name: each for name, each in found.items() if name != "self"}
