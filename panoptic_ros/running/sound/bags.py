"""Reads the sound in bags."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack

from panoptic_ros.domain import AudioBlock
from panoptic_ros.errors import DataError
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bag_streams import SOUND_KEY, BagStream, opened_streams
from panoptic_ros.io.bags import BagReader
from panoptic_ros.running.sound.use import SoundRecorder


def sound_streams(bags: Sequence[BagReader], arrival_stamps: bool = False) -> tuple[BagStream, ...]:
    """Return the sound topics, one per device. If a device has several, the first one counts."""
    kind, found = TOPICS[SOUND_KEY].message, dict[str, BagStream]()
    for bag in bags:
        for topic in sorted(topic for topic, own in bag.topics.items() if own == kind and bag.counts[topic]):
            device = BagStream(bag.path, topic, topic, SOUND_KEY).first_record(bag).device
            found.setdefault(device, BagStream(bag.path, topic, device, SOUND_KEY, arrival_stamps))
    return tuple(found.values())


def recorder_of(stream: BagStream) -> SoundRecorder:
    """Return the recorder of a stream, with the clocks that its first block names."""

    def blocks() -> Iterator[AudioBlock]:
        with ExitStack() as stack:
            ((_, records),) = opened_streams([stream], stack, _leave_out)
            yield from records

    with BagReader(stream.bag) as bag:
        clocks = stream.first_record(bag).clocks
    return SoundRecorder(stream.camera, clocks, f"topic {stream.topic}", blocks)


def _leave_out(error: DataError) -> None:
    """Ignore an unusable record here. The run counts it when it reads it."""
