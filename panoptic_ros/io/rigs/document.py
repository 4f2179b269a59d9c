"""From a file to its parsed content, whatever the name: JSON, XML, TOML, lines of numbers, or a folder."""
from __future__ import annotations

import gzip
import json
import sys
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from panoptic_ros.errors import CalibrationError
from panoptic_ros.io.files import read_bytes

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


@dataclass(frozen=True)
class Document:
    """Parsed content: a dict (json, toml), an XML root element, the numbers of each line, or the path of a
    folder."""

    syntax: Literal["json", "xml", "toml", "numbers", "folder"]
    content: Any


def load_document(path: Path) -> Document | None:
    """The content of a file, or None if it is in none of the syntaxes.

    Raises:
        DataError: if it cannot be read.
        CalibrationError: if it begins like one of them and is broken later.
    """
    if path.is_dir():
        return Document("folder", path)
    data = read_bytes(path)
    try:
        if data[:2] == b"\x1f\x8b":
            data = gzip.decompress(data)
        text = data.decode("utf-8-sig")
    except (OSError, EOFError, UnicodeDecodeError):
        return None
    start = text.lstrip()[:1]
    try:
        if start == "<":
            return Document("xml", _xml(text))
        if start in ("{", "["):
            return _json_or_toml(text, start)
        if (rows := _rows(text)) is not None:
            return Document("numbers", rows)
        return Document("toml", tomllib.loads(text)) if start else None
    except (json.JSONDecodeError, ElementTree.ParseError) as error:
        raise CalibrationError(f"the file is broken: {error}") from None
    except tomllib.TOMLDecodeError:
        return None


def _json_or_toml(text: str, start: str) -> Document:
    """JSON objects start with a brace; a bracket starts a TOML table."""
    if start == "[":
        return Document("toml", tomllib.loads(text))
    return Document("json", json.loads(text))


def _rows(text: str) -> list[list[float]] | None:
    """The numbers of every line; None if there is anything else, or nothing."""
    try:
        rows = [[float(word) for word in line.split()] for line in text.splitlines()]
    except ValueError:
        return None
    return rows if any(rows) else None


def _xml(text: str) -> Any:
    if "<!ENTITY" in text:
        raise CalibrationError("the file defines XML entities; a calibration needs none")
    return ElementTree.fromstring(text)
