"""Files of compiled kernels with checksums: one that was cut or damaged is as none, and is compiled again.

numba itself trusts its files. One that was cut, e.g. by a full disk or a power cut, raises an error in every
run that follows, and changed machine code would be run.
"""

from __future__ import annotations

import pickle
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any

from numba.core.caching import IndexDataCacheFile

MARK = b"panoptic-kernel-1\n"  # at the beginning, then four bytes of checksum, big-endian
SUFFIXES = (".nbi", ".nbc")  # numba's names for indices and for code


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
