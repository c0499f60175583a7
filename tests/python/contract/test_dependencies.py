"""Licences, duplicates and sources of crates follow `deny.toml`; wheels and packages name their licences."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import licences
import pytest

from strand.support.files import read_toml

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def rules():
    return read_toml(ROOT / "deny.toml")


@pytest.fixture(scope="module")
def crates():
    """Return all crates of Cargo.lock but strand, for any system and all features."""
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--all-features"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
    found = [crate for crate in json.loads(done.stdout)["packages"] if crate["source"] is not None]
    assert len(found) > 50
    return found


def is_allowed(expression, allowed):
    """Tell whether some licences meet an SPDX expression."""
    words = re.findall(r"\(|\)|[^\s()/]+(?:\s+WITH\s+[^\s()/]+)?|/", expression)
    meaning = {"OR": "or", "/": "or", "AND": "and", "(": "(", ")": ")"}
    return eval(" ".join(meaning.get(word, str(" ".join(word.split()) in allowed)) for word in words))


@pytest.mark.parametrize(
    ("expression", "met"),
    [
        ("MIT", True),
        ("GPL-3.0", False),
        ("MIT OR GPL-3.0", True),
        ("MIT/Apache-2.0", True),
        ("MIT AND GPL-3.0", False),
        ("(MIT OR GPL-3.0) AND Zlib", True),
        ("Apache-2.0 WITH LLVM-exception", False),
    ],
)
def test_licence_expressions(expression, met):
    assert is_allowed(expression, {"MIT", "Zlib"}) is met


def test_licences_are_those_of_the_list(rules, crates):
    allowed = set(rules["licenses"]["allow"])
    assert not [
        f"{crate['name']}: {crate['license']}"
        for crate in crates
        if not is_allowed(crate["license"] or "none", allowed)
    ]


def test_no_crate_comes_twice_but_those_of_the_list(rules, crates):
    skipped = {entry["crate"] for entry in rules["bans"]["skip"]}
    kept = [crate["name"] for crate in crates if f"{crate['name']}@{crate['version']}" not in skipped]
    assert len(kept) == len(crates) - len(skipped), "a crate that is not there any more is in the list"
    assert not {name for name in kept if kept.count(name) > 1}


def test_crates_come_from_the_registry_of_the_list(rules, crates):
    accepted = {f"registry+{url}" for url in rules["sources"]["allow-registry"]}
    assert {crate["source"] for crate in crates} == accepted


def test_wheels_have_the_licences_of_all_compiled_code():
    written = licences.WRITTEN.read_text(encoding="utf-8")
    crates, standard = written.split(licences.STANDARD)
    assert crates == licences.describe_crates(), "run python packaging/licences.py"
    assert {"nalgebra", "pyo3", "rayon"} <= set(re.findall(r"^  ([\w-]+) [\d.]+: ", crates, re.MULTILINE))
    assert [name for name in licences.IN_STANDARD if not re.search(rf"library: .*\b{name}\b", standard)] == []
    project = read_toml(ROOT / "pyproject.toml")["project"]
    assert licences.WRITTEN.name in project["license-files"]


def test_mit_is_chosen_among_licences():
    files = {"LICENSE-MIT": "m", "LICENSE-APACHE": "a", "README.md": "r"}
    assert licences.choose_texts(files, "x 1.0") == ["m"]
    assert licences.choose_texts({"LICENSE": "l", "NOTICE": "n"}, "x 1.0") == ["l", "n"]
    with pytest.raises(SystemExit, match=r"x 1\.0: no file with a licence"):
        licences.choose_texts({"README.md": "r"}, "x 1.0")


def test_packages_name_their_licence():
    text = (ROOT / "pyproject.toml").read_text()
    lines = re.findall(r'^    "[a-z[\]-]+>=.*$', text[: text.index("test = [")], re.MULTILINE)
    assert len(lines) >= 8
    for line in lines:
        assert re.search(r"# (BSD|MIT|Apache|PSF|ISC)[^:]*: ", line), line


def test_workflows_name_actions_by_commit():
    """A tag can be moved to other code."""
    workflows = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
    lines = [line for path in workflows for line in path.read_text().splitlines() if "uses:" in line]
    assert len(lines) >= 8
    for line in lines:
        assert re.fullmatch(r"\s*(- )?uses: [\w./-]+@[0-9a-f]{40}  # v\d+\.\d+\.\d+", line), line
