"""The package's public names, and how its values print themselves."""

from __future__ import annotations

import doctest
import importlib
import subprocess
import sys
import types
from pathlib import Path

import numpy as np
import pytest

import strand
from shared.ropes import R, draw_circle
from strand.geometry.curve import Curve

PACKAGE = Path(strand.__file__).parent
EXAMPLES = [path for path in sorted(PACKAGE.rglob("*.py")) if ">>>" in path.read_text(encoding="utf-8")]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_in_docstrings_run(path):
    module = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
    result = doctest.testmod(importlib.import_module(module))
    assert result.attempted > 0
    assert result.failed == 0


def test_only_public_names_are_shown():
    assert dir(strand) == sorted(strand.__all__)
    assert [name for name in dir(strand) if name.startswith("_")] == ["__version__"]
    modules = [name for name in dir(strand) if isinstance(getattr(strand, name), types.ModuleType)]
    assert modules == ["batch", "config", "export", "figures", "msgs", "synthetic"]


@pytest.mark.parametrize("name", [name for name in strand.__all__ if name != "__version__"])
def test_every_public_name_says_what_it_is(name):
    shown = getattr(strand, name)
    assert shown.__doc__
    assert len(shown.__doc__.splitlines()[0]) > 20 or len(shown.__doc__.splitlines()) > 1


def test_names_are_imported_when_they_are_first_used():
    program = (
        "import sys, strand; before = {name for name in sys.modules if name.startswith('strand.')}; "
        "assert before == {'strand._core'}, before; assert strand.Box.__module__ == 'strand.views.box'; "
        "assert 'strand.reconstruction' not in sys.modules; "
        "from strand import *; assert all(name in globals() for name in strand.__all__)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
    with pytest.raises(AttributeError, match="module 'strand' has no attribute 'Ropes'"):
        _ = strand.Ropes


def model_of(count, **more):
    chains = tuple(draw_circle(0.05, 40, False) for _ in range(count))
    return strand.Model(chains, np.tile(np.eye(4), (2, 1, 1)), **more)


@pytest.mark.parametrize("count", [0, 1, 3, 12])
def test_a_model_shows_itself_in_a_few_lines(count):
    shown = repr(model_of(count, method="default", confidence=0.876)).splitlines()
    assert shown[0] == f"Model(chains: {count}, views: 2, method: default, confidence: 0.87, warnings: 0)"
    assert shown[1 : 1 + min(count, 3)] == [f"  {draw_circle(0.05, 40, False)!r}"] * min(count, 3)
    assert shown[1 + min(count, 3) :] == ([f"  and {count - 3} more"] if count > 3 else [])
    assert all(len(line) < 110 for line in shown)
    assert "confidence: unknown" in repr(model_of(1))


def test_chains_and_curves_show_themselves_in_one_line():
    chain = strand.Chain(np.linspace([0.0, 0.0, 0.0], [0.4, 0.0, 0.0], 101), R)
    assert repr(chain) == "Chain(400.0 mm, radius 4.20 mm, open, 101 nodes)"
    assert repr(draw_circle(0.05, 40, True)).endswith("radius 4.00 mm, closed, 40 nodes)")
    curve = Curve.whole(np.linspace([0.0, 0.0, 0.0], [0.13, 0.0, 0.0], 14))
    assert repr(curve) == "Curve(110.0 mm, 14 control points)"


def test_a_model_of_many_nodes_prints_itself_shortly(paper_model):
    assert len(repr(paper_model).splitlines()) == 2
    assert len(repr(paper_model)) < 250
    assert len(repr(paper_model.chains[0].curve).splitlines()) == 1
