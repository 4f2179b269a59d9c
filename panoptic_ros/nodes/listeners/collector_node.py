"""Node of the launcher: it collects the output of the graph and detects when the run has ended."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from rclpy.node import Node

from panoptic_ros.errors import DataError
from panoptic_ros.graph.flow import Flow
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.messages.sensors import read_imu
from panoptic_ros.nodes.health.diagnostics import own_statuses, values_of
from panoptic_ros.nodes.middleware.family import message_class
from panoptic_ros.nodes.middleware.negotiation import NegotiatedSubscription
from panoptic_ros.nodes.middleware.packets import unpacked
from panoptic_ros.nodes.middleware.quality import CLOCKS, collecting_quality
from panoptic_ros.nodes.middleware.streams import StreamEnds
from panoptic_ros.stage import Notice

COUNTS = ("dropped.", "notice.")  # prefixes of keys on /diagnostics whose values are message counts


class CollectorNode(Node):
    """Node that passes every record of some topics to a function and keeps the last diagnostics per node.

    Args:
        cameras: Cameras whose detections are taken.
        devices: Devices whose audio is taken.
        bodies: IMUs whose samples are taken, in addition to /bodies. None: there are no bodies.
        more: Keys and owners of further topics, which have an end.
        on_record: Called with (key of the topic, record), and with ("diagnostics", those of all nodes).
        check: Raises DataError for a record that is not of this graph, e.g. detections of another camera.
    """

    def __init__(
        self,
        flow: Flow,
        cameras: Sequence[str],
        on_record: Callable[[str, Any], None],
        devices: Iterable[str] = (),
        bodies: Iterable[str] | None = None,
        more: Iterable[tuple[str, str]] = (),
        check: Callable[[str, str, Any], None] = lambda *about: None,
    ):
        super().__init__("collector")
        self._open: set[str] = set()  # topics that have not ended
        self._bad_messages = 0
        self._refused: set[str] = set()  # topics with a logged refusal
        self.diagnostics: dict[str, dict[str, str]] = {}
        self._on_record, self._check = on_record, check
        self._quality, self._live = collecting_quality(flow), flow.name == "live"
        self._ends = StreamEnds(self, self._end)
        self._kept = [self._subscribe("detections", camera) for camera in cameras]
        self._kept += [self._subscribe("audio", device) for device in devices]
        if cameras:  # without cameras there are only bodies
            self._kept.append(self._subscribe("skeletons", ""))
        if bodies is not None:
            self._kept += [self._subscribe("imu", device) for device in bodies]
            self._kept.append(self._subscribe("bodies", ""))
        self._kept += [self._subscribe(key, owner) for key, owner in more]
        for subscription in self._kept:
            self._open.add(subscription.topic_name)
            self._ends.watch(subscription.topic_name)
        self._kept += [self._subscribe(key, "") for key in ("clock_models", "repaired_rig")]  # have no end
        # the run does not wait for their end
        self._kept += [self._subscribe("preview", camera) for camera in cameras]
        self._kept.append(
            self.create_subscription(
                message_class("diagnostic_msgs/msg/DiagnosticArray"), "/diagnostics", self._take_status, 100
            )
        )

    @property
    def over(self) -> bool:
        """Return whether all messages of all topics have arrived (replay; a live graph has no end)."""
        return not self._open

    def finished(self, names: Iterable[str]) -> bool:
        """Return whether all these nodes have reported that they are finished."""
        return all(self.diagnostics.get(name, {}).get("finished") == "true" for name in names)

    def _subscribe(self, key: str, camera: str) -> Any:
        topic = TOPICS[key]

        def take(message: Any) -> None:
            try:
                if isinstance(message, bytes):
                    message = unpacked(message, kind)
                is_imu = topic.scope == "imu"  # the frame_id of an IMU is chosen by its driver
                record = read_imu(message, camera) if is_imu else from_message(message, topic.record)
                self._check(key, camera, record)
            except DataError as error:
                self._refuse(subscription.topic_name, str(error))
            else:
                self._on_record(key, record)
            if not topic.latched:
                self._ends.taken(subscription.topic_name)

        kind, quality = message_class(topic.message), CLOCKS if topic.latched else self._quality
        subscription: Any
        if topic.scope == "imu" and self._live:  # drivers often offer best effort only
            subscription = NegotiatedSubscription(
                self,
                kind,
                topic.of(camera),
                lambda data, number: take(data),
                quality,
                gives_way=True,
                tell=self._tell,
            )
        else:
            subscription = self.create_subscription(kind, topic.of(camera), take, quality)
        return subscription

    def _refuse(self, topic: str, why: str) -> None:
        """Count a dropped message; log the first one of each topic."""
        self._bad_messages += 1
        self.diagnostics[self.get_name()] = {"dropped.bad_message": str(self._bad_messages)}
        if topic not in self._refused:
            self._refused.add(topic)
            self.get_logger().warning(f"a message on {topic} was dropped: {why}")

    def _tell(self, notice: Notice) -> None:
        """Log a warning about a driver's QoS.

        Other notices about its samples come from the stage node that also reads them.
        """
        if notice.severity != "info":
            self.get_logger().warning(notice.text)

    def _end(self, topic: str) -> None:
        self._open.discard(topic)

    def _take_status(self, message: Any) -> None:
        for name, status in own_statuses(message, self.get_namespace()):
            values = values_of(status)
            odd = [key for key, value in values.items() if not _is_usable(key, value)]
            if odd:
                why = f"{status.name}: {odd[0]} = {values[odd[0]][:40]!r} is not a number"
                self._refuse("/diagnostics", why)
                continue
            self.diagnostics[name] = values
        self._on_record("diagnostics", self.diagnostics)


def _is_usable(key: str, value: str) -> bool:
    """Return whether a count is an integer and a duration a number; other values are always usable."""
    kind = float if key.startswith("step_") else int if key == "taken" or key.startswith(COUNTS) else str
    try:
        kind(value)
    except ValueError:
        return False
    return True
