"""Read JSON, YAML, TOML, XML and CSV, with limits on size, nesting and the expansion of aliases."""

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

# PyYAML's C loader where it exists: eight times as fast.
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

# Nesting levels in YAML. Our files have six levels. NumPy arrays have at most as many dimensions.
DEEPEST = 64
# bytes. The topics of 480 cameras take 100 kB, and the parser reads 1 MB/s.
LARGEST_YAML = MIB
# Values in a YAML file with all aliases expanded. The topics of 480 cameras have 5000.
MOST_VALUES = 100_000
# bytes of a TOML, XML or rig file. 500 cameras with their covariances take 5 MB.
LARGEST_TABLES = 64 * MIB


def decoded(data: bytes, path: Path | str) -> str:
    """Decode the text of a file in UTF-8, or in UTF-16 with a byte order mark.

    Raises:
        DataError: if it is neither.
    """
    marked = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    try:
        return data.decode("utf-16" if marked else "utf-8-sig")
    except UnicodeDecodeError as error:
        at = f"byte {error.start} is none of it"
        raise DataError(f"{path} is not text in UTF-{16 if marked else 8}: {at}; save it as UTF-8") from None


def read_text(path: Path, most: int = LARGEST_TABLES) -> str:
    """Read the text of a file, gzipped or not.

    Args:
        most: largest size, bytes.

    Raises:
        DataError: if it cannot be read, is larger, or is not text.
    """
    return decoded(read_unpacked(Path(path), most), path)


def read_json(path: Path, most: int | None = None) -> Any:
    """Read a JSON file, gzipped or not.

    Args:
        most: largest size of the text, bytes; None = limited by the machine's memory.

    Raises:
        DataError: if it is not JSON.
    """
    return parse_json(read_unpacked(Path(path), most), path)


def parse_json(data: bytes | str, path: Path | str, kind: type[UserError] = DataError) -> Any:
    """Parse a JSON text.

    Args:
        path: named in error messages.
        kind: error type.

    Raises:
        UserError: of type `kind`, if it is not JSON.
    """
    try:
        return json.loads(data)
    except RecursionError:
        raise kind(f"{path} is not valid JSON: it is nested too deeply") from None
    except ValueError as error:
        raise kind(f"{path} is not valid JSON: {one_line(error)}") from None


def read_yaml(path: Path, most: int = LARGEST_YAML, values: int = MOST_VALUES) -> Any:
    """Read a YAML file.

    Args:
        most: largest size of the text, bytes.
        values: largest number of values, with all aliases expanded.

    Raises:
        DataError: if it is not YAML, is nested too deeply, or has too many values.
    """
    text = decoded(read_bytes(Path(path), most), path)
    with parsing(path):  # the loader converts values such as dates, and Python raises errors of its own there
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
        _ExpansionCounter(path, most).size(node, 0)
        return loader.construct_document(node)
    finally:
        loader.dispose()


class _ExpansionCounter:
    """Counter of the values and nesting levels of a document with its aliases expanded."""

    def __init__(self, path: Path | str, most: int):
        self._path, self._most = path, most
        # number of values and of levels below a node, by the id of the node
        self._known: dict[int, tuple[int, int]] = {}

    def size(self, node: Any, depth: int) -> tuple[int, int]:
        """Return the number of values and of levels below a node at nesting level `depth`.

        Raises:
            DataError: if it is nested too deeply, contains itself, or has too many values.
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
    """Parse a TOML text.

    Args:
        path: named in error messages.
        kind: error type.

    Raises:
        UserError: of type `kind`, if it is not TOML.
    """
    if sys.version_info >= (3, 11):  # imported here because most runs do not need it
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
    """Parse an XML text and return its root element.

    Args:
        path: named in error messages.
        kind: error type.

    Raises:
        UserError: of type `kind`, if it is not XML, or defines entities, which can expand to any length.
    """
    from xml.etree import ElementTree  # imported here because most runs do not need it

    if "<!ENTITY" in text:
        raise kind(f"{path} defines XML entities; a calibration needs none")
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise kind(f"{path} is not valid XML: {one_line(error)}") from None


def csv_rows(text: str, path: Path | str) -> Iterator[tuple[int, list[str]]]:
    """Yield each row of a CSV text: the number of its last line, counted from 1, and its fields.

    Raises:
        DataError: if the text is not CSV.
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
