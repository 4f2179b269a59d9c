"""Assigns the topics of bags to cameras, depth sensors and IMUs."""

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

KEYS = ("detections", "image", "compressed_image")  # topics that a run can begin with, best first


@dataclass(frozen=True)
class BagChoice:
    """Options that select the content of bags.

    Args:
        cameras: Names of the cameras to use; None = all of the rig.
        topics: Topic of images or detections by camera, for topics whose name does not identify the camera.
        depth_topics: The same for depth maps.
        arrival_stamps: Use the recording times instead of the header timestamps.
        redetect: Use images, not recorded detections.
        encodings: Image encoding by camera, which overrides the stated one; "" stands for all other cameras.
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
    """Return the streams of the best available kind, in the order of the rig's cameras.

    Args:
        skeleton: the working skeleton, for 2D poses from another software stack.

    Raises:
        DataError: if there are none, or several topics match one camera.
    """
    given = choice.topics
    for camera in (*given, *filter(None, choice.encodings)):
        rig.camera(camera)  # raises an error for an unknown camera
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


def camera_image_streams(bag: BagReader) -> tuple[BagStream, ...]:
    """Return one stream of images for each camera of a bag without calibration, see `topics_by_camera`.

    Raises:
        DataError: if the bag has no images, or two topics belong to one camera.
    """
    kinds = {topic: kind for topic, kind in bag.topics.items() if bag.counts[topic]}
    found = topics_by_camera(kinds, str(bag.path))
    if not found:
        there = ", ".join(sorted(bag.topics)) or "no topics"
        raise DataError(f"{bag.path} has no images; there are {there}")
    return tuple(BagStream(bag.path, topic, camera, key) for camera, (topic, key) in found.items())


def topics_by_camera(kinds: Mapping[str, str], where: str) -> dict[str, tuple[str, str]]:
    """Return the topic of images and its key in `TOPICS` for each camera, sorted by camera.

    The name of a camera is the last word of its namespace that differs between cameras. Topics
    /cam_1/color/image_raw and /cam_2/color/image_raw belong to cam_1 and cam_2. Raw images are preferred to
    compressed ones.

    Args:
        kinds: Message type by topic.
        where: Origin of the topics, for the message.

    Raises:
        DataError: if two topics belong to one camera.
    """
    found: dict[tuple[str, ...], tuple[str, str]] = {}
    for key in reversed(KEYS[1:]):
        for topic in (topic for topic, kind in kinds.items() if kind == TOPICS[key].message):
            words = [word for word in topic.split("/") if word]
            words = words[:-1] if words[-1] == "compressed" else words
            if "depth" not in topic and "disparity" not in topic:
                found[tuple(words[:-1] or words)] = topic, key
    shared = 0
    while (
        len(found) > 1 and len({space[len(space) - 1 - shared : len(space) - shared] for space in found}) == 1
    ):
        shared += 1
    named: dict[str, tuple[str, str]] = {}
    for space, (topic, key) in sorted(found.items()):
        name = (space[: len(space) - shared] or space)[-1]
        if name in named:
            raise DataError(
                f"{where}: topics {named[name][0]} and {topic} belong to one camera {name}; use one of them"
            )
        named[name] = topic, key
    return named


def usable_streams(
    streams: Sequence[BagStream], bags: Sequence[BagReader], choice: BagChoice
) -> tuple[tuple[BagStream, ...], dict[str, str]]:
    """Return the streams whose first message is usable, and by camera a line about each other stream.

    Raises:
        DataError: if no stream is usable, or a stream that the user selected is not.
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
    """Check that the requested encodings belong to images that state one.

    Raises:
        UsageError: if they do not.
    """
    if choice.encodings and streams[0].key == "detections":
        raise UsageError("--encoding has no meaning for recorded detections; --redetect uses the images")
    for stream in streams:
        if stream.key == "compressed_image" and not is_mosaic(stream.encoding or BAYER):
            told = f"--encoding {stream.encoding} has no meaning for {stream.topic}"
            raise UsageError(f"{told}, as its images are compressed")


