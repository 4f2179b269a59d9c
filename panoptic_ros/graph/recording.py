"""Recording in memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any


class InMemoryRecording:
    """Records in memory, as a `stage.Recording`.

    Args:
        records: By topic, or by (topic, scope). Each sequence is in the order of timestamps.
    """

    def __init__(self, records: Mapping[str | tuple[str, str], Iterable[Any]]):
        self._records: dict[tuple[str, str], Sequence[Any]] = {
            (key, "") if isinstance(key, str) else key: tuple(items) for key, items in records.items()
        }

    def records(
        self, topic: str, scope: str = "", begin_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[Any]:
        """Yield records as `stage.Recording` does; nothing for a missing topic."""
        for record in self._records.get((topic, scope), ()):
            if (begin_ns is None or record.stamp_ns >= begin_ns) and (
                end_ns is None or record.stamp_ns < end_ns
            ):
                yield record
