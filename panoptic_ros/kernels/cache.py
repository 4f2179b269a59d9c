"""Where compiled kernels are kept: one folder per module, named by all that its code depends on.

Files have checksums: one that was cut or damaged is as none, and is compiled again. numba itself trusts its
files. One that was cut, e.g. by a full disk or a power cut, raises an error in every run that follows, and
changed machine code would be run.
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

KEPT = 4  # folders of every module, of the last used: other checkouts, and the way back
MARK = b"panoptic-kernel-1\n"  # at the beginning, then four bytes of checksum, big-endian
SUFFIXES = (".nbi", ".nbc")  # numba's names for indices and for code
DAY_S = 86_400.0  # for which a folder is kept in any case, as somebody may be at work with it
SETTINGS: Any = numba.config
VERSIONS = (
    f"Python {sys.version} numpy {np.__version__} numba {numba.__version__} "
    f"llvmlite {sys.modules['llvmlite'].__version__} optimised {SETTINGS.OPT} checked {SETTINGS.BOUNDSCHECK}"
)


@cache
def cache_folder() -> Path:
    """The folder of all kernels, which can be written: where NUMBA_CACHE_DIR says, or in the user's cache.

    Where neither can be written, a folder of the user's own among the temporary ones.

    Raises:
        OSError: if there is no place at all, or somebody else owns that folder: what is in it would be run.
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
    """The folder of a module's kernels, which need not be there yet; marked as used if it is."""
    name = module.partition(".")[2]
    folder = cache_folder() / f"{name}-{hash_of(VERSIONS, closure_hash(module))}"
    with suppress(FileNotFoundError):
        os.utime(folder)
    return folder


def hash_of(*texts: str) -> str:
    """A short hash for the name of a file."""
    return sha256("\n".join(texts).encode()).hexdigest()[:20]


def remove_old(folder: Path) -> None:
    """Remove the folders of a module's other versions, but for the last used ones.

    Several processes may do so at a time. One that works with a removed folder makes it anew.
    """
    stem = folder.name.rpartition("-")[0]
    others = [path for path in folder.parent.glob(f"{stem}-*") if path.name.rpartition("-")[0] == stem]
    used = sorted(((_used_s(path), path) for path in others if path != folder), reverse=True)
    for last_s, path in used[KEPT - 1 :]:
        if last_s < time.time() - DAY_S:
            shutil.rmtree(path, ignore_errors=True)


def _used_s(path: Path) -> float:
    """When a folder was used last; now, if another process has just removed it."""
    try:
        return path.stat().st_mtime
    except FileNotFoundError:
        return time.time()


class _Locator:
    """What numba asks for the place of a function's kernels; see `numba.core.caching`."""

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


class KeptFile(IndexDataCacheFile):
    """The index of one function and its files of code, see `numba.core.caching`."""

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
            raise FileNotFoundError(f"{name} is not there or damaged")  # numba compiles then
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
    """The cache of one function; nothing is kept of sources that were edited after the process began."""

    _impl_class = _Kernels

    def __init__(self, function: Callable[..., Any]):
        super().__init__(function)
        locator = self._impl.locator
        self._cache_file = KeptFile(
            locator.get_cache_path(), self._impl.filename_base, locator.get_source_stamp()
        )
        if edited_meanwhile(function.__module__):
            self.disable()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """numba's, or None where what is kept cannot be loaded, e.g. a record of arguments moved: compile.

        numba loads all that it compiles with first, a quarter of a second, and again where it does compile.
        What is compiled already needs the counts of references alone.
        """
        try:
            rtsys.initialize(target_context)
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)
        except Exception:  # a file of another program's, or that was cut: unpickling it raises anything
            with suppress(OSError):
                self._cache_file.flush()
            return None

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        """numba's key, and the names of fields: numba knows named tuples by the name of their class only."""
        return (*super()._index_key(sig, codegen), tuple(_field_names(getattr(sig, "args", sig))))


def _field_names(kinds: Any) -> Iterator[tuple[str, ...]]:
    """The fields of all named tuples among types and inside of them, in order."""
    for kind in kinds:
        yield tuple(getattr(kind, "fields", ()))
        if isinstance(kind, types.BaseTuple):
            yield from _field_names(kind)


def remove_damaged(folder: Path) -> int:
    """Remove files of compiled kernels below a folder that are cut or damaged; return how many there were."""
    count = 0
    for path in damaged_files(folder):
        with suppress(OSError):
            path.unlink(missing_ok=True)
            count += 1
    return count


def damaged_files(folder: Path) -> list[Path]:
    """Return files of compiled kernels below a folder that are cut or damaged.

    Folders in which no file has a checksum are of earlier versions, which had none.
    """
    found: list[Path] = []
    for place in folder.glob("*/"):
        whole = {path: _content(path) is not None for path in place.iterdir() if path.suffix in SUFFIXES}
        if any(whole.values()):
            found += [path for path, good in whole.items() if not good]
    return found


def _content(path: Path) -> bytes | None:
    """Return the bytes behind the checksum of a file; None if it is not there, or not as it was written."""
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
