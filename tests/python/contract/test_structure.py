"""The layout, from the sources alone: no circles of imports, few rooms, short files, pages within limits.

A room is a file or folder directly in `python/strand` or `rust/src`. An arrow is a pair of rooms: the first
imports the second. Each room stands on a floor, and imports rooms of lower floors only. The compiled module
lies below all rooms of Python, and imports of it are no arrows.
"""

from __future__ import annotations

import ast
import re
from collections import Counter, defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = ROOT / "python" / "strand"
CRATE = ROOT / "rust" / "src"
RECONSTRUCTION = PACKAGE / "reconstruction"

# rooms by floor, the lowest first
FLOORS = {
    PACKAGE: (
        "support _core.pyi",
        "geometry views",
        "config.py export synthetic",
        "ropes",
        "io reconstruction report",
        "figures.py msgs.py tracking",
        "batch",
        "__init__.py",
        "cli",
        "__main__.py",
    ),
    CRATE: (
        "error simd",
        "checks parallel",
        "geometry",
        "index knots",
        "clouds icp normals published queries",
        "images track tubes",
        "lib python",
    ),
}
MAX_FLOORS = 10  # in each language
MAX_ARROWS = {PACKAGE: 68, CRATE: 80}  # between rooms
MAX_ROOT_MODULES = 6  # files of Python at the root of the package
MAX_ROOT_FOLDERS = 12  # folders there
MAX_LINES = 450  # of a source file
LONG_FILES = {PACKAGE / "_core.pyi", PACKAGE / "config.py", PACKAGE / "ropes" / "model.py"}  # one idea each
MAX_PUBLIC_NAMES = 47  # in `strand.__all__`
MAX_TUPLE = 2  # constants in one assignment
MAX_PAGE_LINES = {
    "ARCHITECTURE.md": 160,
    "CHANGELOG.md": 70,
    "README.md": 90,
    "docs/batch.md": 170,
    "docs/benchmarks.md": 140,
    "docs/method.md": 220,
    "docs/promises.md": 130,
}
MAX_DOCUMENTATION_LINES = 3560  # of all pages at the root and in docs/
SHARED_STEMS = {"__init__", "method"}  # modules that several folders of reconstruction/ may have

Graph = dict[str, set[str]]


# Imports of Python.


def list_modules(folder: Path) -> list[Path]:
    return sorted([*folder.rglob("*.py"), *folder.rglob("*.pyi")])


def find_module(dotted: str) -> Path | None:
    """Return the file of a module of strand, None if the name is none."""
    place = PACKAGE.parent.joinpath(*dotted.split("."))
    for path in (place.with_suffix(".py"), place.with_suffix(".pyi"), place / "__init__.py"):
        if path.is_file():
            return path
    return None


def find_imports(path: Path) -> Iterator[Path]:
    """Yield the modules of strand that one imports, in functions and for types alone too."""
    package = ["strand", *path.relative_to(PACKAGE).parent.parts]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            start = package[: len(package) + 1 - node.level] if node.level else []
            base = ".".join([*start, *([node.module] if node.module else [])])
            whole = [f"{base}.{alias.name}" for alias in node.names]
            # a name in a module, or a module in a folder
            names = [name if find_module(name) else base for name in whole]
        else:
            continue
        found = (find_module(name) for name in names if name.split(".")[0] == "strand")
        yield from (target for target in found if target is not None and target.suffix == ".py")


@cache
def read_python() -> Graph:
    return {
        path.relative_to(PACKAGE).as_posix(): {
            target.relative_to(PACKAGE).as_posix() for target in find_imports(path)
        }
        for path in list_modules(PACKAGE)
    }


# Imports of Rust.


