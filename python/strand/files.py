"""Files written whole or not at all, and JSON and TOML read with one kind of error."""

from __future__ import annotations

import contextlib
import errno
import importlib
import json
import math
import os
import secrets
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from strand._core import StrandError


class FileFormatError(StrandError, ValueError):
    """A file is truncated, or not what it should be."""


def extra(module: str) -> Any:
    """Import a package that only some uses need.

    Parameters
    ----------
    module : str
        Its import name, such as "PIL.Image".

    Raises
    ------
    ImportError
        If it is not installed; the message says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = {"PIL": "pillow"}.get(module.split(".")[0], module.split(".")[0])
        raise ImportError(f'{package} is needed here: pip install ".[cli]" installs it') from error


def write_bytes(path: str | os.PathLike[str], data: bytes) -> None:
    """Write a file whole or not at all.

    The bytes go to a temporary file in the same folder, which then takes the file's place: nobody
    sees half a file, and one that exists stays as it was if anything fails.

    Parameters
    ----------
    path : str or path-like
        The file; one that exists is replaced, through links.
    data : bytes
        Its content.

    Raises
    ------
    OSError
        If the file cannot be written, or `path` is something other than a file.
    """
    target = Path(path).resolve()
    if target.exists() and not target.is_file():
        raise OSError(errno.EINVAL, "Not a regular file", str(path))
    temporary = target.with_name(f".strand-{secrets.token_hex(8)}.tmp")
    try:
        with open(temporary, "xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    except BaseException as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        if isinstance(error, OSError):  # said of the temporary file
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def plain(value: Any) -> Any:
    """Return a value in JSON's types.

    Parameters
    ----------
    value : object
        Frozen dataclasses become objects with a key for each field, arrays and tuples lists, NaN null.
    """
    if is_dataclass(value):
        return {entry.name: plain(getattr(value, entry.name)) for entry in fields(value)}
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def write_json(path: str | os.PathLike[str], value: object) -> None:
    """Write a JSON file whole or not at all.

    Parameters
    ----------
    path : str or path-like
        The file; one that exists is replaced.
    value : object
        Dictionaries, lists, text, numbers, booleans and None.

    Raises
    ------
    TypeError
        If something in `value` has no form in JSON.
    ValueError
        If a number is NaN or infinite, which JSON cannot say.
    OSError
        If the file cannot be written.
    """
    try:
        text = json.dumps(value, allow_nan=False)
    except ValueError as error:
        raise ValueError(f"{path}: cannot be written as JSON ({error})") from error
    write_bytes(path, text.encode() + b"\n")


def read_json(path: str | os.PathLike[str]) -> Any:
    """Read a JSON file.

    Parameters
    ----------
    path : str or path-like
        The file.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    strand.FileFormatError
        If it is truncated or not JSON, or says NaN or Infinity.
    """
    data = Path(path).read_bytes()
    try:
        return json.loads(data, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"{path}: truncated, or not JSON ({error})") from error


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is not JSON")


def read_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read a TOML file.

    Parameters
    ----------
    path : str or path-like
        The file.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    strand.FileFormatError
        If it is truncated or not TOML.
    ImportError
        On Python 3.10, which has no TOML reader, if the package tomli is not installed.
    """
    toml = extra("tomllib" if sys.version_info >= (3, 11) else "tomli")
    data = Path(path).read_bytes()
    try:
        content: dict[str, Any] = toml.loads(data.decode())
    except ValueError as error:
        raise FileFormatError(f"{path}: truncated, or not TOML ({error})") from error
    return content
