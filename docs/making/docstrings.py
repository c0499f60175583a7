"""Teach griffe, which reads docstrings for the site, the habits of strand."""

from __future__ import annotations

import inspect
import re
from functools import reduce
from typing import Any

import griffe

import strand._core

CHOICES = re.compile(r"^(\s*\w+ : )\{(.+)\}", re.MULTILINE)


class Habits(griffe.Extension):
    """Kernels are documented in Rust, choices in braces are words, lazy properties are attributes."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Take a kernel's docstring from the compiled module; keep griffe from reading types as code."""
        if obj.docstring is None and re.match(r"strand\._core\.[^_]", obj.path):
            compiled = reduce(getattr, obj.path.split(".")[2:], strand._core)
            if said := inspect.getdoc(compiled):
                obj.docstring = griffe.Docstring(said, parent=obj)
        if obj.docstring is not None:
            said = CHOICES.sub(r"\1one of \2", obj.docstring.value)
            obj.docstring.value = said.replace("path-like", "path_like")

    def on_module_members(self, *, mod: griffe.Module, **_: Any) -> None:
        """Show functions that the stub has only overloads of by the first, which has all defaults."""
        for name, overloads in mod.overloads.items():
            if name not in mod.members:
                mod.set_member(name, overloads[0])

    def on_class_members(self, *, cls: griffe.Class, **_: Any) -> None:
        """Find compiled classes' arguments, and make attributes of functions that are worked out once."""
        if "__new__" in cls.members:
            cls.set_member("__init__", cls.members["__new__"])
        for name, member in list(cls.members.items()):
            if isinstance(member, griffe.Function) and any(
                str(decorator.value) == "lazy_property" for decorator in member.decorators
            ):
                attribute = griffe.Attribute(
                    name, annotation=member.returns, docstring=member.docstring, parent=cls
                )
                attribute.labels = {"property"}
                cls.set_member(name, attribute)