class Crate:
    """The crate's modules, the paths that each names, and what each hands on with `pub use`."""

    def __init__(self, folder: Path) -> None:
        self.modules: dict[tuple[str, ...], str] = {}
        self.paths: dict[tuple[str, ...], set[tuple[str, ...]]] = {}
        self.aliases: dict[tuple[str, ...], dict[str, tuple[str, ...]]] = {}
        texts = {}
        for path in sorted(folder.rglob("*.rs")):
            name = path.relative_to(folder).as_posix()
            module = () if name == "lib.rs" else tuple(name.removesuffix(".rs").split("/"))
            module = module[:-1] if module[-1:] == ("mod",) else module
            texts[module] = strip_source(path.read_text(encoding="utf-8"))
            self.modules[module] = name
        # modules of tests and fuzzing are not part of the layout
        for module, text in list(texts.items()):
            for child in re.findall(r"#\[cfg\((?:test|any\(fuzzing, test\))\)\] (?:pub )?mod (\w+);", text):
                for name in [name for name in texts if name[: len(module) + 1] == (*module, child)]:
                    del self.modules[name], texts[name]
        for module, text in texts.items():
            self.aliases[module] = {}
            self.paths[module] = set()
            for public, tree in re.findall(r"\b(pub(?:\([^)]*\))? )?use ([^;]+);", text):
                for given, path in expand_use(tree):
                    self.paths[module].add(self.absolute(module, path))
                    if public:
                        self.aliases[module][given] = self.absolute(module, path)
            rest = re.sub(r"\buse [^;]+;", "", text)
            children = {name[-1] for name in self.modules if name[:-1] == module and name}
            for path in re.findall(r"(?<![\w:])(?:\w+::)+\w+", rest):
                first = path.split("::")[0]
                if first in {"crate", "super", "self", *children}:
                    self.paths[module].add(self.absolute(module, tuple(path.split("::"))))

    def absolute(self, module: tuple[str, ...], path: tuple[str, ...]) -> tuple[str, ...]:
        here = () if path[0] == "crate" else module
        for number, part in enumerate(path):
            if part == "super":
                here = here[:-1]
            elif part not in ("crate", "self"):
                return here + path[number:]
        return here

    def resolve(self, path: tuple[str, ...], depth: int = 0) -> tuple[str, ...]:
        """Return the module in which a path's item is made."""
        assert depth < 10, path
        here: tuple[str, ...] = ()
        for number, part in enumerate(path):
            if (*here, part) in self.modules:
                here = (*here, part)
            elif part in self.aliases[here] and self.aliases[here][part] != path:
                return self.resolve(self.aliases[here][part] + path[number + 1 :], depth + 1)
            else:
                break
        return here

    def graph(self) -> Graph:
        return {
            self.modules[module]: {self.modules[self.resolve(path)] for path in paths}
            - {self.modules[module]}
            for module, paths in self.paths.items()
        }


def strip_source(text: str) -> str:
    """Return a source without comments, strings and tests, with single spaces."""
    text = re.sub(r'//[^\n]*|/\*(?s:.*?)\*/|"(?:\\.|[^"\\])*"|\'(?:\\.|[^\'\\])\'', " ", text)
    text = re.sub(r"\s+", " ", text)
    while match := re.search(r"#\[cfg\(test\)\] mod \w+ \{", text):
        depth, end = 1, match.end()
        while depth:
            depth += {"{": 1, "}": -1}.get(text[end], 0)
            end += 1
        text = text[: match.start()] + text[end:]
    return text


def expand_use(tree: str) -> list[tuple[str, tuple[str, ...]]]:
    """Return what a `use` declares: each name and its path."""
    tree = tree.strip()
    if tree.endswith("}"):
        start, inside = tree[:-1].split("{", 1)
        parts, depth = [""], 0
        for letter in inside:
            depth += {"{": 1, "}": -1}.get(letter, 0)
            if letter == "," and depth == 0:
                parts.append("")
            else:
                parts[-1] += letter
        return [pair for part in parts if part.strip() for pair in expand_use(start + part.strip())]
    path, _, given = (part.strip() for part in tree.partition(" as "))
    words = tuple(word for word in path.split("::") if word not in ("self", "*") or path.startswith("self"))
    return [(given or words[-1], words)]


@cache
def read_rust() -> Graph:
    return Crate(CRATE).graph()


# Graphs.


def find_circles(graph: Graph) -> list[list[str]]:
    """Return groups of nodes that reach each other, each in order of their names."""

    def reach(node: str) -> set[str]:
        seen: set[str] = set()
        todo = [node]
        while todo:
            for following in graph.get(todo.pop(), ()):
                if following not in seen:
                    seen.add(following)
                    todo.append(following)
        return seen

    reached = {node: reach(node) for node in graph}
    circles = {
        tuple(sorted(other for other in reached[node] if node in reached.get(other, ())))
        for node in graph
        if node in reached[node]
    }
    return [list(circle) for circle in sorted(circles)]


