"""Read files of named arrays (.npz). Array headers are checked before any data is unpacked."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from panoptic_ros.errors import DataError, one_line
from panoptic_ros.io.loading import MIB, check_file, largest_document, parsing

Array = np.ndarray
SMALL = 64 * MIB  # bytes; every file may unpack to this size
# Limit of unpacked bytes / packed bytes for files that unpack to more than SMALL. Our recorded motion has
# 1.3.
RATIO = 64


@contextmanager
def arrays_of(path: Path) -> Iterator[Mapping[str, Any]]:
    """Open an .npz file and yield its arrays by name; each array is read on access.

    An exception inside the `with` block becomes an error that names the file.

    Raises:
        DataError: if it is no .npz file, or if it unpacks to more than the size limit.
        EnvironmentProblem: on missing permissions and other operating-system errors.
    """
    packed = check_file(path)
    most = min(max(SMALL, RATIO * packed), largest_document())
    with parsing(path):
        try:
            with zipfile.ZipFile(path) as archive:
                for entry in archive.infolist():
                    most -= entry.file_size
                    if most < 0:
                        raise DataError(f"{path} unpacks to far more than an .npz of {packed} bytes holds")
                for name in archive.namelist():
                    with archive.open(name) as file:
                        _check(file, archive.getinfo(name).file_size, f"{path}: {name}")
        except zipfile.BadZipFile as error:
            raise DataError(f"{path} is not an intact .npz file: {one_line(error)}") from None
        with np.load(path) as found:
            yield found


def _check(file: IO[bytes], size: int, where: str) -> None:
    """Check that the array in the header is not larger than its entry in the archive.

    NumPy allocates the memory of an array before it reads the data. A wrong header could exhaust the memory.

    Args:
        size: bytes of the unpacked entry, with the header.

    Raises:
        DataError: if the array is larger, or if it holds Python objects, which could contain code.
    """
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(file)
    if dtype.hasobject:
        raise DataError(f"{where} holds objects of Python, which are not read")
    if math.prod(shape) * dtype.itemsize > size:
        raise DataError(f"{where} states {shape} of {dtype}, which is more than its {size} bytes")
