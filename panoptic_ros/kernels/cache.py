"""Cache of compiled kernels on disk.

Each module has a folder, whose name contains a hash of everything that its code depends on. Files have
checksums. A truncated or damaged file is treated as missing, and its kernel is compiled again. numba itself
does not check its files. A file truncated by a full disk or a power cut would raise an error in every later
run, and altered machine code would be executed.
"""

from __future__ import annotations

import os
import pickle
import shutil
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core import types
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.runtime.nrt import rtsys

from panoptic_ros.kernels.sources import closure_hash, edited_meanwhile

KEPT = 4  # most recently used folders per module: other checkouts, and earlier versions
MARK = b"panoptic-kernel-1\n"  # start of a file, followed by a checksum of four bytes, big-endian
SUFFIXES = (".nbi", ".nbc")  # numba's file suffixes of indices and of code
DAY_S = 86_400.0  # a folder is kept at least this long, because another process may use it
SETTINGS: Any = numba.config
VERSIONS = (
    f"Python {sys.version} numpy {np.__version__} numba {numba.__version__} "
    f"llvmlite {sys.modules['llvmlite'].__version__} optimised {SETTINGS.OPT} checked {SETTINGS.BOUNDSCHECK}"
)


@cache
def cache_folder() -> Path:
    """Return the writable folder of all kernels: in NUMBA_CACHE_DIR if set, or in the user's cache.

    If that is not writable, return a folder of this user among the temporary files.

    Raises:
        OSError: if no place is writable, or another user owns that folder: its files would be executed.
    """
    for place in _places():
        try:
            place.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=place).close()
        except OSError:
            continue
        return place
    own = Path(tempfile.gettempdir()) / f"panoptic_ros-kernels-{os.getuid()}"
    own.mkdir(mode=0o700, exist_ok=True)
    if own.is_symlink() or own.stat().st_uid != os.getuid():
        raise PermissionError(f"{own} is not yours: set NUMBA_CACHE_DIR to a folder that you can write")
    return own


def _places() -> list[Path]:
    if SETTINGS.CACHE_DIR:
        return [Path(SETTINGS.CACHE_DIR) / "panoptic_ros"]
    user = os.environ.get("XDG_CACHE_HOME", "")
    places = [Path(user)] if os.path.isabs(user) else []
    if os.environ.get("HOME"):
        places.append(Path(os.environ["HOME"]) / ".cache")
    return [place / "panoptic_ros" / "kernels" for place in places]


@cache
def module_folder(module: str) -> Path:
    """Return the folder of a module's kernels, which may not exist; if it does, mark it as used."""
    name = module.partition(".")[2]
    folder = cache_folder() / f"{name}-{hash_of(VERSIONS, closure_hash(module))}"
    with suppress(FileNotFoundError):
        os.utime(folder)
    return folder


def hash_of(*texts: str) -> str:
    """Return a short hash of texts for a file name."""
    return sha256("\n".join(texts).encode()).hexdigest()[:20]


def remove_old(folder: Path) -> None:
    """Remove the folders of a module's other versions, except for the most recently used ones.

    Several processes may do so at a time. A process that uses a removed folder creates it again.
    """
    stem = folder.name.rpartition("-")[0]
    others = [path for path in folder.parent.glob(f"{stem}-*") if path.name.rpartition("-")[0] == stem]
    used = sorted(((_used_s(path), path) for path in others if path != folder), reverse=True)
    for last_s, path in used[KEPT - 1 :]:
        if last_s < time.time() - DAY_S:
            shutil.rmtree(path, ignore_errors=True)


def _used_s(path: Path) -> float:
    """Return the time of last use of a folder, s since 1970; now, if another process has just removed it."""
    try:
        return path.stat().st_mtime
    except FileNotFoundError:
        return time.time()


