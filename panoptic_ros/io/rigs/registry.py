"""Which formats there are; reading by content, writing by name."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from panoptic_ros.domain import Rig
from panoptic_ros.errors import CalibrationError, UsageError
from panoptic_ros.io.files import write_bytes
from panoptic_ros.io.rigs import qualisys, rig_json
from panoptic_ros.io.rigs.document import Document, load_document


@dataclass(frozen=True)
class _Format:
    """One format.

    Args:
        name: as in `write_rig(format=...)`.
        title: for messages.
        syntax: of `Document`.
        recognises: whether a parsed document is of this format.
        parse: content and unit of length to a rig.
        dump: rig to text, or None if it is only read.
    """

    name: str
    title: str
    syntax: str
    recognises: Callable[[Any], bool]
    parse: Callable[[Any, str], Rig]
    dump: Callable[[Rig], str] | None


_FORMATS = (
    _Format(
        "rig.json", "rig.json (panoptic-rig-1)", "json",
        lambda document: document.get("format") == rig_json.FORMAT,
        lambda document, unit: rig_json.parse(document), rig_json.dump,
    ),
    _Format(
        "qca", "Qualisys .qca.txt", "xml",
        qualisys.recognises, lambda root, unit: qualisys.parse(root), qualisys.dump,
    ),
)  # fmt: skip
WRITABLE = tuple(item.name for item in _FORMATS if item.dump)


def read_rig(path: Path | str) -> Rig:
    """A rig from a file or folder in any of the formats of this package, recognised by content.

    Raises:
        DataError: if it cannot be read.
        CalibrationError: if the format is unknown or the content cannot be right; names the file.
    """
    path = Path(path)
    try:
        document = load_document(path)
        return _format_of(document).parse(document.content if document else None, "m")
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from None


def _format_of(document: Document | None) -> _Format:
    for item in _FORMATS:
        if document and item.syntax == document.syntax and item.recognises(document.content):
            return item
    titles = ", ".join(item.title for item in _FORMATS)
    raise CalibrationError(f"no rig in a format that is known here; these are read: {titles}")


def write_rig(path: Path | str, rig: Rig, format: str | None = None) -> None:
    """Write a rig, whole or not at all.

    Args:
        format: one of `WRITABLE`; None takes it from the name: *.qca.txt, *.toml, else rig.json.

    Raises:
        UsageError: for an unknown format.
    """
    path = Path(path)
    chosen = next((item for item in _FORMATS if item.name == (format or _by_name(path))), None)
    if chosen is None or chosen.dump is None:
        raise UsageError(f"cannot write rigs as {format!r}; formats are {', '.join(WRITABLE)}")
    write_bytes(path, chosen.dump(rig).encode())


def _by_name(path: Path) -> str:
    return "qca" if path.name.endswith((".qca.txt", ".qca")) else "rig.json"
