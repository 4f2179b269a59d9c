"""Image topics of live cameras, and their newest messages, received in a thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import rclpy
from rclpy.utilities import try_shutdown

from panoptic_ros.errors import DataError, EnvironmentProblem
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.driver_topics import read_driver_topics
from panoptic_ros.io.messages.images import is_video, video_told
from panoptic_ros.nodes.listeners.images_node import KINDS, ImageMessage, ImagesNode
from panoptic_ros.nodes.middleware.runtime import make_executor, start_ros
from panoptic_ros.nodes.sources.drivers import find_drivers
from panoptic_ros.running.plans.bag_topics import topics_by_camera
from panoptic_ros.running.processes.children import prepare_environment
from panoptic_ros.stage import Notice

PATIENCE_S = 10.0  # s, timeout for the first image topic, and for all named cameras
SETTLE_S = 2.0  # s after the last new topic until all cameras are known
LOOK_S = 0.2
RAW = "image"  # begin of the last word of topics of images as drivers name them, e.g. /cam_1/image_raw
RECTIFIED = "_rect"  # marks images without distortion, which are not calibrated


class ImageTopic(NamedTuple):
    """Topic of a camera: name, message type, and the encoding that overrides that of its images."""

    topic: str
    kind: str
    encoding: str = ""


def find_cameras(
    names: Sequence[str], topics: Path | None, tell: Callable[[str], None], stop: Callable[[], bool]
) -> dict[str, ImageTopic]:
    """Return the live cameras by name: those of a file of topics, those named, or all.

    Raises:
        UserError: if one is missing.
        KeyboardInterrupt: on a stop during the search.
    """
    prepare_environment()
    found = _of_file(topics) if topics is not None else _published(names, stop)
    tell("cameras: " + ", ".join(f"{name} ({camera.topic})" for name, camera in found.items()))
    return found


def _of_file(path: Path) -> dict[str, ImageTopic]:
    cameras = read_driver_topics(path).cameras
    if not cameras:
        raise DataError(f"{path} names no topic of images; give an 'image' of each camera")
    types = find_drivers({own.image: f"image of camera {name}" for name, own in cameras.items()}).types
    for name, own in cameras.items():
        kind = types[own.image]
        if is_video(kind):
            raise DataError(f"image of camera {name}: {video_told(own.image, kind)}")
        if kind not in KINDS:
            raise DataError(
                f"{own.image} (image of camera {name}) carries {kind}; expected {' or '.join(KINDS)}"
            )
    return {name: ImageTopic(own.image, types[own.image], own.encoding) for name, own in cameras.items()}


def _published(names: Sequence[str], stop: Callable[[], bool]) -> dict[str, ImageTopic]:
    """Return the cameras that publish images now; wait for those that are named."""
    context = rclpy.context.Context()
    start_ros([], context)
    node = rclpy.create_node(
        "panoptic_cameras", context=context, enable_rosout=False, start_parameter_services=False
    )
    begin = newest = time.monotonic()
    found: dict[str, ImageTopic] = {}
    try:
        while True:
            before, found = len(found), _now(node)
            now = time.monotonic()
            newest = now if len(found) > before else newest
            if names and set(names) <= found.keys():
                return {name: found[name] for name in names}
            if found and not names and now - newest > SETTLE_S:
                return found
            if stop():
                raise KeyboardInterrupt
            if now - begin > PATIENCE_S:
                raise EnvironmentProblem(_missing(names, found))
            time.sleep(LOOK_S)
    finally:
        node.destroy_node()
        context.try_shutdown()


def _now(node: Any) -> dict[str, ImageTopic]:
    kinds = {}
    for topic, types in node.get_topic_names_and_types():
        word = topic.removesuffix("/compressed").rsplit("/", 1)[-1]
        if word.startswith(RAW) and RECTIFIED not in word and node.count_publishers(topic):
            kinds[topic] = types[0]
    found = topics_by_camera(kinds, "the live graph")
    return {name: ImageTopic(topic, TOPICS[key].message) for name, (topic, key) in found.items()}


def _missing(names: Sequence[str], found: Mapping[str, ImageTopic]) -> str:
    lacking = [name for name in names if name not in found]
    if found:
        there = ", ".join(f"{name} ({camera.topic})" for name, camera in found.items())
        return f"no camera {', '.join(lacking)} publishes images within {PATIENCE_S:g} s; there are {there}"
    return (
        f"no camera publishes images within {PATIENCE_S:g} s: is a driver running, in this ROS_DOMAIN_ID? "
        "--topics FILE names topics; ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET reaches other machines"
    )


class LiveCameras:
    """Subscriber of image topics, which receives in its own thread. A context manager."""

    def __init__(self, cameras: Mapping[str, ImageTopic]):
        start_ros([])
        self._told: list[str] = []
        topics = {name: (camera.topic, camera.kind) for name, camera in cameras.items()}
        self._node = ImagesNode(topics, self._hear)
        self._executor, self._over = make_executor(), threading.Event()
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, daemon=True)

    @property
    def notices(self) -> list[str]:
        """Return lines about topics that are not received, and about stamps that go back."""
        lines = [f"camera {name}: no image for {s:.0f} s" for name, s in self._node.silent().items()]
        lines += [
            f"camera {name}: {count} images are left out, because their stamps go back"
            for name, count in self._node.back.items()
            if count
        ]
        return [*self._told, *lines]

    def take(self) -> dict[str, ImageMessage]:
        """Return one new image per camera, see `ImagesNode.take`."""
        return self._node.take()

    def _hear(self, notice: Notice) -> None:
        if notice.severity == "warning":
            self._told.append(notice.text)

    def _spin(self) -> None:
        while not self._over.is_set():
            self._executor.spin_once(timeout_sec=LOOK_S)

    def __enter__(self) -> LiveCameras:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._over.set()
        self._thread.join(5.0)
        self._executor.shutdown()
        self._node.destroy_node()
        try_shutdown()
