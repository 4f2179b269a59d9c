"""Presence of people over time: the spans in which each id is tracked, for a time line."""

from __future__ import annotations

from collections.abc import Collection

from panoptic_ros.io.messages.family import decode_cdr

GAP_S = 1.0  # s; an id that is absent for longer starts a new span
SKELETONS = "panoptic_msgs/msg/Skeletons"


class PresenceSpans:
    """Time spans of each id's presence, in the order of their beginnings."""

    def __init__(self) -> None:
        # [id, first, last], times in s from the beginning of the recording
        self.spans: list[list[float]] = []
        self.complete = False
        self._open: dict[int, list[float]] = {}

    def saw(self, time_s: float, ids: Collection[int]) -> None:
        """Record the ids present at an instant; instants must come in order."""
        for identity in ids:
            span = self._open.get(identity)
            if span is None or time_s - span[2] > GAP_S:
                span = self._open[identity] = [identity, time_s, time_s]
                self.spans.append(span)
            span[2] = time_s


def ids_of(data: bytes) -> list[int]:
    """Return the ids of the people in the CDR bytes of a panoptic_msgs/Skeletons.

    Raises:
        DataError: If they cannot be decoded.
    """
    return [int(person.id) for person in decode_cdr(data, SKELETONS).skeletons]
