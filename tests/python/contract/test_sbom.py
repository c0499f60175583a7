"""`packaging/sbom.py` lists the compiled parts of a wheel."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import sbom

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module", params=["x86_64-unknown-linux-gnu", "aarch64-unknown-linux-gnu"])
def document(request):
    return sbom.make_document(request.param)


def test_all_compiled_parts_are_listed_and_nothing_else(document):
    names = {component["name"] for component in document["components"]}
    assert names >= {"pyo3", "numpy", "rayon", "nalgebra", "rust-std", "ziglang"}
    # of benches and tests, of the build, macros, other systems
    assert not names & {"strand", "criterion", "proptest", "cc", "syn", "thiserror-impl", "windows-link"}


def test_each_crate_has_its_licence_and_the_checksum_of_the_lock_file(document):
    lock = (ROOT / "Cargo.lock").read_text()
    for component in document["components"]:
        assert component["licenses"]
        if component["name"] not in ("rust-std", "ziglang"):
            assert component["hashes"][0]["content"] in lock


def test_dependencies_are_between_listed_parts(document):
    listed = {component["bom-ref"] for component in document["components"]}
    root = document["metadata"]["component"]["bom-ref"]
    links = {entry["ref"]: set(entry["dependsOn"]) for entry in document["dependencies"]}
    assert set(links) == {name for name in listed if name.startswith("pkg:cargo/")} | {root}
    assert set().union(*links.values()) == listed


def test_no_folder_of_this_machine_is_named(document):
    text = json.dumps(document)
    assert str(ROOT) not in text
    assert "file:" not in text
