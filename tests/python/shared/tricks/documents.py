"""Tricks with JSON and TOML: models, frames, pinholes, scenes and configurations."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import strand
from shared.scene_files import CAMERA, save_png
from shared.tricks import MAX_BYTES, Trick, try_files
from strand.io.intrinsics import read_intrinsics
from strand.io.models import load_frames
from strand.support.files import JSON_BYTES, TOML_BYTES

Make = Callable[[], bytes]
_DEEP = b".".join([b"a"] * 29)  # a key of many parts


def list_tricks() -> list[Trick]:
    """Return the tricks with JSON and TOML."""
    json = (64 << 20) + 2 * JSON_BYTES
    values, texts, few = _list_values(MAX_BYTES - 64), _list_texts(MAX_BYTES - 64), _list_few(MAX_BYTES)
    toml, more = _list_toml(TOML_BYTES - 64), _list_tables(TOML_BYTES - 64)
    pinholes = {
        "words": lambda: b"1 " * 32_000,
        "digits": lambda: b"1" * 65_000,
        "lists": lambda: b"[" * 60_000,
        "numbers": lambda: b'{"fx":1,"fy":1,"cx":1,"cy":' + b"9" * 60_000 + b"}",
    }
    return [
        *(
            try_files(
                f"json of {name}",
                makes,
                "a.json",
                lambda file: strand.load_model(file, max_bytes=MAX_BYTES),
                seconds=5.0,
            )
            for name, makes in {"many values": values, "long texts": texts, "values that fit": few}.items()
        ),
        *(
            try_files(
                f"json of {name} at the default limit", {name: make}, "a.json", strand.load_model, most=json
            )
            for name, make in {
                **_list_few(JSON_BYTES),
                "a text": _list_texts(JSON_BYTES - 64)["a text"],
                "many lists": _list_values(JSON_BYTES - 64)["lists"],
            }.items()
        ),
        try_files(
            "json of frames",
            {"lists": lambda: _repeat(b"[],", JSON_BYTES), "blanks": lambda: b" " * JSON_BYTES},
            "a.jsonl",
            lambda file: list(load_frames(file)),
            most=json,
        ),
        Trick(
            "toml of many views of one file",
            _write_views,
            lambda folder: strand.load_scene(folder, max_bytes=MAX_BYTES),
            seconds=5.0,
        ),
        try_files("pinholes of long words", pinholes, "a.json", read_intrinsics, seconds=5.0),
        *(
            try_files(f"toml of {name}", makes, "scene.toml", read, seconds=5.0)
            for name, makes, read in (
                ("a configuration", toml, strand.config.load),
                ("values", toml, lambda file: strand.load_scene(file, max_bytes=MAX_BYTES)),
                ("tables", more, lambda file: strand.load_scene(file, max_bytes=MAX_BYTES)),
            )
        ),
    ]


def _write_views(folder: Path) -> None:
    """Write a depth image, and a scene that has it again and again, as its own mask too."""
    save_png(folder / "a.png")
    view = "[[view]]\nfile = 'a.png'\nmask = 'a.png'\nturntable_deg = 0\n"
    head = CAMERA + "[turntable]\nangles_deg = [0, 0, 0]\norigin = [0, 0, 0]\n"
    (folder / "scene.toml").write_text(head + view * ((TOML_BYTES - len(head)) // len(view)))


def _repeat(one: bytes, size: int) -> bytes:
    """Return a list of one entry, which comes again and again, of JSON."""
    return b"[" + one * ((size - 8) // len(one)) + b"0]"


def _list_values(size: int) -> dict[str, Make]:
    """Return JSON of so many bytes whose values take far more."""
    return {
        "lists": lambda: _repeat(b"[],", size),
        "objects": lambda: _repeat(b"{},", size),
        "short lists": lambda: _repeat(b"[0],", size),
        "objects of one key": lambda: _repeat(b'{"a":0},', size),
        "numbers": lambda: _repeat(b"0.5,", size),
        "digits": lambda: _repeat(b"0,", size),
        "texts": lambda: _repeat(b'"ab",', size),
        "wide texts": lambda: _repeat('"\U0001f600",'.encode(), size),
        "keys": lambda: b"{" + b",".join(b'"%x":0' % i for i in range(size // 12)) + b"}",
        "one key": lambda: b"{" + b'"a":0,' * (size // 6 - 2) + b'"a":0}',
        "nested lists": lambda: b"[" * size,
        "nested objects": lambda: b'{"a":' * (size // 5),
        "chains": lambda: b'{"format":"strand model","chains":' + _repeat(b"{},", size - 64) + b"}",
    }


def _list_texts(size: int) -> dict[str, Make]:
    """Return JSON of so many bytes and few values."""
    return {
        "a number": lambda: b"9" * size,
        "a fraction": lambda: b"0." + b"9" * (size - 2),
        "numbers": lambda: _repeat(b"9" * 4300 + b",", size),
        "a text": lambda: b'"' + b"a" * (size - 2) + b'"',
        "a text and a wide letter": lambda: b'"' + b"a" * (size - 6) + '\U0001f600"'.encode(),
        "a text of a wide letter": lambda: b'"' + b"a" * (size - 14) + b'\\ud83d\\ude00"',
        "escapes of a wide letter": lambda: b'"' + b"\\n" * (size // 2 - 7) + b'\\ud83d\\ude00"',
        "blanks": lambda: b" " * size,
        "utf-16": lambda: ("[" + "9" * (size // 2 - 2) + "]").encode("utf-16-le"),
    }


def _list_few(size: int) -> dict[str, Make]:
    """Return JSON whose values just fit into the memory that files of so many bytes have."""
    return {
        "lists": lambda: _repeat(b"[],", size // 22),
        "objects of one key": lambda: _repeat(b'{"a":0},', size // 28),
        "numbers": lambda: _repeat(b"0.5,", size // 27 * 4),
        "keys": lambda: b"{" + b",".join(b'"%x":0' % i for i in range(size // 100)) + b"}",
        "a text and lists": lambda: b'["' + b"a" * (size // 2) + b'",' + _repeat(b"[],", size // 44) + b"]",
        "a text of a wide letter": lambda: b'"' + b"a" * (size // 5 - 32) + b'\\ud83d\\ude00"',
        "escapes of a wide letter": lambda: b'"' + b"\\n" * (size // 10 - 32) + b'\\ud83d\\ude00"',
        "a wide letter": lambda: '"\U0001f600'.encode() + b"a" * (size // 5 - 32) + b'"',
    }


def _list_toml(size: int) -> dict[str, Make]:
    """Return TOML of so many bytes with long or many values."""
    return {
        "lists": lambda: b"a=[" + b"[]," * (size // 3) + b"]",
        "objects": lambda: b"a=[" + b"{}," * (size // 3) + b"]",
        "nested lists": lambda: b"a=" + b"[" * size,
        "nested objects": lambda: b"a=" + b"{a=" * (size // 3),
        "digits": lambda: b"a=" + b"9" * size,
        "hexadecimal digits": lambda: b"a=0x" + b"f" * size,
        "a fraction": lambda: b"a=0." + b"9" * size,
        "digits apart": lambda: b"a=1" + b"_1" * (size // 2),
        "a text": lambda: b"a='" + b"b" * size + b"'",
        "escapes": lambda: b'a="' + b"\\n" * (size // 2) + b'"',
        "quotes": lambda: b'a="""' + b'""a' * (size // 3) + b'"""',
        "comments": lambda: b"#\n" * (size // 2) + b"a=0",
        "dates": lambda: b"a=[" + b"1979-01-01," * (size // 11) + b"]",
        "a pose": lambda: b"[[view]]\nfile='a'\npose=[" + b"[]," * (size // 3) + b"]",
        "more than fits": lambda: b"#" * (TOML_BYTES + 1),
    }


def _list_tables(size: int) -> dict[str, Make]:
    """Return TOML of so many bytes with many keys."""
    return {
        "tables": lambda: b"[[a]]\n" * (size // 6),
        "keys": lambda: b"\n".join(b"%x=0" % i for i in range(size // 9)),
        "parts of keys": lambda: b"\n".join(b"a%x.b.c=0" % i for i in range(size // 13)),
        "tables in tables": lambda: b"\n".join(b"[a%x.b.c]" % i for i in range(size // 13)),
        "nested keys": lambda: b"\n".join(_DEEP + b".%x=0" % i for i in range(size // 70)),
        "nested tables": lambda: b"\n".join(b"[" + _DEEP + b".%x]" % i for i in range(size // 70)),
        "nested keys of a nested table": lambda: (
            b"[" + _DEEP + b"]\n" + b"\n".join(_DEEP + b".%x=0" % i for i in range(size // 70))
        ),
        "keys in an object": lambda: b"a={" + b",".join(b"%x=0" % i for i in range(size // 9)) + b"}",
        "views": lambda: b"[[view]]\nfile='a'\n" * (size // 18),
    }
