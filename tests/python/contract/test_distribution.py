"""Only pyproject.toml has the distribution's name, and only Cargo.toml the version."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import cut
import pytest

import strand
from strand.support.files import read_toml

ROOT = Path(__file__).resolve().parents[3]
PROJECT = read_toml(ROOT / "pyproject.toml")["project"]
VERSION = read_toml(ROOT / "Cargo.toml")["package"]["version"]
NAME = PROJECT["name"]
KINDS = ("*.md", "*.py", "*.toml", "*.yml", "*.yaml", "*.sh", "*.txt")
ROOMS = ("python", "tests", "benches", "docs", "examples", "packaging", "ros", ".github")
# places that change with the name: requirements, names of wheels, metadata of the installed package
CARRIES = r"""(?x) \b{0}\[[a-z,]+\] | \b{0}-\S*\.(whl|tar)
    | pip3?\s+install\s([^`\n]*['"\s])?{0}(['"\s=<>`]|$)
    | (version|distribution|requires|files)\(["']{0}["']\)"""


def find_places(name):
    """Return the lines outside of pyproject.toml that carry a distribution's name."""
    files = [path for room in ROOMS for kind in KINDS for path in (ROOT / room).rglob(kind)]
    files += [path for kind in KINDS for path in ROOT.glob(kind)]
    skipped = {Path(__file__).resolve(), ROOT / "pyproject.toml"}
    lines = (
        (path, line)
        for path in files
        if path.resolve() not in skipped
        for line in path.read_text(encoding="utf-8").splitlines()
    )
    pattern = re.compile(CARRIES.format(re.sub("[-_.]+", "[-_.]+", name)))
    return [f"{path.relative_to(ROOT)}: {line.strip()}" for path, line in lines if pattern.search(line)]


@pytest.mark.parametrize(
    "line",
    [
        'pip install "rope[cli]"',
        "pip install rope",
        "pip install --upgrade 'rope>=1'",
        "dist/rope-0.1.0-cp310.whl",
        "dist/rope-*.whl",
        "rope-VERSION-cp310-abi3.whl",
        'metadata.version("rope")',
    ],
)
def test_lines_that_carry_a_name(line):
    assert re.search(CARRIES.format("rope"), line)


@pytest.mark.parametrize(
    "line", ["import rope", "chains[0]", "rope demo", 'pip install ".[rope]"', "rope.json"]
)
def test_lines_that_carry_no_name(line):
    assert not re.search(CARRIES.format("rope"), line)


def test_the_name_is_in_one_file():
    assert find_places(NAME) == []
    assert [place for place in find_places("maturin") if place.startswith("CONTRIBUTING.md")] != []


def test_one_command_changes_the_name(tmp_path):
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (command,) = re.findall(r"`(sed [^`]+)`", (ROOT / "RELEASING.md").read_text(encoding="utf-8"))
    command = command.replace("strand", NAME).replace("NEW", "other-name")
    subprocess.run(command, shell=True, cwd=tmp_path, check=True)
    changed = read_toml(tmp_path / "pyproject.toml")
    expected = read_toml(ROOT / "pyproject.toml")
    expected["project"]["name"] = "other-name"
    for entries in expected["project"]["optional-dependencies"].values():
        entries[:] = [entry.replace(f"{NAME}[", "other-name[") for entry in entries]
    assert changed == expected


def test_extras_that_name_others_name_this_distribution():
    listed = [entry for entries in PROJECT["optional-dependencies"].values() for entry in entries]
    selves = [entry for entry in listed if re.match(r"[\w-]+\[[\w,]+\]$", entry)]
    assert len(selves) == 4
    for entry in selves:
        name, groups = re.fullmatch(r"([\w-]+)\[([\w,]+)\]", entry).groups()
        assert name == NAME
        assert set(groups.split(",")) <= set(PROJECT["optional-dependencies"])


@pytest.mark.parametrize("name", [None, "strand", "other-name"])
def test_errors_about_missing_packages_have_the_installed_name(name, tmp_path):
    (tmp_path / "strand").symlink_to(Path(strand.__file__).parent)
    if name is not None:
        information = tmp_path / f"{name.replace('-', '_')}-1.0.dist-info"
        information.mkdir()
        (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (information / "RECORD").write_text("strand/__init__.py,,\nstrand/support/extras.py,,\n")
    code = f"""
import sys
sys.path[:] = {[str(tmp_path), *sys.path]!r}
from strand.support.extras import import_extra
sys.modules["plotly"] = None
import_extra("plotly.graph_objects")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    wanted = "." if name is None else name
    assert f'plotly is needed here: pip install "{wanted}[report]" installs it' in done.stderr


def test_the_version_is_that_of_the_crate():
    assert strand.__version__ == VERSION
    assert "version" in PROJECT["dynamic"]
    lock = (ROOT / "Cargo.lock").read_text(encoding="utf-8")
    assert f'name = "strand"\nversion = "{VERSION}"\n' in lock
    assert f"\nversion: {VERSION}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    installed = [
        metadata.version(name) for name in metadata.packages_distributions().get("strand", []) if name == NAME
    ]
    assert set(installed) <= {VERSION}


def list_headings(root):
    return re.findall(r"^## (.+)$", (root / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)


def test_the_changelog_has_the_version():
    assert list_headings(ROOT)[0] == "Unreleased"
    assert re.fullmatch(rf"{re.escape(VERSION)} - \d{{4}}-\d\d-\d\d", list_headings(ROOT)[1])


@pytest.fixture
def copied(tmp_path):
    """Return a folder with the files that a release changes, and a change to release."""
    for name in ("CHANGELOG.md", "Cargo.toml", "Cargo.lock", "CITATION.cff"):
        shutil.copy(ROOT / name, tmp_path)
    text = (tmp_path / "CHANGELOG.md").read_text(encoding="utf-8")
    changed = re.sub(r"(?<=## Unreleased\n\n)(Nothing yet\.)?", "- A change.\n", text, count=1)
    (tmp_path / "CHANGELOG.md").write_text(changed, encoding="utf-8")
    return tmp_path


def test_a_release_is_cut_in_all_places(copied):
    cut.cut(copied, "12.3.4", "2030-01-02")
    assert list_headings(copied)[:3] == ["Unreleased", "12.3.4 - 2030-01-02", list_headings(ROOT)[1]]
    assert "Unreleased\n\nNothing yet.\n\n## 12.3.4 - 2030-01-02\n\n- A change.\n" in (
        copied / "CHANGELOG.md"
    ).read_text(encoding="utf-8")
    assert read_toml(copied / "Cargo.toml")["package"]["version"] == "12.3.4"
    assert 'name = "strand"\nversion = "12.3.4"\n' in (copied / "Cargo.lock").read_text(encoding="utf-8")
    said = (copied / "CITATION.cff").read_text(encoding="utf-8")
    assert "\nversion: 12.3.4\ndate-released: 2030-01-02\n" in said
    with pytest.raises(ValueError, match="nothing is under Unreleased"):
        cut.cut(copied, "12.3.5", "2030-01-03")


def test_the_crates_version_can_be_cut_until_the_changelog_has_it(copied):
    crate = copied / "Cargo.toml"
    crate.write_text(crate.read_text("utf-8").replace(f'"{VERSION}"', '"9.10.0"', 1), encoding="utf-8")
    with pytest.raises(
        ValueError, match=r"expected 9\.10\.0, which is in Cargo\.toml, or a higher one, got 9\.9\.1"
    ):
        cut.cut(copied, "9.9.1", "2030-01-02")
    cut.cut(copied, "9.10.0", "2030-01-02")
    assert list_headings(copied)[1] == "9.10.0 - 2030-01-02"


@pytest.mark.parametrize(
    ("version", "reason"),
    [
        ("1.2", "expected three numbers"),
        ("00.01.007", "without leading zeros"),
        ("0.2.٣", "expected three numbers"),
        ("0.0.9", "or a higher one, got 0.0.9"),
        (VERSION, "exists already"),
    ],
)
def test_a_release_is_refused_before_anything_is_written(version, reason, copied):
    before = {path.name: path.read_bytes() for path in copied.iterdir()}
    with pytest.raises(ValueError, match=reason):
        cut.cut(copied, version, "2030-01-02")
    assert {path.name: path.read_bytes() for path in copied.iterdir()} == before
