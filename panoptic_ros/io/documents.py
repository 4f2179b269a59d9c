"""Documents in JSON, YAML, TOML, XML and CSV: bounded in size, nesting and what aliases expand to."""

from __future__ import annotations

import csv
import io
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from panoptic_ros.errors import DataError, UserError, one_line
from panoptic_ros.io.loading import MIB, parsing, read_bytes, read_unpacked

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # in C, if PyYAML has it: eight times as quick

DEEPEST = 64  # levels of nesting in YAML; ours have six. numpy has as many dimensions at most
LARGEST_YAML = MIB  # bytes; the topics of 480 cameras are 100 kB, and the reader makes 1 MB a second
MOST_VALUES = 100_000  # in YAML with all aliases expanded; the topics of 480 cameras are 5000
LARGEST_TABLES = 64 * MIB  # bytes of TOML, XML and rigs; 500 cameras with their covariances are 5 MB


def decoded(data: bytes, path: Path | str) -> str:
    """Return the text of a file in UTF-8, or in UTF-16 with a byte order mark.

    Raises:
        DataError: if it is neither.
    """
    marked = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    try:
        return data.decode("utf-16" if marked else "utf-8-sig")
    except UnicodeDecodeError as error:
        at = f"byte {error.start} is none of it"
        raise DataError(f"{path} is no text in UTF-{16 if marked else 8}: {at}; save it as UTF-8") from None


def read_text(path: Path, most: int = LARGEST_TABLES) -> str:
    """Return the text of a file, gzipped or not.

    Args:
        most: bytes.

    Raises:
        DataError: if it cannot be read, is larger, or is no text.
    """
    return decoded(read_unpacked(Path(path), most), path)


def read_json(path: Path, most: int | None = None) -> Any:
    """Read JSON, gzipped or not.

    Args:
        most: bytes of the text; None = as much as fits into the machine's memory.

    Raises:
        DataError: if it is no JSON.
    """
    return parse_json(read_unpacked(Path(path), most), path)


def parse_json(data: bytes | str, path: Path | str, kind: type[UserError] = DataError) -> Any:
    """Return the value of a text in JSON.

    Args:
        path: for messages. kind: of error.

    Raises:
        UserError: of the kind, if it is no JSON.
    """
    try:
        return json.loads(data)
    except RecursionError:
        raise kind(f"{path} is not valid JSON: it is nested too deeply") from None
    except ValueError as error:
        raise kind(f"{path} is not valid JSON: {one_line(error)}") from None


def read_yaml(path: Path, most: int = LARGEST_YAML, values: int = MOST_VALUES) -> Any:
    """Read YAML.

    Args:
        most: bytes of the text. values: in the document, with all aliases expanded.

    Raises:
        DataError: if it is no YAML, nested too deeply, or has aliases that expand to very much.
    """
    text = decoded(read_bytes(Path(path), most), path)
    with parsing(path):  # values such as dates are made by Python, which raises errors of its own
        try:
            return _yaml(text, path, values)
        except yaml.YAMLError as error:
            where = getattr(error, "problem_mark", None)
            line = f", line {where.line + 1}" if where else ""
            raise DataError(f"{path} is not valid YAML{line}") from None


def _yaml(text: str, path: Path, most: int) -> Any:
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _Expanded(path, most).size(node, 0)
        return loader.construct_document(node)
    finally:
        loader.dispose()


class _Expanded:
    """Counts the values of a document with its aliases expanded, and their levels of nesting."""

    def __init__(self, path: Path | str, most: int):
        self._path, self._most = path, most
        self._known: dict[int, tuple[int, int]] = {}  # values and levels below, by the identity of a node

    def size(self, node: Any, depth: int) -> tuple[int, int]:
        """Return values and levels of a node that lies so deep.

        Raises:
            DataError: if it is too deep, holds itself, or has too many values.
        """
        found = self._known.get(id(node), (1, 0))
        if depth + found[1] > DEEPEST:
            raise DataError(f"{self._path} is nested more than {DEEPEST} levels deep, or within itself")
        if id(node) in self._known or not isinstance(node.value, list):
            return found
        values, levels = 1, 0
        for entry in node.value:
            for part in entry if isinstance(entry, tuple) else (entry,):
                more, below = self.size(part, depth + 1)
                values, levels = values + more, max(levels, below + 1)
        if values > self._most:
            raise DataError(
                f"{self._path} has more than {self._most} values, with its aliases expanded; "
                "write it without aliases (* and &), or in several files"
            )
        self._known[id(node)] = values, levels
        return values, levels


def parse_toml(text: str, path: Path | str, kind: type[UserError] = DataError) -> dict[str, Any]:
    """Return the tables of a text in TOML.

    Args:
        path: for messages. kind: of error.

    Raises:
        UserError: of the kind, if it is no TOML.
    """
    if sys.version_info >= (3, 11):  # only now: most runs do not need it
        import tomllib
    else:
        import tomli as tomllib

    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        last = f"at the end, line {len(text.rstrip().splitlines())}"
        told = one_line(error).replace("at end of document", last)
        raise kind(f"{path} is not valid TOML: {told}") from None


def parse_xml(text: str, path: Path | str, kind: type[UserError] = DataError) -> Any:
    """Return the root element of a text in XML.

    Args:
        path: for messages. kind: of error.

    Raises:
        UserError: of the kind, if it is no XML, or defines entities, which can expand to any length.
    """
    from xml.etree import ElementTree  # only now: most runs do not need it

    if "<!ENTITY" in text:
        raise kind(f"{path} defines XML entities; a calibration needs none")
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise kind(f"{path} is not valid XML: {one_line(error)}") from None


def csv_rows(text: str, path: Path | str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of the line at which a row ends, counted from 1, and its fields.

    Raises:
        DataError: if the text is no CSV.
    """
    reader = csv.reader(io.StringIO(text, newline=""))
    while True:
        try:
            row = next(reader, None)
        except csv.Error as error:
            where = f"{path}, line {reader.line_num}"
            raise DataError(f"{where}: not readable as CSV: {one_line(error)}") from None
        if row is None:
            return
        yield reader.line_num, row
