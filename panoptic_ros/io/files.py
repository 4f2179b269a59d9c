"""Write whole files atomically; errors name the file. `loading` and `documents` read files."""

from __future__ import annotations

import gzip
import json
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from panoptic_ros.errors import DataError, EnvironmentProblem
from panoptic_ros.io.documents import read_json, read_yaml
from panoptic_ros.io.loading import file_errors, malformed, read_bytes

__all__ = [
    "atomic_path",
    "check_output",
    "check_output_folder",
    "file_errors",
    "known",
    "malformed",
    "read_bytes",
    "read_json",
    "read_yaml",
    "write_bytes",
    "write_json",
]

STEM, SUFFIXES = 100, 60  # characters of a temporary file name; file systems allow 255 bytes


def check_output(path: Path) -> Path:
    """Return the path at which a file will be written: the target, if `path` is a link.

    Callers can check the path before any work.

    Raises:
        DataError: if the path is a folder, a device, or a broken link.
        EnvironmentProblem: if nothing can be written there.
    """
    target = _target(path)
    if not target.name or target.is_dir():
        raise DataError(f"cannot write {path}: it is a folder; name a file in it")
    if target.exists() and not target.is_file():
        raise DataError(f"cannot write {path}: it is a device or a pipe; name a file")
    _check_parent(path, target)
    return target


def check_output_folder(path: Path) -> Path:
    """Return the folder into which results will be written: the target, if `path` is a link.

    Raises:
        DataError: if the path is a file, a device, the root of the file system, or a broken link.
        EnvironmentProblem: if nothing can be written there.
    """
    target = _target(path)
    if target == Path(target.anchor):
        raise DataError(f"cannot write into {path}: it is the root of the file system; name a folder in it")
    if target.exists() and not target.is_dir():
        raise DataError(f"cannot write into {path}: it is a file; name a folder")
    if target.is_dir() and not os.access(target, os.W_OK | os.X_OK):
        raise EnvironmentProblem(f"cannot write into {path}: no permission")
    _check_parent(path, target)
    return target


def _target(path: Path) -> Path:
    """Return the absolute path to write; follow links to their target."""
    with file_errors(path, "write"):
        found = Path(os.path.realpath(path) if os.path.islink(path) else os.path.abspath(path))
        try:
            os.lstat(found)
        except FileNotFoundError:
            if os.path.islink(path):
                raise DataError(
                    f"cannot write {path}: it is a link to {found}, which does not exist; remove the link"
                ) from None
        except NotADirectoryError:  # `_check_parent` reports it
            pass
    return found


def _check_parent(path: Path, target: Path) -> None:
    """Check that a file can be created next to the target."""
    with file_errors(path, "write"):
        place = next(parent for parent in target.parents if parent.exists() or parent.is_symlink())
        if not place.is_dir():
            raise NotADirectoryError(20, f"{place} is not a folder")
    if not os.access(place, os.W_OK | os.X_OK):
        raise EnvironmentProblem(f"cannot write {path}: no permission to write into {place}")


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a temporary path next to `path`; it replaces `path` on success and is removed on an error.

    If `path` is a link, its target is replaced.

    Raises:
        DataError, EnvironmentProblem: if nothing can be written there.
    """
    target = check_output(path)
    ending = "".join(target.suffixes)[-SUFFIXES:]
    temporary = target.with_name(f".{target.stem[:STEM]}.{os.getpid()}.part{ending}")
    with file_errors(path, "write"):
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            os.replace(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file completely or not at all."""
    with atomic_path(Path(path)) as temporary:
        temporary.write_bytes(data)


def write_json(path: Path, document: Any, indent: int | None = None) -> None:
    """Write JSON, gzipped if the name ends in .gz; equal documents give equal bytes."""
    data = (json.dumps(document, indent=indent, allow_nan=False) + "\n").encode()
    write_bytes(path, gzip.compress(data, mtime=0) if path.name.endswith(".gz") else data)


def known(document: Any) -> Any:
    """Return a copy in which NaN and infinite numbers are null, because JSON has no NaN."""
    if isinstance(document, dict):
        return {key: known(value) for key, value in document.items()}
    if isinstance(document, list | tuple):
        return [known(value) for value in document]
    return None if isinstance(document, float) and not math.isfinite(document) else document
