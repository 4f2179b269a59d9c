"""Opening files that others wrote: bounded in size, and every damage described in one line.

All readers take the bytes of a file from here and parse them inside of `parsing`. So a file that is cut,
damaged or made to do harm costs a bounded amount of memory, and ends in an error that names it.
"""

from __future__ import annotations

import io
import os
import stat
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

from panoptic_ros.errors import DataError, EnvironmentProblem, PanopticError, UserError, one_line, shown

MIB = 1 << 20  # bytes
GZIP = b"\x1f\x8b"  # first bytes of a gzip file, RFC 1952
PIECE = MIB // 2  # bytes that are unpacked in one step
UNPACKED = 32 * MIB  # bytes that `PIECE` may become, 1:64; 480 empty views have 1:22, IMUs at rest 1:37
MEMBERS, MEMBER = 100, 4096  # parts of a gzip file, and bytes of each where there are more; bgzip has 16 kB
SHARE = 4  # a document may have a fourth of the machine's memory as text; parsed it takes several times more
LEAST = 1024 * MIB  # bytes that a document may have on any machine
TABLES = ("items", "keys", "values", "get", "pop")  # attributes that only a table has, of those in use


@contextmanager
def file_errors(path: Path, doing: str) -> Iterator[None]:
    """Turn the operating system's errors into one clear line.

    Raises:
        DataError: if the file is not there or is a folder.
        EnvironmentProblem: on permissions, a full disk and other trouble of the machine.
    """
    try:
        yield
    except OSError as error:
        raise file_error(path, doing, error) from None


def file_error(path: Path | str, doing: str, error: OSError) -> UserError:
    """Return the line about an error of the operating system, as `file_errors` raises it."""
    missing = isinstance(error, FileNotFoundError | IsADirectoryError | NotADirectoryError)
    kind = DataError if missing else EnvironmentProblem
    return kind(f"cannot {doing} {path}: {error.strerror or one_line(error)}")


def parsing(where: Path | str, kind: type[UserError] = DataError) -> _Parsing:
    """Turn any exception of a parser into one line: `with parsing(path): ...`.

    A parser meets any value at any place, so it can raise anything. Errors of this package pass as they are.

    Args:
        where: the file, and the entry in it as far as known.
        kind: of error.

    Raises:
        UserError: of the kind, for any other exception.
    """
    return _Parsing(where, kind)


class _Parsing:
    """See `parsing`; not made with `contextmanager`, as there is one for every frame of a file."""

    def __init__(self, where: Path | str, kind: type[UserError]):
        self._where, self._kind = where, kind

    def __enter__(self) -> None:
        return None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, OSError) and error.errno:
            raise file_error(self._where, "read", error) from None
        if isinstance(error, Exception) and not isinstance(error, PanopticError):
            raise malformed(self._where, error, self._kind) from None


def malformed(where: Path | str, error: Exception, kind: type[UserError] = DataError) -> UserError:
    """Return the error about a document whose keys or values are not those of its format."""
    return kind(f"{where}: {_told(error)}; docs/formats.md says what must be there")


def _told(error: Exception) -> str:
    """Describe the fault of a document by the exception of its parser."""
    if isinstance(error, KeyError):
        return f"{shown(error.args[0]) if error.args else 'a key'} is missing"
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    if isinstance(error, MemoryError):
        return "it does not fit into the memory"
    if isinstance(error, StopIteration):
        return "it ends too early"
    if isinstance(error, IndexError):
        return f"a list is too short ({one_line(error)})"
    if isinstance(error, AttributeError) and error.name:
        wanted = "a table" if error.name in TABLES else "something else"
        return f"a value is wrong: {shown(error.obj)} stands where {wanted} is expected"
    return f"a value is wrong: {one_line(error)}"


