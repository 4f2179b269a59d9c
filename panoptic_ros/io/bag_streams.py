"""Read camera streams from one or several bags, and merge their messages in the order of their timestamps."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, fields, replace
from itertools import islice
from pathlib import Path
from typing import Any

from panoptic_ros.domain import StampLine
from panoptic_ros.errors import DataError
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.cdr_heads import stamp_in, with_stamp
from panoptic_ros.io.foreign_people import ForeignPeople
from panoptic_ros.io.messages import depth_frame_from_message, frame_from_message, from_message, stamp_of
from panoptic_ros.io.messages.encodings import EncodingCheck, shown_by
from panoptic_ros.io.messages.family import decode_cdr
from panoptic_ros.io.messages.sensors import read_imu

SECOND = 1_000_000_000
# ns. A timestamp step that exceeds the step of the recording times by more than this is a clock jump.
JUMP_NS = 5 * SECOND
# Messages to try until one is usable: some drivers begin with an empty image.
TRIES = 10
DEPTH_KEYS = ("compressed_depth", "depth")  # if a camera has both topics, the last is read
SENSOR_KEYS = ("compressed_sensor_depth", "sensor_depth")  # as DEPTH_KEYS, for a depth sensor
TRACKS_KEY = "patch_tracks"
SOUND_KEY = "audio"
IMAGE_KEY = "image"
IMU_KEY = "imu"
GOES_ON, LEFT_OUT, IS_OVER = range(3)  # message class at the end of the range, see `BagStream._ended`
LOOKED_AT = 20  # messages from which the frame rate is estimated


@dataclass(frozen=True)
class BagStream:
    """One topic of one camera or audio device in a bag.

    Args:
        camera: Name of the camera or device.
        key: Key in `graph.topics.TOPICS`, which defines the content of the messages.
        arrival_stamps: Use the recording times instead of the header timestamps.
        shift_ns: Offset (ns) added to timestamps only to order the messages of several topics.
        from_sample: Audio only: blocks that end at or before this sample are skipped.
        line: Clock correction of the timestamps; messages with a corrected timestamp below 0 are skipped.
        people: Converter, if the messages are 2D poses of another software stack.
        encoding: Image encoding that overrides the encoding in the messages.
        until_ns: Messages with this timestamp (ns) or a later one are skipped.
    """

    bag: Path
    topic: str
    camera: str
    key: str
    arrival_stamps: bool = False
    shift_ns: int = 0
    from_sample: int = 0
    line: StampLine | None = None
    people: ForeignPeople | None = None
    encoding: str = ""
    until_ns: int | None = None

    @classmethod
    def from_words(cls, words: Mapping[str, Any]) -> BagStream:
        """Build a stream from the plain dictionary that `words` returns."""
        line, people = words["line"], words["people"]
        return cls(
            **{
                **words,
                "bag": Path(words["bag"]),
                "line": None if line is None else StampLine.from_words(line),
                "people": None if people is None else ForeignPeople.from_words(people),
            }
        )

    def words(self) -> dict[str, Any]:
        """Return the stream as a plain dictionary that can be written to a file."""
        own = {field.name: getattr(self, field.name) for field in fields(self)}
        line = None if self.line is None else self.line.words()
        people = None if self.people is None else self.people._asdict()
        return {**own, "bag": str(self.bag), "line": line, "people": people}

    def messages(self, bag: BagReader) -> Iterator[BagMessage | DataError]:
        """Yield all messages; yield an error for each message that cannot be decoded."""
        connection = bag.connection(self.topic)
        bad: list[DataError] = []
        rows = bag.raw(self.topic, on_bad=bad.append)
        ended = self._ended()
        for number, (_, arrival_ns, data, kind) in enumerate(rows):
            yield from bad
            bad.clear()
            data = with_stamp(data, arrival_ns) if self.arrival_stamps else data
            if self.line is not None and (before := stamp_in(data)) is not None:
                stamp = self.line.corrected(before)
                if stamp < 0:
                    continue
                data = with_stamp(data, stamp)
            if (end := ended(arrival_ns, data)) != GOES_ON:
                if end == IS_OVER:
                    break
                continue
            try:
                if self.people is None:
                    message = decode_cdr(data, kind)
                else:
                    data, message = self.people.detections(data, connection, self.camera, number)
            except DataError as error:
                yield self._named(error)
                continue
            if not self._is_early(message):
                yield BagMessage(self, arrival_ns, stamp_of(message.header), bytes(data), message)
        yield from bad

    def _ended(self) -> Callable[[int, bytes], int]:
        """Return a function that classifies a message by its recording time (ns) and its bytes.

        GOES_ON: the message is before the end. LEFT_OUT: its timestamp is at or after the end. IS_OVER: all
        later messages are also after the end, according to the recording times. Timestamps may jump,
        recording times do not.
        """
        begin: list[int] = []

        def ended(arrival_ns: int, data: bytes) -> int:
            stamp = None if self.until_ns is None else stamp_in(data)
            if self.until_ns is None or stamp is None:
                return GOES_ON
            if not begin:
                begin.extend((stamp, arrival_ns))
            if stamp < self.until_ns:
                return GOES_ON
            late = arrival_ns - begin[1] > self.until_ns - begin[0] + JUMP_NS
            return IS_OVER if late else LEFT_OUT

        return ended

    def _is_early(self, message: Any) -> bool:
        """Return whether the message is an audio block that ends at or before `from_sample`."""
        if self.key != SOUND_KEY or not self.from_sample:
            return False
        count = len(message.samples) // max(1, message.channels)
        return bool(message.first_sample + count <= self.from_sample)

    def record(self, message: Any, number: int) -> Any:
        """Convert a message to its record: detections, patch tracks, IMU sample, audio block or frame.

        Args:
            number: frame number for images and depth images.

        Raises:
            DataError: naming the bag and the topic.
        """
        try:
            if self.key == "detections":
                return self._own(from_message(message, "ViewDetections"))
            if self.key == IMU_KEY:
                return read_imu(message, self.camera)
            if self.key == SOUND_KEY:
                return from_message(message, "AudioBlock")
            if self.key == TRACKS_KEY:
                return self._own(from_message(message, "PatchTracks"))
            if self.key in (*DEPTH_KEYS, *SENSOR_KEYS):
                return depth_frame_from_message(message, self.camera, number)
            return frame_from_message(message, self.camera, number, self.encoding)
        except DataError as error:
            raise self._named(error) from None

    def _own(self, record: Any) -> Any:
        """Return the record if it belongs to this camera.

        Raises:
            DataError: if it belongs to another camera.
        """
        if record.camera != self.camera:
            raise DataError(f"detections of camera {record.camera[:40]}, not of {self.camera}; left out")
        return record

    def first_record(self, bag: BagReader) -> Any:
        """Return the first usable record among the first TRIES messages.

        Raises:
            DataError: if none of them is usable, or the topic has no messages.
        """
        problem = DataError(f"{self.bag}: topic {self.topic} has no messages")
        for number, item in enumerate(islice(self.messages(bag), TRIES)):
            try:
                if isinstance(item, DataError):
                    raise item
                return self.record(item.message, number)
            except DataError as error:
                problem = error
        raise problem

    def shown_encoding(self, bag: BagReader) -> EncodingCheck:
        """Estimate the pixel encoding from the first raw images, unless `encoding` is given."""
        if self.key != IMAGE_KEY or self.encoding:
            return EncodingCheck("", "")
        for item in islice(self.messages(bag), TRIES):
            with suppress(DataError):
                if isinstance(item, BagMessage) and (shown := shown_by(item.message, self.topic)):
                    return shown
        return EncodingCheck("", "")

    def first_stamps(self, bag: BagReader) -> list[int]:
        """Return the timestamps (ns) of the first messages."""
        first = islice(self.messages(bag), LOOKED_AT)
        return [item.stamp_ns for item in first if isinstance(item, BagMessage)]

    def _named(self, error: DataError) -> DataError:
        return DataError(f"{self.bag}, topic {self.topic}: {error}")


@dataclass(frozen=True)
class BagMessage:
    """A message of a stream: recording time (ns), timestamp (ns), CDR bytes and the decoded message.

    Args:
        place_ns: merge key (ns): the timestamp plus `shift_ns`, made continuous across clock jumps.
    """

    stream: BagStream
    arrival_ns: int
    stamp_ns: int
    data: bytes
    message: Any
    place_ns: int = 0


@dataclass(frozen=True)
class StreamEnd:
    """Mark of the end of a stream."""

    stream: BagStream
    place_ns: int


def merged(
    streams: Sequence[BagStream], on_bad: Callable[[DataError], None]
) -> Iterator[BagMessage | StreamEnd]:
    """Yield the messages of all streams in the order of their timestamps, and the end of each stream.

    At a clock jump of a camera, its merge key advances by the recording time instead. A jump would otherwise
    place the camera hours before or after the others.

    Args:
        on_bad: called with the error of every message that cannot be decoded. The message is skipped.
    """
    with ExitStack() as stack:
        placed = [
            _placed(order, stream, bag, on_bad) for order, (stream, bag) in enumerate(_bags(streams, stack))
        ]
        for _, _, item in heapq.merge(*placed, key=lambda row: row[:2]):
            yield item


def opened_streams(
    streams: Sequence[BagStream], stack: ExitStack, on_bad: Callable[[DataError], None]
) -> Iterator[tuple[BagStream, Iterator[Any]]]:
    """Yield every stream with an iterator of its records; the iterators are independent.

    Args:
        stack: closes the bags.
        on_bad: called with the error of every message that cannot be used. The message is skipped.
    """
    for stream, bag in _bags(streams, stack):
        yield stream, _records(stream, bag, on_bad)


def _bags(streams: Sequence[BagStream], stack: ExitStack) -> Iterator[tuple[BagStream, BagReader]]:
    """Yield every stream with the reader of its bag; streams of one bag share the reader."""
    opened: dict[Path, BagReader] = {}
    for stream in streams:
        if stream.bag not in opened:
            opened[stream.bag] = stack.enter_context(BagReader(stream.bag))
        yield stream, opened[stream.bag]


def _records(stream: BagStream, bag: BagReader, on_bad: Callable[[DataError], None]) -> Iterator[Any]:
    number = 0
    for item in stream.messages(bag):
        if isinstance(item, DataError):
            on_bad(item)
            continue
        try:
            yield stream.record(item.message, number)
        except DataError as error:
            on_bad(error)
        number += 1


def _placed(
    order: int, stream: BagStream, bag: BagReader, on_bad: Callable[[DataError], None]
) -> Iterator[tuple[int, int, BagMessage | StreamEnd]]:
    place, last = 0, None
    for item in stream.messages(bag):
        if isinstance(item, DataError):
            on_bad(item)
            continue
        if last is None:
            place = item.stamp_ns + item.stream.shift_ns
        else:
            step, recorded = item.stamp_ns - last.stamp_ns, max(0, item.arrival_ns - last.arrival_ns)
            place += step if 0 < step <= recorded + JUMP_NS else recorded
        last = item
        yield place, order, replace(item, place_ns=place)
    yield place, order, StreamEnd(stream, place)
