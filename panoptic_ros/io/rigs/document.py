"""Parse a file by its content, not its name: JSON, XML, TOML, lines of numbers, other text, or a folder."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from panoptic_ros.errors import CalibrationError, DataError
from panoptic_ros.io.documents import LARGEST_TABLES, decoded, parse_json, parse_toml, parse_xml
from panoptic_ros.io.loading import read_unpacked

FILE = "the file"  # placeholder in messages; the caller inserts the file name
TABLE = re.compile(r"^\s*\[[\w. \"'-]+\]\s*(#.*)?$", re.MULTILINE)  # header line of a TOML table


@dataclass(frozen=True)
class Document:
    """Parsed content of a file.

    It is a dict (json, toml), an XML root element, the numbers of each line, other text, or the path of a
    folder.
    """

    syntax: Literal["json", "xml", "toml", "numbers", "text", "folder"]
    content: Any


def load_document(path: Path) -> Document | None:
    """Read the content of a file; None if it is not text, or empty.

    Raises:
        DataError: if it cannot be read.
        CalibrationError: if it begins like JSON, XML or TOML, but is broken.
    """
    if path.is_dir():
        return Document("folder", path)
    data = read_unpacked(path, LARGEST_TABLES)
    try:
        text = decoded(data, path)
    except DataError:
        return None
    start = text.lstrip()[:1]
    if start == "<":
        return Document("xml", parse_xml(text, FILE, CalibrationError))
    if start == "{":
        return Document("json", parse_json(text, FILE, CalibrationError))
    if start != "[" and (rows := _rows(text)) is not None:
        return Document("numbers", rows)
    try:
        return Document("toml", parse_toml(text, "it", CalibrationError)) if start else None
    except CalibrationError as error:
        if path.suffix == ".toml" or TABLE.search(text):
            raise CalibrationError(f"the file is broken: {error}") from None
        return Document("text", text)


def _rows(text: str) -> list[list[float]] | None:
    """Return the numbers of every line; None if the text holds anything else, or nothing."""
    try:
        rows = [[float(word) for word in line.split()] for line in text.splitlines()]
    except ValueError:
        return None
    return rows if any(rows) else None
