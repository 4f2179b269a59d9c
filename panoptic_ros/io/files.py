"""Reading and writing whole files: atomic, with errors that name the file."""
from __future__ import annotations

import gzip
import json
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from panoptic_ros.errors import DataError, EnvironmentProblem

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # in C, if PyYAML has it: eight times as quick

@contextmanager
def file_errors(path: Path, doing: str) -> Iterator[None]:
    """Turn the operating system's errors into one clear line.

    Raises:
        DataError: if the file is not there or is a folder.
        EnvironmentProblem: on permissions, a full disk and other trouble of the machine.
    """
    try:
        yield
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError) as error:
        raise DataError(f"cannot {doing} {path}: {error.strerror}") from None
    except OSError as error:
        raise EnvironmentProblem(f"cannot {doing} {path}: {error.strerror or error}") from None


def malformed(where: Path | str, error: Exception) -> DataError:
    """In one line, what is wrong with a document whose keys or values are not those of its format."""
    what = f"{error.args[0]!r} is missing" if isinstance(error, KeyError) else f"a value is wrong: {error}"
    return DataError(f"{where}: {what}; docs/formats.md says what must be there")


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that replaces it if all goes well and vanishes if not."""
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.part{''.join(path.suffixes)}")
    with file_errors(path, "write"):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file whole or not at all."""
    with atomic_path(Path(path)) as temporary:
        temporary.write_bytes(data)


def write_json(path: Path, document: Any, indent: int | None = None) -> None:
    """Write JSON, gzipped if the name ends in .gz; equal documents give equal bytes."""
    data = (json.dumps(document, indent=indent, allow_nan=False) + "\n").encode()
    write_bytes(path, gzip.compress(data, mtime=0) if path.name.endswith(".gz") else data)


def known(document: Any) -> Any:
    """The same with null in place of figures that are not known (NaN), which JSON does not have."""
    if isinstance(document, dict):
        return {key: known(value) for key, value in document.items()}
    if isinstance(document, list | tuple):
        return [known(value) for value in document]
    return None if isinstance(document, float) and not math.isfinite(document) else document


def read_bytes(path: Path) -> bytes:
    """The content of a file."""
    with file_errors(Path(path), "read"):
        return Path(path).read_bytes()


def read_json(path: Path) -> Any:
    """Read JSON, gzipped or not.

    Raises:
        DataError: if it is no JSON.
    """
    data = read_bytes(path)
    try:
        if data[:2] == b"\x1f\x8b":
            data = gzip.decompress(data)
        return json.loads(data)
    except (ValueError, EOFError, OSError) as error:
        raise DataError(f"{path} is not valid JSON: {error}") from None


def read_yaml(path: Path) -> Any:
    """Read YAML.

    Raises:
        DataError: if it is no YAML.
    """
    try:
        return yaml.load(read_bytes(path).decode(), _Loader)
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        where = getattr(error, "problem_mark", None)
        raise DataError(f"{path} is not valid YAML{f', line {where.line + 1}' if where else ''}") from None
