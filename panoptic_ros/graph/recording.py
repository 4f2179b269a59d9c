"""A recording in memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any


class HeldRecording:
    """Records that are held in memory, as a `stage.Recording`.

    Args:
        records: by topic, or by topic and scope; each in the order of its stamps.
    """

    def __init__(self, records: Mapping[str | tuple[str, str], Iterable[Any]]):
        self._records: dict[tuple[str, str], Sequence[Any]] = {
            (key, "") if isinstance(key, str) else key: tuple(items) for key, items in records.items()
        }

    def records(
        self, topic: str, scope: str = "", begin_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[Any]:
        """See `stage.Recording`; nothing of a topic that is not there."""
        for record in self._records.get((topic, scope), ()):
            if (begin_ns is None or record.stamp_ns >= begin_ns) and (
                end_ns is None or record.stamp_ns < end_ns
            ):
                yield record
