"""Print the compiled parts of a wheel as a CycloneDX document, equal for equal commits and targets.

python packaging/sbom.py TARGET

Maturin's own list has the crates of all systems and of the build, the time, and folders of the machine.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def run_cargo(*arguments: str) -> str:
    """Return the output of cargo about the crate with its bindings."""
    command = ["cargo", *arguments, "--locked", "--features", "python"]
    return subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout


def list_compiled_crates(target: str) -> set[tuple[str, str]]:
    """Return names and versions of crates whose code a wheel holds: no macros, none of tests or the build."""
    tree = run_cargo(
        *("tree", "--edges", "normal,no-proc-macro", "--target", target, "--prefix", "none"),
        *("--format", "{p}"),
    )
    pairs = (line.split()[:2] for line in tree.splitlines() if line)
    return {(name, version.removeprefix("v")) for name, version in pairs}


def read_checksums() -> dict[tuple[str, str], str]:
    """Return the SHA-256 of each crate's archive, from Cargo.lock."""
    found = {}
    for entry in (ROOT / "Cargo.lock").read_text().split("[[package]]")[1:]:
        values = dict(line.split(" = ", 1) for line in entry.splitlines() if " = " in line)
        if "checksum" in values:
            key = (json.loads(values["name"]), json.loads(values["version"]))
            found[key] = json.loads(values["checksum"])
    return found


def make_component(crate: dict, checksum: str | None) -> dict:
    """Return a crate as a component."""
    reference = f"pkg:cargo/{crate['name']}@{crate['version']}"
    made = {
        "type": "library",
        "bom-ref": reference,
        "name": crate["name"],
        "version": crate["version"],
        "description": crate["description"],
        "licenses": [{"expression": crate["license"].replace("/", " OR ")}],
        "purl": reference,
    }
    if checksum:
        made["hashes"] = [{"alg": "SHA-256", "content": checksum}]
    if crate["repository"]:
        made["externalReferences"] = [{"type": "vcs", "url": crate["repository"]}]
    return made


def list_toolchain() -> list[dict]:
    """Return the components that Rust and zig put into every wheel."""
    rust = subprocess.run(["rustc", "--version"], check=True, stdout=subprocess.PIPE, text=True).stdout
    zig = re.search(r"^ziglang==(\S+)", (ROOT / "packaging" / "requirements.txt").read_text(), re.MULTILINE)
    parts = [
        (f"pkg:generic/rust-std@{rust.split()[1]}", "Rust's standard library", "MIT OR Apache-2.0"),
        (
            f"pkg:pypi/ziglang@{zig[1]}",
            "Compiler's routines of zig, and LLVM's libunwind",
            "MIT AND Apache-2.0 WITH LLVM-exception",
        ),
    ]
    return [
        {
            "type": "library",
            "bom-ref": reference,
            "name": reference.split("/")[1].split("@")[0],
            "version": reference.split("@")[1],
            "description": description,
            "licenses": [{"expression": licence}],
            "purl": reference,
        }
        for reference, description, licence in parts
    ]


def find_needed(node: dict, references: dict[str, str]) -> list[str]:
    """Return the references of the compiled crates that a crate needs at run time."""
    return sorted(
        references[link["pkg"]]
        for link in node["deps"]
        if link["pkg"] in references and any(kind["kind"] is None for kind in link["dep_kinds"])
    )


def make_document(target: str) -> dict:
    """Return the whole document of a target."""
    metadata = json.loads(run_cargo("metadata", "--format-version", "1", "--filter-platform", target))
    inside = list_compiled_crates(target)
    crates = {
        crate["id"]: crate for crate in metadata["packages"] if (crate["name"], crate["version"]) in inside
    }
    sums = read_checksums()
    components = {
        name: make_component(crate, sums.get((crate["name"], crate["version"])))
        for name, crate in crates.items()
    }
    root = components.pop(metadata["resolve"]["root"])
    given = list_toolchain()
    always = [part["bom-ref"] for part in given]
    references = {name: f"pkg:cargo/{crate['name']}@{crate['version']}" for name, crate in crates.items()}
    dependencies = [
        {"ref": references[node["id"]], "dependsOn": [*find_needed(node, references), *always]}
        for node in metadata["resolve"]["nodes"]
        if node["id"] in references
    ]
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "component": root,
            "properties": [{"name": "cdx:rustc:sbom:target", "value": target}],
        },
        "components": sorted([*components.values(), *given], key=lambda each: each["bom-ref"]),
        "dependencies": sorted(dependencies, key=lambda each: each["ref"]),
    }


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    print(json.dumps(make_document(sys.argv[1]), indent=1))