class _Locator:
    """Locator that numba asks for the place of a function's kernels; see `numba.core.caching`."""

    def __init__(self, function: Callable[..., Any], path: str):
        self._py_file = path
        self._folder = module_folder(function.__module__)
        self._line = function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, function: Callable[..., Any], path: str) -> _Locator:
        return cls(function, path)

    def ensure_cache_path(self) -> None:
        if not self._folder.exists():
            self._folder.mkdir(parents=True, exist_ok=True)
            remove_old(self._folder)

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._folder.name

    def get_disambiguator(self) -> str:
        return str(self._line)


class KernelFile(IndexDataCacheFile):
    """Index of one function and its code files, with checksums; see `numba.core.caching`."""

    def _load_index(self) -> Any:
        content = _content(Path(self._index_path))
        if content is None:
            return {}
        version, stamp, overloads = pickle.loads(content)
        return overloads if (version, stamp) == (self._version, self._source_stamp) else {}

    def _save_index(self, overloads: Any) -> None:
        self._write(self._index_path, (self._version, self._source_stamp, overloads))

    def _load_data(self, name: str) -> Any:
        content = _content(Path(self._data_path(name)))
        if content is None:
            raise FileNotFoundError(f"{name} is missing or damaged")  # numba then compiles
        return pickle.loads(content)

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)

    def _write(self, path: str, value: Any) -> None:
        content = self._dump(value)
        with self._open_for_write(path) as file:
            file.write(MARK + _checksum(content))
            file.write(content)


class _Kernels(CompileResultCacheImpl):
    _locator_classes = [_Locator]


class KernelCache(FunctionCache):
    """Cache of one function; nothing is stored if its sources were edited after the process started."""

    _impl_class = _Kernels

    def __init__(self, function: Callable[..., Any]):
        super().__init__(function)
        locator = self._impl.locator
        self._cache_file = KernelFile(
            locator.get_cache_path(), self._impl.filename_base, locator.get_source_stamp()
        )
        if edited_meanwhile(function.__module__):
            self.disable()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the kernel for a signature; None if the stored one cannot be loaded, so numba compiles.

        Loading fails, for example, if the class of an argument was moved to another module. This method
        initialises only the reference counting, and a compiled kernel needs no more. In contrast,
        numba's own method first loads everything for compilation, which takes a quarter of a second. It does
        so again when it compiles.
        """
        try:
            rtsys.initialize(target_context)
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)
        except Exception:  # a file of another program or a truncated one: unpickling can raise anything
            with suppress(OSError):
                self._cache_file.flush()
            return None

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        """Return numba's key with the field names of named tuples added.

        numba distinguishes named tuples by their class name only.
        """
        return (*super()._index_key(sig, codegen), tuple(_field_names(getattr(sig, "args", sig))))


def _field_names(kinds: Any) -> Iterator[tuple[str, ...]]:
    """Yield the fields of all named tuples among types and inside them, in order."""
    for kind in kinds:
        yield tuple(getattr(kind, "fields", ()))
        if isinstance(kind, types.BaseTuple):
            yield from _field_names(kind)


def remove_damaged(folder: Path) -> int:
    """Remove truncated or damaged files of compiled kernels below a folder; return their number."""
    count = 0
    for path in damaged_files(folder):
        with suppress(OSError):
            path.unlink(missing_ok=True)
            count += 1
    return count


def damaged_files(folder: Path) -> list[Path]:
    """Return truncated or damaged files of compiled kernels below a folder.

    Folders in which no file has a valid checksum are skipped: they are of earlier versions without checksums.
    """
    found: list[Path] = []
    for place in folder.glob("*/"):
        whole = {path: _content(path) is not None for path in place.iterdir() if path.suffix in SUFFIXES}
        if any(whole.values()):
            found += [path for path, good in whole.items() if not good]
    return found


def _content(path: Path) -> bytes | None:
    """Return the bytes after the checksum of a file; None if it is missing or its checksum is wrong."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    begin = len(MARK) + 4
    content = data[begin:]
    whole = data.startswith(MARK) and data[len(MARK) : begin] == _checksum(content)
    return content if whole else None


def _checksum(content: bytes) -> bytes:
    return zlib.crc32(content).to_bytes(4, "big")
