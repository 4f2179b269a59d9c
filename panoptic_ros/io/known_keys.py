"""Declare the keys of a document format with `keys`, and warn of unknown keys with `tell_unknown`.

Input: a parsed JSON, YAML or TOML document and the keys of its format. Output: a warning for each unused key,
with the nearest known key. Parameters and model cards refuse unknown keys themselves.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

from panoptic_ros.errors import nearest, plain, shown

# Maps a key to None, to the `Keys` of a nested table, or to a list of one `Keys` for a list of tables.
Keys = Mapping[str, Any]
EACH = "*"  # among known keys: matches any user-chosen name
# Among known keys: other programs write further keys, which are only reported if they look misspelt.
OTHERS = "..."
MARKS = (EACH, OTHERS)
MOST_TOLD = 5  # keys reported for one document
MOST_COMPARED = 1000  # unknown keys compared with known ones, in tables with OTHERS


class UnknownKeyWarning(UserWarning):
    """A document has a key that its reader does not know and does not use."""


def keys(words: str = "", **inner: Any) -> dict[str, Any]:
    """Return the keys of a table: `words` have no nested keys, `inner` maps names to nested keys."""
    return {**dict.fromkeys(words.split()), **inner}


def tell_unknown(document: Any, known: Any, path: Path | str) -> None:
    """Warn of each unknown key with the nearest known one, one line each.

    A value that is not a table where one is expected is left to the reader.

    Args:
        known: `Keys` of a table, or a list of one `Keys` for a list of tables.
        path: named in warnings.
    """
    search = _UnknownKeySearch()
    search.look(document, known, "")
    if not search.found:
        return
    places = list(_places(known, ""))
    for (place, key), count in islice(search.found.items(), MOST_TOLD):
        _warn(f"{path}: {_line(place, key, places, count)}")
    if len(search.found) > MOST_TOLD:
        _warn(f"{path}: {len(search.found) - MOST_TOLD} more keys are not known and not used")


def _warn(text: str) -> None:
    warnings.warn(text, UnknownKeyWarning, stacklevel=3)


class _UnknownKeySearch:
    """Search for unknown keys in a document.

    Attributes:
        found: number of occurrences by (place of the table, key).
    """

    def __init__(self) -> None:
        self.found: dict[tuple[str, str], int] = {}
        self._compared: dict[tuple[str, str], bool] = {}

    def look(self, value: Any, known: Any, place: str) -> None:
        """Search a value and its nested tables; `place` is its dotted path."""
        if isinstance(known, list):
            for entry in value if isinstance(value, list) else ():
                self.look(entry, known[0], place)
            return
        if not isinstance(value, Mapping):
            return
        if EACH not in known and not value.keys() <= known.keys():
            self._take(value, known, place)
        for key, inner in known.items():
            if inner is None:
                continue
            below = f"{place}.{key}" if place else key
            if key == EACH:
                for name, entry in value.items():
                    if name not in known:
                        self.look(entry, inner, below)
            elif key in value:
                self.look(value[key], inner, below)

    def _take(self, table: Mapping[Any, Any], known: Keys, place: str) -> None:
        for key in table:
            at = place, str(key)
            if key not in known and (OTHERS not in known or self._is_misspelt(at, table, known)):
                self.found[at] = self.found.get(at, 0) + 1

    def _is_misspelt(self, at: tuple[str, str], table: Mapping[Any, Any], known: Keys) -> bool:
        """Return whether a key resembles a known one that the table lacks."""
        if at not in self._compared and len(self._compared) < MOST_COMPARED:
            absent = [name for name in _words(known) if name not in table]
            self._compared[at] = nearest(at[1], absent).startswith("the nearest")
        return self._compared.get(at, False)


def _line(place: str, key: str, places: list[tuple[str, Keys]], count: int) -> str:
    own = [word for at, known in places if at == place for word in _words(known)]
    others = [at for at, known in places if at != place and plain(key) in map(plain, _words(known))]
    hint = nearest(key, own)
    if others and plain(key) not in map(plain, own):
        hint = f"it belongs in {others[0] or 'the outermost table'}"
    where = f"{place}: " if place else ""
    often = f" ({count} times)" if count > 1 else ""
    return f"{where}the key {shown(key)}{often} is not known and not used; {hint}"


def _words(known: Keys) -> Iterable[str]:
    return (word for word in known if word not in MARKS)


def _places(known: Any, place: str) -> Iterator[tuple[str, Keys]]:
    """Yield every table of known keys with its dotted path."""
    table = known[0] if isinstance(known, list) else known
    yield place, table
    for key, inner in table.items():
        if inner is not None:
            yield from _places(inner, f"{place}.{key}" if place else key)
