"""Which topics of bags are whose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from panoptic_ros.domain import Rig
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.graph.topics import TOPICS, ros_name
from panoptic_ros.io.bag_streams import DEPTH_KEYS, IMU_KEY, SENSOR_KEYS, TRACKS_KEY, BagStream
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.foreign_people import ForeignPeople
from panoptic_ros.io.messages.encodings import BAYER, encoding_of, is_mosaic
from panoptic_ros.io.messages.images import is_video, video_told
from panoptic_ros.io.messages.rpt import KIND as POSES

KEYS = ("detections", "image", "compressed_image")  # what a run can begin with, the best first


@dataclass(frozen=True)
class BagChoice:
    """What is taken from bags where they leave a choice.

    Args:
        cameras: use only these; None: all of the rig.
        topics: of images or detections by camera, where it does not tell by its name.
        depth_topics: the same for depth maps.
        arrival_stamps: times of recording in place of the stamps in headers.
        redetect: use images, not detections.
        encodings: of images by camera, overrides what they state; "" stands for all other cameras.
    """

    cameras: Sequence[str] | None = None
    topics: Mapping[str, str] = field(default_factory=dict)
    depth_topics: Mapping[str, str] = field(default_factory=dict)
    arrival_stamps: bool = False
    redetect: bool = False
    encodings: Mapping[str, str] = field(default_factory=dict)

    def encoding(self, camera: str) -> str:
        """Return the encoding of a camera; "" = the one that its images state."""
        return self.encodings.get(camera, self.encodings.get("", ""))


def image_streams(
    choice: BagChoice, bags: Sequence[BagReader], rig: Rig, skeleton: str
) -> tuple[BagStream, ...]:
    """The streams of the best kind there is, in the order of the rig's cameras.

    Args:
        skeleton: the working skeleton, for 2D people of another stack.

    Raises:
        DataError: if there are none, or a camera may be several topics.
    """
    given = choice.topics
    for camera in (*given, *filter(None, choice.encodings)):
        rig.camera(camera)  # a wrong name is told
    for camera, encoding in choice.encodings.items():
        encoding_of(encoding, f"--encoding {camera}".strip())
    for key in KEYS[1:] if choice.redetect else KEYS:
        found = _of_kind(choice, bags, key, rig.names, given)
        if not found and key == "detections":
            found = _foreign_people(choice, bags, rig, skeleton)
        if found:
            _check_encodings(choice, found)
            return found
    if videos := [video_told(topic, kind) for topic, kind in _videos(bags).items()]:
        more = f" (so are {len(videos) - 1} more topics)" if len(videos) > 1 else ""
        raise DataError(f"{names_of(bags)}: {videos[0]}{more}")
    missing = [topic for topic in given.values() if not any(topic in bag.topics for bag in bags)]
    lacking = f"no topic {missing[0]}" if missing else "no images and no detections"
    raise DataError(
        f"{names_of(bags)} has {lacking} of the cameras {', '.join(rig.names)}; "
        "name their topics with --topic CAMERA=TOPIC; there are "
        f"{', '.join(sorted({t for bag in bags for t in bag.topics})) or 'no topics'}"
    )


def usable_streams(
    streams: Sequence[BagStream], bags: Sequence[BagReader], choice: BagChoice
) -> tuple[tuple[BagStream, ...], dict[str, str]]:
    """The streams whose first messages can be used, and by camera a line for each of the others.

    Raises:
        DataError: if none can be used, or one cannot whose topic was asked for.
    """
    usable, errors = [], dict[str, DataError]()
    for stream in streams:
        try:
            stream.first_record(next(bag for bag in bags if bag.path == stream.bag))
            usable.append(stream)
        except DataError as error:
            errors[stream.camera] = error
            if stream.camera in choice.topics:
                raise
    if not usable:
        raise next(iter(errors.values()))
    return tuple(usable), {name: f"camera {name} is left out: {error}" for name, error in errors.items()}


def _check_encodings(choice: BagChoice, streams: Sequence[BagStream]) -> None:
    """Check that encodings are asked for of images that state one.

    Raises:
        UsageError: if not.
    """
    if choice.encodings and streams[0].key == "detections":
        raise UsageError("--encoding has no meaning for recorded detections; --redetect uses the images")
    for stream in streams:
        if stream.key == "compressed_image" and not is_mosaic(stream.encoding or BAYER):
            told = f"--encoding {stream.encoding} has no meaning for {stream.topic}"
            raise UsageError(f"{told}, whose pictures are compressed")


def with_encodings(
    streams: Sequence[BagStream], bags: Sequence[BagReader]
) -> tuple[tuple[BagStream, ...], list[str]]:
    """Return the streams with the encodings that their first images show, and lines about those."""
    shown = [(s, s.shown_encoding(next(bag for bag in bags if bag.path == s.bag))) for s in streams]
    lines = [found.told for _, found in shown if found.told]
    return tuple(replace(s, encoding=s.encoding or found.encoding) for s, found in shown), lines


def absent_told(camera: str, bags: Sequence[BagReader]) -> str:
    """Return the line about a camera of the rig that has nothing in the bags that is read."""
    for topic, kind in _videos(bags).items():
        if ros_name(camera) in topic.split("/"):
            return f"camera {camera} is left out: {video_told(topic, kind)}"
    return f"camera {camera} of the rig is not in the bag"


def _videos(bags: Sequence[BagReader]) -> dict[str, str]:
    """Return the topics that hold packets of videos, with their types."""
    return {t: kind for bag in bags for t, kind in bag.topics.items() if is_video(kind) and bag.counts[t]}


def depth_streams(
    choice: BagChoice, bags: Sequence[BagReader], rig: Rig, streams: Sequence[BagStream]
) -> tuple[tuple[BagStream, ...], list[str]]:
    """The streams of depth maps of cameras with images, and a line for each that cannot be read.

    Raises:
        DataError: if one that is asked for is not there, or a camera may be several topics.
    """
    given = choice.depth_topics
    for camera in given:
        rig.camera(camera)  # a wrong name is told
    cameras = [stream.camera for stream in streams if stream.key != "detections"]  # which know their depth
    found = {s.camera: s for key in DEPTH_KEYS for s in _of_kind(choice, bags, key, cameras, given)}
    for camera, topic in given.items():
        if camera not in found:
            raise DataError(f"{names_of(bags)}: no images of camera {camera}, or no depth maps on {topic}")
    readable, problems = [], []
    for stream in found.values():
        try:
            stream.first_record(next(bag for bag in bags if bag.path == stream.bag))
            readable.append(stream)
        except DataError as error:
            problems.append(f"camera {stream.camera} goes without its depth maps: {error}")
    return tuple(readable), problems


def patch_streams(
    choice: BagChoice, bags: Sequence[BagReader], rig: Rig, streams: Sequence[BagStream]
) -> tuple[BagStream, ...]:
    """What patches take besides: maps of depth sensors, and 2D tracks where detections are used.

    Raises:
        DataError: if a camera or sensor may be several topics.
    """
    sensors = [sensor.name for sensor in rig.depth_sensors]
    found = {s.camera: s for key in SENSOR_KEYS for s in _of_kind(choice, bags, key, sensors, {})}
    looked_at = [stream.camera for stream in streams if stream.key == "detections"]
    return (*found.values(), *_of_kind(choice, bags, TRACKS_KEY, looked_at, {}))


def imu_streams(bags: Sequence[BagReader], arrival_stamps: bool = False) -> tuple[BagStream, ...]:
    """The topics of IMUs, /<device>/imu in any namespace; of several of one device the first."""
    kind, found = TOPICS[IMU_KEY].message, dict[str, BagStream]()
    for bag in bags:
        for topic in sorted(topic for topic, own in bag.topics.items() if own == kind and bag.counts[topic]):
            device = topic.strip("/").split("/")[-2] if topic.count("/") > 1 else topic.strip("/")
            found.setdefault(device, BagStream(bag.path, topic, device, IMU_KEY, arrival_stamps))
    return tuple(found.values())


def _of_kind(
    choice: BagChoice,
    bags: Sequence[BagReader],
    key: str,
    cameras: Sequence[str],
    given: Mapping[str, str],
) -> tuple[BagStream, ...]:
    """The streams of one kind that there are."""
    places = {camera: _find(bags, key, camera, given.get(camera)) for camera in cameras}
    return tuple(
        BagStream(
            bag.path,
            topic,
            camera,
            key,
            choice.arrival_stamps,
            encoding=choice.encoding(camera) if key in KEYS[1:] else "",
        )
        for camera, (bag, topic) in places.items()
        if topic
    )


def _find(bags: Sequence[BagReader], key: str, camera: str, given: str | None) -> tuple[BagReader, str]:
    """The bag and the topic of that kind of a camera; the topic is empty if there is none.

    A topic of the right type that ends as the camera's own does is taken for it, so that recordings of a
    graph in a namespace need nothing more.
    """
    usual = "/" + TOPICS[key].of(camera)
    rows = _topics_of(bags, TOPICS[key].message)
    if given is not None:
        found = [row for row in rows if row[1] == given]
    else:
        found = [row for row in rows if row[1] == usual] or [row for row in rows if row[1].endswith(usual)]
    return _the_only(found, bags, key, camera)


def _foreign_people(
    choice: BagChoice, bags: Sequence[BagReader], rig: Rig, skeleton: str
) -> tuple[BagStream, ...]:
    """2D people of another stack, on topics that have the camera's name among their words."""
    rows, found = _topics_of(bags, POSES), []
    for camera in rig.cameras:
        name, given = ros_name(camera.name), choice.topics.get(camera.name)
        own = [row for row in rows if (row[1] == given if given else name in row[1].split("/"))]
        bag, topic = _the_only(own, bags, "detections", camera.name)
        people = ForeignPeople(camera.image_size, skeleton)
        if topic:
            stream = BagStream(bag.path, topic, camera.name, "detections", choice.arrival_stamps)
            found.append(replace(stream, people=people))
    return tuple(found)


def _topics_of(bags: Sequence[BagReader], kind: str) -> list[tuple[BagReader, str]]:
    """Topics with messages of a type."""
    return [
        (bag, topic) for bag in bags for topic, own in bag.topics.items() if own == kind and bag.counts[topic]
    ]


def _the_only(
    found: Sequence[tuple[BagReader, str]], bags: Sequence[BagReader], key: str, camera: str
) -> tuple[BagReader, str]:
    """The one that was found; an empty topic if none was."""
    if len(found) > 1:
        option = "--depth-topic" if key in DEPTH_KEYS else "--topic"
        places = " and ".join(f"{topic} in {bag.path}" for bag, topic in found[:2])
        raise DataError(f"camera {camera} may be {places}; choose with {option} {camera}=TOPIC or other bags")
    return found[0] if found else (bags[0], "")


def names_of(bags: Sequence[BagReader]) -> str:
    """The paths of bags, for messages."""
    return " and ".join(str(bag.path) for bag in bags)
