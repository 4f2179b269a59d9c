"""What nodes count as dropped, put together over their restarts, after which they count from 0 again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

PREFIX = "dropped."  # of values on /diagnostics


class DropLog:
    """Listens to statuses. Times are of any clock, ns."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()  # by "<status>.<cause>"
        self.times: list[tuple[int, str]] = []  # when each was seen to go up
        self._seen: dict[str, int] = {}  # what the node of now has counted

    def heard(self, status: str, values: Mapping[str, str], now_ns: int) -> None:
        """A status of a node has come."""
        for key, value in values.items():
            if not key.startswith(PREFIX):
                continue
            name, count = f"{status}.{key.removeprefix(PREFIX)}", int(value)
            before = self._seen.get(name, 0)
            more = count - before if count >= before else count
            self._seen[name] = count
            if more:
                self.counts[name] += more
                self.times.append((now_ns, name))
