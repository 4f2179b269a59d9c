"""A bag of an earlier version, written anew with the messages of now."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from panoptic_ros.errors import DataError
from panoptic_ros.io.bags import BagReader, BagWriter


@dataclass(frozen=True)
class Upgrade:
    """What came of it.

    Args:
        brought_up: topics whose messages are new. kept: those that are as they were.
        left_out: topics whose messages cannot be brought up, each with the kind of its messages.
    """

    brought_up: tuple[str, ...]
    kept: tuple[str, ...]
    left_out: dict[str, str]


def upgrade(source: Path, target: Path) -> Upgrade | None:
    """Write a bag anew; None, and nothing is written, if all of it is of this version.

    Messages of other packages are copied with their own definitions.

    Args:
        target: must not be there yet.

    Raises:
        DataError: if the bag cannot be read, or nothing in it can be brought up.
    """
    with BagReader(source) as bag:
        outdated = [topic for topic in bag.topics if bag.is_outdated(topic)]
        if not outdated:
            return None
        left_out = {topic: bag.topics[topic] for topic in outdated if not bag.can_be_brought_up(topic)}
        wanted = [topic for topic in bag.topics if topic not in left_out]
        if not wanted:
            raise DataError(f"{source}: nothing in it can be brought up; make the bag anew from the capture")
        with BagWriter(target) as new:
            for topic, stamp_ns, data, kind in bag.raw(*wanted):
                if topic in outdated:
                    new.write_raw(topic, kind, stamp_ns, data)
                else:
                    new.write_described(bag.connection(topic), stamp_ns, data)
    kept = tuple(topic for topic in wanted if topic not in outdated)
    return Upgrade(tuple(topic for topic in outdated if topic not in left_out), kept, left_out)