def with_encodings(
    streams: Sequence[BagStream], bags: Sequence[BagReader]
) -> tuple[tuple[BagStream, ...], list[str]]:
    """Return the streams with the encodings that their first images show, and lines about these encodings."""
    shown = [(s, s.shown_encoding(next(bag for bag in bags if bag.path == s.bag))) for s in streams]
    lines = [found.told for _, found in shown if found.told]
    return tuple(replace(s, encoding=s.encoding or found.encoding) for s, found in shown), lines


def absent_told(camera: str, bags: Sequence[BagReader]) -> str:
    """Return a line about a camera of the rig without a readable topic in the bags."""
    for topic, kind in _videos(bags).items():
        if ros_name(camera) in topic.split("/"):
            return f"camera {camera} is left out: {video_told(topic, kind)}"
    return f"camera {camera} of the rig is not in the bag"


def _videos(bags: Sequence[BagReader]) -> dict[str, str]:
    """Return the topics that hold video packets, with their message types."""
    return {t: kind for bag in bags for t, kind in bag.topics.items() if is_video(kind) and bag.counts[t]}


def depth_streams(
    choice: BagChoice, bags: Sequence[BagReader], rig: Rig, streams: Sequence[BagStream]
) -> tuple[tuple[BagStream, ...], list[str]]:
    """Return the depth-map streams of cameras with images, and a line about each unreadable one.

    Raises:
        DataError: if a requested topic does not exist, or several topics match one camera.
    """
    given = choice.depth_topics
    for camera in given:
        rig.camera(camera)  # raises an error for an unknown camera
    # recorded detections include their depth limits
    cameras = [stream.camera for stream in streams if stream.key != "detections"]
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
    """Return the additional inputs of patches: depth-sensor maps and 2D tracks.

    2D tracks are used for cameras with recorded detections.

    Raises:
        DataError: if several topics match one camera or sensor.
    """
    sensors = [sensor.name for sensor in rig.depth_sensors]
    found = {s.camera: s for key in SENSOR_KEYS for s in _of_kind(choice, bags, key, sensors, {})}
    looked_at = [stream.camera for stream in streams if stream.key == "detections"]
    return (*found.values(), *_of_kind(choice, bags, TRACKS_KEY, looked_at, {}))


def imu_streams(bags: Sequence[BagReader], arrival_stamps: bool = False) -> tuple[BagStream, ...]:
    """Return the IMU topics, /<device>/imu in any namespace. The first topic of each device counts."""
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
    """Return all streams of one kind.

    Args:
        given: topic by camera, as selected by the user.
    """
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
    """Return bag and topic of one kind for a camera; the topic is "" if there is none.

    A topic of the right type also matches if its name ends like the camera's default topic. So recordings of
    a graph in a namespace need no options.
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
    """Return the streams of 2D poses from another software stack.

    Their topic names contain the camera's name as one of their words.
    """
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
    """Return all topics of one message type that contain messages."""
    return [
        (bag, topic) for bag in bags for topic, own in bag.topics.items() if own == kind and bag.counts[topic]
    ]


def _the_only(
    found: Sequence[tuple[BagReader, str]], bags: Sequence[BagReader], key: str, camera: str
) -> tuple[BagReader, str]:
    """Return the only topic of a list; "" if the list is empty.

    Raises:
        DataError: if there are several.
    """
    if len(found) > 1:
        option = "--depth-topic" if key in DEPTH_KEYS else "--topic"
        places = " and ".join(f"{topic} in {bag.path}" for bag, topic in found[:2])
        raise DataError(f"camera {camera} may be {places}; choose with {option} {camera}=TOPIC or other bags")
    return found[0] if found else (bags[0], "")


def names_of(bags: Sequence[BagReader]) -> str:
    """Return the paths of bags as text for messages."""
    return " and ".join(str(bag.path) for bag in bags)
