"""Write the licences of all code in a wheel's extension to LICENSE-THIRD-PARTY.

python packaging/licences.py

Where a crate has a choice of licences, MIT is taken. cargo finds the crates of all systems. Rust's standard
library has the licences that come with the toolchain. Each text appears once, with the names of its owners.
cargo-about and cargo-bundle-licenses skip the standard library and the linker's code.
"""

from __future__ import annotations

import html
import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
WRITTEN = ROOT / "LICENSE-THIRD-PARTY"
LINE = "=" * 80
HEAD = """\
Licences of third parties

The extension module of the wheels has compiled code of these crates, some of them on some systems alone,
and of Rust's standard library. Made by packaging/licences.py.

"""
STANDARD = f"{LINE}\nRust's standard library"
# crates in it on Linux, macOS or Windows: lib*.rlib of the toolchain
IN_STANDARD = (
    "addr2line",
    "adler2",
    "cfg-if",
    "gimli",
    "hashbrown",
    "libc",
    "memchr",
    "miniz_oxide",
    "object",
    "rustc-demangle",
    "windows-link",
    "windows-sys",
    "windows-targets",
)
# code that zig adds as a linker
ZIG = "Compiler's routines of Zig, in wheels that it linked: MIT"
UNWIND = "LLVM's libunwind, in wheels that Zig linked: Apache-2.0 WITH LLVM-exception"


def run(*command: str) -> str:
    """Return the output of a command."""
    return subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout


def run_cargo(*arguments: str) -> str:
    """Return the output of cargo about the crate with its bindings."""
    return run("cargo", *arguments, "--locked", "--features", "python")


def list_compiled_crates() -> list[dict]:
    """Return the metadata of crates whose code a wheel may hold: no macros, none of tests or the build."""
    edges = ("--edges", "normal,no-proc-macro", "--target", "all")
    lines = run_cargo("tree", *edges, "--prefix", "none", "--format", "{p}").splitlines()
    inside = {(name, version.removeprefix("v")) for name, version, *_ in map(str.split, filter(None, lines))}
    packages = json.loads(run_cargo("metadata", "--format-version", "1"))["packages"]
    found = [crate for crate in packages if crate["source"] and (crate["name"], crate["version"]) in inside]
    return sorted(found, key=lambda crate: (crate["name"], crate["version"]))


def choose_texts(files: dict[str, str], which: str) -> list[str]:
    """Choose the texts of licences among files by their names: those of MIT alone if there are any."""
    texts = {name: text for name, text in files.items() if re.match(r"licen[cs]e|copying|notice", name, re.I)}
    mit = [text for name, text in texts.items() if "mit" in name.lower()]
    if not texts:
        raise SystemExit(f"licences.py: {which}: no file with a licence")
    return mit or list(texts.values())


def format_sections(owned: list[tuple[str, list[str]]], where: str = "") -> str:
    """Return each text once, under the names of its owners."""
    owners: dict[str, list[str]] = {}
    shown: dict[str, str] = {}
    for owner, texts in owned:
        for text in texts:
            key = " ".join(text.split())
            lines = [line.rstrip() for line in text.expandtabs(4).strip("\n").splitlines()]
            shown.setdefault(key, "\n".join(lines))
            owners.setdefault(key, []).append(owner)
    return "".join(f"{LINE}\n{where}{', '.join(names)}\n\n{shown[key]}\n\n" for key, names in owners.items())


def describe_crates() -> str:
    """Return the first part: the list of crates and their texts."""
    crates = list_compiled_crates()
    lines = "".join(f"  {crate['name']} {crate['version']}: {crate['license']}\n" for crate in crates)
    owned = []
    for crate in crates:
        folder = Path(crate["manifest_path"]).parent
        files = {
            path.name: path.read_text(encoding="utf-8")
            for path in sorted(folder.iterdir())
            if path.is_file() and path.suffix in ("", ".md", ".txt", ".0")
        }
        name = f"{crate['name']} {crate['version']}"
        owned.append((name, choose_texts(files, name)))
    return HEAD + lines + "\n" + format_sections(owned)


def describe_standard_library() -> str:
    """Return the second part: licences of the standard library, of its crates, and of the linker's code."""
    version = run("rustc", "--version").split()[1]
    folder = Path(run("rustc", "--print", "sysroot").strip(), "share", "doc", "rust")
    own = (folder / "COPYRIGHT-library.html").read_text(encoding="utf-8")
    # the library's own page lacks the crates of its backtraces
    packages = (own + (folder / "COPYRIGHT.html").read_text(encoding="utf-8")).split("<h3>📦 ")[1:]
    texts = {
        path.stem: path.read_text(encoding="utf-8").strip() for path in (folder / "licenses").glob("*.txt")
    }
    mit = texts["MIT"][texts["MIT"].index("Permission is hereby") :]
    own = own[own.index("In-tree files</h2>") : own.index("<h3>📦 ")]
    rights = dict.fromkeys(re.findall(r"<b>Copyright:</b>\s*(.+?)\s*</p>", own))
    owned = []
    for crate in IN_STANDARD:
        package = next(package for package in packages if re.match(rf"{crate}-\d", package))
        notices = re.findall(r"<summary><code>(.+?)</code></summary>\s*<pre>(.*?)</pre>", package, re.DOTALL)
        files = {title: html.unescape(text) for title, text in notices}
        owned.append((crate, choose_texts(files, crate)))
    return (
        f"{STANDARD} {version}: MIT OR Apache-2.0\n\n"
        + "".join(f"Copyright: {html.unescape(right)}\n" for right in rights)
        + f"\n{mit}\n\n"
        + f"{LINE}\nTables of Unicode, in Rust's standard library\n\n{texts['Unicode-3.0']}\n\n"
        + format_sections(owned, "in Rust's standard library: ")
        + f"{LINE}\n{ZIG}\n\nCopyright (c) Zig contributors\n\n{mit}\n\n"
        + f"{LINE}\n{UNWIND}\n\n{texts['Apache-2.0']}\n\n{texts['LLVM-exception']}\n"
    )


def main() -> int:
    WRITTEN.write_text(describe_crates() + describe_standard_library(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
