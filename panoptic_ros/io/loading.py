"""Open files from other sources with a size limit, and describe every damage in one line.

All readers get the bytes of a file from this module and parse them inside of `parsing`. A cut, damaged or
malicious file then takes a bounded amount of memory and ends in an error that names it.
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
# bytes, limit of the unpacked size of a PIECE, ratio 1:64. A document of 480 empty views has 1:22, of IMUs at
# rest 1:37.
UNPACKED = 32 * MIB
# Limit of gzip members: MEMBERS, plus one for each MEMBER bytes of the file. bgzip members have 16 kB.
MEMBERS, MEMBER = 100, 4096
# A document's text may take 1/SHARE of the machine's memory. Parsed, it takes several times more than as
# text.
SHARE = 4
LEAST = 1024 * MIB  # bytes; a document of this size is allowed on any machine
TABLES = ("items", "keys", "values", "get", "pop")  # attributes used by readers that only tables (dicts) have


@contextmanager
def file_errors(path: Path, doing: str) -> Iterator[None]:
    """Turn operating-system errors into a one-line error.

    Raises:
        DataError: if the file does not exist or is a folder.
        EnvironmentProblem: on missing permissions, a full disk and other operating-system errors.
    """
    try:
        yield
    except OSError as error:
        raise file_error(path, doing, error) from None


def file_error(path: Path | str, doing: str, error: OSError) -> UserError:
    """Return the one-line error for an operating-system error, as `file_errors` raises it."""
    missing = isinstance(error, FileNotFoundError | IsADirectoryError | NotADirectoryError)
    kind = DataError if missing else EnvironmentProblem
    return kind(f"cannot {doing} {path}: {error.strerror or one_line(error)}")


def parsing(where: Path | str, kind: type[UserError] = DataError) -> _Parsing:
    """Turn any exception of a parser inside a `with` block into a one-line error.

    A parser meets any value at any place, so it can raise any exception. Errors of this package pass
    unchanged.

    Args:
        where: the file, and the entry in it if known.
        kind: error type.

    Raises:
        UserError: of type `kind`, for any other exception.
    """
    return _Parsing(where, kind)


class _Parsing:
    """Context manager of `parsing`.

    It is a class because `contextmanager` is slower, and one is made for every frame of a file.
    """

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
    """Return the error about a document whose keys or values do not follow its format."""
    return kind(f"{where}: {_told(error)}; see docs/files.md for the format")


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
    """Return the largest size of an unpacked document, bytes: a fraction of the machine's memory."""
    return max(LEAST, os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // SHARE)


def check_file(path: Path) -> int:
    """Return the size of a file in bytes; -1 for a pipe from another program, such as a shell's `<(...)`.

    Raises:
        DataError: if it does not exist, or is a folder, a device or a named pipe. The last two may never end.
        EnvironmentProblem: on missing permissions and other operating-system errors.
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
    """Read the content of a file.

    Args:
        most: largest size, bytes; None = no limit for regular files, `largest_document` for pipes.

    Raises:
        DataError: if the file does not exist or is larger.
        EnvironmentProblem: on missing permissions and other operating-system errors.
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
    """Read the content of a file and unpack it if it is gzipped.

    Args:
        most: largest size, bytes, packed and unpacked; None = `largest_document`.

    Raises:
        DataError: if the file does not exist, is larger, or cannot be unpacked.
        EnvironmentProblem: on missing permissions and other operating-system errors.
    """
    limit = largest_document() if most is None else most
    data = read_bytes(path, limit)
    return unpacked(data, path, limit) if data[:2] == GZIP else data


def unpacked(data: bytes, path: Path | str, most: int) -> bytes:
    """Unpack the bytes of a gzip file of one or several members.

    Args:
        path: named in error messages.
        most: largest size of the result, bytes.

    Raises:
        DataError: if it is cut or damaged, or if it exceeds `most`, the packing ratio or the number of
            members.
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
                f"{path}: {PIECE // 1024} kB of it unpack to more than {UNPACKED // MIB} MB, which is "
                "implausible for a document; if it is one, unpack it with gunzip"
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
