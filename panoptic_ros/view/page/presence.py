"""Who is there when: where ids begin and end on a time line."""

from __future__ import annotations

from collections.abc import Collection

from panoptic_ros.io.messages.family import decode_cdr

GAP_S = 1.0  # an id that is away for longer ends, and begins again
SKELETONS = "panoptic_msgs/msg/Skeletons"


class Presence:
    """Spans of time in which each id is there, in the order of their beginnings."""

    def __init__(self) -> None:
        self.spans: list[list[float]] = []  # [id, first, last], s from the beginning
        self.complete = False
        self._open: dict[int, list[float]] = {}

    def saw(self, time_s: float, ids: Collection[int]) -> None:
        """These were there at an instant; instants come in order."""
        for identity in ids:
            span = self._open.get(identity)
            if span is None or time_s - span[2] > GAP_S:
                span = self._open[identity] = [identity, time_s, time_s]
                self.spans.append(span)
            span[2] = time_s


def ids_of(data: bytes) -> list[int]:
    """Ids of the people in the CDR bytes of a panoptic_msgs/Skeletons.

    Raises:
        DataError: if they cannot be decoded.
    """
    return [int(person.id) for person in decode_cdr(data, SKELETONS).skeletons]