def group_rooms(graph: Graph, folder: str) -> Graph:
    """Return the imports between what is directly in a folder, "" for the root: files and folders."""
    depth = len(folder.split("/")) if folder else 0

    def child(name: str) -> str | None:
        if folder and not name.startswith(f"{folder}/"):
            return None
        # a module and the folder of its submodules are one room
        return name.split("/")[depth].removesuffix(".rs")

    grouped: Graph = defaultdict(set)
    for name, targets in graph.items():
        if (here := child(name)) is not None:
            grouped[here] |= {there for target in targets if (there := child(target)) not in (None, here)}
    return dict(grouped)


def list_folders(graph: Graph) -> list[str]:
    """Return the folders of a tree of files, the root as ""."""
    parents = {"/".join(name.split("/")[:depth]) for name in graph for depth in range(name.count("/") + 1)}
    return sorted(parents)


# What must hold: each gives what is wrong.


def check_file_circles(graph: Graph) -> list[str]:
    return [" → ".join(circle) for circle in find_circles(graph)]


def check_folder_circles(graph: Graph) -> list[str]:
    return [
        f"{folder or 'root'}: {' → '.join(circle)}"
        for folder in list_folders(graph)
        for circle in find_circles(group_rooms(graph, folder))
    ]


def check_floors(graph: Graph, floors: tuple[str, ...]) -> list[str]:
    rooms = group_rooms(graph, "")
    floor = {room: number for number, names in enumerate(floors) for room in names.split()}
    wrong = [f"{room} has no floor" for room in rooms if room not in floor]
    wrong += [f"{room} is no room" for room in floor if room not in rooms]
    wrong += [f"{len(floors)} floors"] if len(floors) > MAX_FLOORS else []
    return wrong or [
        f"{room} imports {other} of floor {floor[other] + 1} from floor {floor[room] + 1}"
        for room, others in rooms.items()
        for other in others
        if floor[other] >= floor[room]
    ]


def check_arrows(graph: Graph, most: int) -> list[str]:
    count = sum(map(len, group_rooms(graph, "").values()))
    return [f"{count} arrows between rooms, at most {most}"] if count > most else []


def check_root() -> list[str]:
    files = [path.name for path in PACKAGE.iterdir() if path.suffix in (".py", ".pyi")]
    folders = [path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name != "__pycache__"]
    wrong = [f"files: {files}"] if len(files) > MAX_ROOT_MODULES else []
    return wrong + ([f"folders: {folders}"] if len(folders) > MAX_ROOT_FOLDERS else [])


def list_sources() -> list[Path]:
    folders = [
        ROOT / name for name in ("python", "rust", "tests", "benches", "docs", "examples", "packaging", "ros")
    ]
    return [path for folder in folders for kind in ("py", "pyi", "rs") for path in folder.rglob(f"*.{kind}")]


def check_file_lengths() -> list[str]:
    counts = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in list_sources()}
    return [
        f"{path.relative_to(ROOT)}: {count} lines"
        for path, count in sorted(counts.items())
        if count > MAX_LINES and path not in LONG_FILES
    ]


def is_constant(node: ast.expr) -> bool:
    return isinstance(node, ast.Name) and re.fullmatch(r"_*[A-Z][A-Z0-9_]*", node.id) is not None


def check_packed_constants() -> list[str]:
    wrong = []
    for path in list_sources():
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".rs" or not re.search(r"^ *\(?_*[A-Z][A-Z0-9_]*, ", text, re.MULTILINE):
            continue
        tree = ast.parse(text)
        scopes = [tree, *(node for node in tree.body if isinstance(node, ast.ClassDef))]
        for node in (node for scope in scopes for node in scope.body if isinstance(node, ast.Assign)):
            for target in node.targets:
                names = target.elts if isinstance(target, ast.Tuple) else []
                if len(names) > MAX_TUPLE and all(map(is_constant, names)):
                    wrong.append(f"{path.relative_to(ROOT)}:{node.lineno}: {ast.unparse(target)}")
    return wrong


