"""Open a bag file: detect its format from the first bytes, and decompress it if needed."""

from __future__ import annotations

import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path

from panoptic_ros.errors import DataError, one_line
from panoptic_ros.io.loading import check_file, file_errors
from panoptic_ros.io.storages import mcap, records, sqlite
from panoptic_ros.io.storages.storage import PACKED, Storage

if sys.version_info >= (3, 14):
    from compression import zstd
else:  # rosbags depends on the same package
    from backports import zstd

ZSTD = b"\x28\xb5\x2f\xfd"
ROS_1, ROS_1_SUFFIX = b"#ROSBAG V", ".bag"
_PIECE = 1 << 20  # bytes that are read in one step
_STEP = 16_384  # bytes that are decompressed in one step, and lost where one is damaged


def opened(path: Path, stack: ExitStack) -> Storage:
    """Open a bag file.

    Args:
        stack: closes the file, and removes the decompressed copy.

    Raises:
        DataError: if it is a ROS 1 bag, or no bag file.
        Exception: of any type, if it is damaged.
    """
    check_file(path)
    with file_errors(path, "read"), path.open("rb") as file:
        begin = file.read(len(sqlite.MAGIC))
    if begin.startswith(ZSTD):
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="panoptic-bag-")))
        whole = folder / packed_name(path)
        with file_errors(whole, "write"):
            problem = unpack(path, whole)
        if problem:
            raise DataError(f"{path.name}: {problem}")
        return opened(whole, stack)
    if begin.startswith(ROS_1):
        raise of_ros_1(path)
    if not begin.startswith((records.MAGIC, sqlite.MAGIC)):
        raise DataError(f"{path.name} begins neither as MCAP nor as SQLite3 does")
    kind = mcap.McapStorage if begin.startswith(records.MAGIC) else sqlite.SqliteStorage
    storage: Storage = kind(path)
    stack.callback(storage.close)
    return storage


class Ros1BagError(DataError):
    """The file is a ROS 1 bag, which has another format."""


def of_ros_1(path: Path) -> Ros1BagError:
    """Return the error about a ROS 1 bag."""
    new = path.with_suffix("") if path.suffix else path.with_name(f"{path.name}_ros2")
    return Ros1BagError(
        f"{path} is a bag of ROS 1; convert it and give {new}: "
        f"`rosbags-convert --src {path} --dst {new} --dst-storage mcap`"
    )


def packed_name(path: Path) -> str:
    """Return the name of a file without the suffix of its compression."""
    return path.name.removesuffix(next((end for end in PACKED if path.name.endswith(end)), ""))


def unpack(path: Path, target: Path) -> str:
    """Decompress a zstd file up to the first damage; return the fault, "" if there is none."""
    unpacker = zstd.ZstdDecompressor()
    with path.open("rb") as file, target.open("wb") as whole:
        while piece := file.read(_PIECE):
            while piece or not unpacker.needs_input:
                if unpacker.eof:  # a file may consist of several frames
                    unpacker = zstd.ZstdDecompressor()
                try:
                    whole.write(unpacker.decompress(piece, _STEP))
                except zstd.ZstdError as error:
                    return f"it is damaged within its packed data ({one_line(error)})"
                piece = unpacker.unused_data if unpacker.eof else b""
                if unpacker.eof and not piece:
                    break
    return "" if unpacker.eof else "it was cut within its packed data"


def unpacked_message(data: bytes) -> bytes:
    """Return the CDR bytes of a message; decompress it if it begins with zstd's magic number.

    CDR begins with a zero byte, so it cannot be mistaken for zstd.

    Raises:
        ValueError: if the compressed data are damaged.
    """
    if not data.startswith(ZSTD):
        return data
    try:
        return bytes(zstd.decompress(data))
    except zstd.ZstdError as error:
        raise ValueError(f"a packed message is damaged ({one_line(error)})") from None