def largest_document() -> int:
    """Return the bytes that a document may have, unpacked: a share of the machine's memory."""
    return max(LEAST, os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // SHARE)


def check_file(path: Path) -> int:
    """Return the size of a file in bytes, -1 for a pipe that another program writes, as `<(...)` of a shell.

    Raises:
        DataError: if it is not there or a folder, or a device or named pipe, which need not ever end.
        EnvironmentProblem: on permissions and other trouble of the machine.
    """
    with file_errors(path, "read"):
        found = os.stat(path)
    if stat.S_ISDIR(found.st_mode):
        raise DataError(f"cannot read {path}: Is a directory")
    if stat.S_ISREG(found.st_mode):
        return found.st_size
    if stat.S_ISFIFO(found.st_mode) and os.path.realpath(path).startswith("/proc/"):
        return -1
    raise DataError(f"cannot read {path}: it is a device or a named pipe; copy its content into a file first")


def read_bytes(path: Path, most: int | None = None) -> bytes:
    """Return the content of a file.

    Args:
        most: bytes; None = any number.

    Raises:
        DataError: if there is no such file, or it is larger.
        EnvironmentProblem: on permissions and other trouble of the machine.
    """
    path = Path(path)
    size = check_file(path)
    limit = most if most is not None or size >= 0 else largest_document()
    if limit is not None and size > limit:
        raise _too_large(path, limit)
    with file_errors(path, "read"), open(path, "rb") as file:
        if size > 0 or limit is None:
            return file.read()
        whole = io.BytesIO()  # the size of a pipe is unknown
        while piece := file.read(MIB):
            whole.write(piece)
            if whole.tell() > limit:
                raise _too_large(path, limit)
    return whole.getvalue()


def read_unpacked(path: Path, most: int | None = None) -> bytes:
    """Return the content of a file, unpacked if it is gzipped.

    Args:
        most: bytes, packed and unpacked; None = `largest_document`.

    Raises:
        DataError: if there is no such file, it is larger, or cannot be unpacked.
        EnvironmentProblem: on permissions and other trouble of the machine.
    """
    limit = largest_document() if most is None else most
    data = read_bytes(path, limit)
    return unpacked(data, path, limit) if data[:2] == GZIP else data


def unpacked(data: bytes, path: Path | str, most: int) -> bytes:
    """Return what is in the bytes of a gzip file, of one member or several.

    Args:
        path: for messages. most: bytes.

    Raises:
        DataError: if it is cut or damaged, or unpacks to more than `most`, or than any document does.
    """
    whole = io.BytesIO()
    begin, members = 0, 1
    member = zlib.decompressobj(wbits=31)
    while begin < len(data):
        piece = data[begin : begin + PIECE]
        try:
            whole.write(member.decompress(piece, UNPACKED))
        except zlib.error as error:
            raise DataError(f"{path} begins as a gzip file and is damaged: {error}; copy it again") from None
        if member.unconsumed_tail:
            raise DataError(
                f"{path}: {PIECE // 1024} kB of it unpack to more than {UNPACKED // MIB} MB, as of no real "
                "document; where it is one, unpack it with gunzip"
            )
        if whole.tell() > most:
            raise _too_large(path, most)
        begin += len(piece) - len(member.unused_data)
        if member.eof:
            begin += len(data) - begin - len(data[begin:].lstrip(b"\0"))  # some media pad files with zeros
            if begin < len(data):
                member, members = zlib.decompressobj(wbits=31), members + 1
        if members > MEMBERS + len(data) // MEMBER:
            raise DataError(f"{path} is a gzip file of {members} parts and more; pack it again in one")
    if not member.eof:
        raise DataError(f"{path} is a gzip file that was cut: its end is missing; copy it again")
    return whole.getvalue()


def _too_large(path: Path | str, limit: int) -> DataError:
    size = f"{limit / (1024 * MIB):g} GB" if limit >= 1024 * MIB else f"{limit / MIB:g} MB"
    return DataError(f"{path} holds more than {size}, which is too much for such a file; name another")