def check_stems() -> list[str]:
    stems = Counter(path.stem for path in list_modules(RECONSTRUCTION))
    return sorted(stem for stem, count in stems.items() if count > 1 and stem not in SHARED_STEMS)


def list_pages() -> list[Path]:
    return [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]


def check_rows() -> list[str]:
    wrong = []
    for path in [*list_pages(), *sorted((ROOT / "benches").rglob("*.md"))]:
        lines = path.read_text(encoding="utf-8").splitlines()
        # heads may come again, in other tables
        rows = [
            line
            for line, below in zip(lines, [*lines[1:], ""], strict=True)
            if line.startswith("|")
            and not re.match(r"\|[ :|-]+$", line)
            and not re.match(r"\|[ :|-]+$", below)
        ]
        wrong += [f"{path.relative_to(ROOT)}: {row}" for row, count in Counter(rows).items() if count > 1]
    return wrong


def check_public_names() -> list[str]:
    tree = ast.parse((PACKAGE / "__init__.py").read_text(encoding="utf-8"))
    (names,) = (
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    )
    assert len(names) > 20
    return [f"{len(names)} public names, at most {MAX_PUBLIC_NAMES}"] if len(names) > MAX_PUBLIC_NAMES else []


def check_page_lengths() -> list[str]:
    counts = {
        path.relative_to(ROOT).as_posix(): len(path.read_text("utf-8").splitlines()) for path in list_pages()
    }
    wrong = [
        f"{page}: {counts[page]} lines, at most {most}"
        for page, most in MAX_PAGE_LINES.items()
        if counts[page] > most
    ]
    total = sum(counts.values())
    return wrong + ([f"documentation: {total} lines"] if total > MAX_DOCUMENTATION_LINES else [])


CHECKS = {
    "circles of files in Python": lambda: check_file_circles(read_python()),
    "circles of folders in Python": lambda: check_folder_circles(read_python()),
    "floors in Python": lambda: check_floors(read_python(), FLOORS[PACKAGE]),
    "arrows in Python": lambda: check_arrows(read_python(), MAX_ARROWS[PACKAGE]),
    "circles of files in Rust": lambda: check_file_circles(read_rust()),
    "circles of folders in Rust": lambda: check_folder_circles(read_rust()),
    "floors in Rust": lambda: check_floors(read_rust(), FLOORS[CRATE]),
    "arrows in Rust": lambda: check_arrows(read_rust(), MAX_ARROWS[CRATE]),
    "files and folders at the root": check_root,
    "long files": check_file_lengths,
    "packed constants": check_packed_constants,
    "stems within reconstruction": check_stems,
    "rows of tables": check_rows,
    "public names": check_public_names,
    "length of the documentation": check_page_lengths,
}


@pytest.mark.parametrize("check", CHECKS)
def test_the_layout_holds(check):
    assert CHECKS[check]() == []


def test_imports_are_found():
    """In functions, for types alone, through folders; in trees, paths and names that are handed on."""
    assert read_python()["views/pose.py"] == {"support/checks.py"}
    assert "__init__.py" not in read_python()["views/view.py"]
    assert len(read_python()) > 150
    assert "parallel.rs" in read_rust()["icp.rs"]
    assert expand_use("a::{self, b::{c, d as e}, f}") == [
        ("a", ("a",)),
        ("c", ("a", "b", "c")),
        ("e", ("a", "b", "d")),
        ("f", ("a", "f")),
    ]
    assert strip_source('a // b\n"c" /* d */ #[cfg(test)]\nmod tests { {} } e') == "a  e"


def test_circles_and_floors_are_found():
    graph = {"a/x": {"b/y"}, "b/y": {"c"}, "b/z": {"a/x"}, "c": set()}
    assert find_circles(graph) == []
    rooms = group_rooms(graph, "")
    assert find_circles(rooms) == [["a", "b"]]
    assert check_floors({"a/x": {"b"}, "b": set()}, ("b", "a")) == []
    assert check_floors({"a/x": {"b"}, "b": set()}, ("a", "b")) == ["a imports b of floor 2 from floor 1"]
    assert check_floors({"a/x": {"b"}, "b": set()}, ("b",)) == ["a has no floor"]
