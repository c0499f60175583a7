"""Every public function answers alike under strict error states, and names the argument that is wrong."""

from __future__ import annotations

import inspect
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from shared.public import files, kernels, ropes, synthetic, views
from shared.public.surface import Call, find_public, list_parameters
from shared.public.wrong import describe, is_optional, list_wrong
from strand import StrandError

PUBLIC = find_public()
# what looks wrong and means something: a pattern of the names of function and argument, and one of values
ACCEPTED = {
    r".* bounds": r".*\binf\b.*",
    r"(Chain|Curve)\..* (s|parameter)": r"(array\()?\[\[.*",
    r"(Chain\.)?knot crossings": r"\[\]",
    r"(Chain|HarnessNode|Model) confidence|Alternative probability": r"nan",
    r"Tracker\.update views": r"\[None\]",
    r"Netlist wires": r".*None.*",
    r"TubeFit\.replace sigma": r"nan|-?inf",
    r"batch\.run recordings": r"'x'",
    r"fit_tubes reference": r"None",
    r"icp tolerance": r"inf",
    r"synthetic\.render_depth table": r"True",
}


@pytest.fixture(scope="module")
def calls(tmp_path_factory) -> dict[str, Call]:
    """Return a valid call of each public function."""
    folder = tmp_path_factory.mktemp("public")
    parts = [module.list_calls(folder) for module in (kernels, ropes, views, files, synthetic)]
    return {name: call for part in parts for name, call in part.items()}


@contextmanager
def be_strict() -> Iterator[None]:
    """Let NumPy raise whatever it can, and make errors of warnings."""
    with np.errstate(all="raise"), warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def test_every_public_function_is_called_with_all_its_arguments(calls):
    assert sorted(set(PUBLIC) ^ set(calls)) == []
    for name, call in calls.items():
        given = {argument for variant in call.variants for argument in variant}
        assert given == set(list_parameters(PUBLIC[name])), name


@pytest.mark.parametrize("name", PUBLIC)
def test_answers_are_the_same_when_numpy_raises_and_warnings_are_errors(name, calls):
    call = calls[name]
    for variant in call.variants:
        usual = list(describe(call.function(**variant)))
        with be_strict():
            assert list(describe(call.function(**variant))) == usual


@pytest.mark.parametrize("name", PUBLIC)
def test_wrong_arguments_are_named(name, calls):
    parameters = list_parameters(PUBLIC[name])
    problems = []
    for variant in calls[name].variants:
        for argument, value in variant.items():
            for wrong in list_wrong(value):
                if not is_accepted(name, parameters[argument], wrong):
                    said = call_wrongly(calls[name], {**variant, argument: wrong}, argument)
                    problems += [f"{argument} = {show(wrong)}: {said}"] if said else []
    assert problems == []


def is_accepted(name: str, parameter: inspect.Parameter, wrong: Any) -> bool:
    """Tell whether what looks wrong means something to an argument."""
    if wrong is None and is_optional(parameter):
        return True
    place = f"{name} {parameter.name}"
    return any(re.fullmatch(at, place) and re.fullmatch(what, show(wrong)) for at, what in ACCEPTED.items())


def show(wrong: Any) -> str:
    """Return a wrong value as short text; Python refuses to write long whole numbers."""
    try:
        return " ".join(repr(wrong).split())[:100]
    except ValueError:
        return "huge"


def call_wrongly(call: Call, given: dict[str, Any], argument: str) -> str | None:
    """Return what is wrong with how a call refuses an argument; None if it names it."""
    try:
        with be_strict():
            list(describe(call.function(**given)))
    except (TypeError, ValueError) as error:
        # pyo3 puts the name of an argument that it refuses in a note
        said = str(error) + " ".join(getattr(error, "__notes__", ()))
        named = re.search(rf"(?<!\w){argument}(?!\w)", said)
        return None if named and not isinstance(error, StrandError) else f"{type(error).__name__}: {said}"
    except BaseException as error:
        return f"{type(error).__name__}: {error}"
    return "accepted"
