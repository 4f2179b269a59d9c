"""Messages that records came as: inside of another message a record goes on as it came, not written anew."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

INSIDE = {  # what the messages of a record hold inside that comes from another node
    "DetectionSet": "ViewDetections",
    "AssociationSet": "DetectionSet",
    "ProposalSet": "AssociationSet",
}
MOST = 64  # kept; what is older is written anew


class Origins:
    """Keeps the messages of the newest records.

    Args:
        given: names of the records whose messages are made of them; others need none.
    """

    def __init__(self, given: Iterable[str] = ()):
        self._kinds = {INSIDE[name] for name in given if name in INSIDE}
        self._kept: dict[int, tuple[Any, Any]] = {}  # by id of the record, which lives as long as it is here

    def keep(self, record: Any, message: Any) -> None:
        """A record came as this message."""
        if type(record).__name__ not in self._kinds:
            return
        self._kept[id(record)] = record, message
        if len(self._kept) > MOST:
            del self._kept[next(iter(self._kept))]

    def of(self, record: Any) -> Any | None:
        """The message that a record came as, if it is still here."""
        found = self._kept.get(id(record))
        return None if found is None else found[1]
