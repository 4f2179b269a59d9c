"""Node that keeps the newest image messages of several cameras, without decoding them."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

from panoptic_ros.io.cdr_heads import stamp_in
from panoptic_ros.nodes.middleware.family import message_class
from panoptic_ros.nodes.middleware.negotiation import NegotiatedSubscription
from panoptic_ros.stage import Notice

KINDS = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
KEPT = 8  # newest messages of a camera: a quarter of a second at 30 Hz, so that cameras meet at one time
SILENT_S = 2.0  # s without a message after which a camera holds up no others
NEWEST_IMAGES = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=2, reliability=ReliabilityPolicy.RELIABLE)


class ImageMessage(NamedTuple):
    """Message of a camera: stamp, ns, message type, and CDR bytes."""

    stamp_ns: int
    kind: str
    data: bytes


class ImagesNode(Node):
    """Node that subscribes to images as CDR bytes; a thread other than the executor's takes them.

    Args:
        topics: (topic, message type) by camera.
        tell: called with a notice about a QoS mismatch.
    """

    fault = None
    healthy = True

    def __init__(self, topics: Mapping[str, tuple[str, str]], tell: Callable[[Notice], None]):
        super().__init__("calibration_guide", enable_rosout=False, start_parameter_services=False)
        self._lock = threading.Lock()
        self._kept: dict[str, deque[ImageMessage]] = {name: deque(maxlen=KEPT) for name in topics}
        self._taken = dict.fromkeys(topics, -1)  # stamp of the image taken last, ns
        self._arrived = dict.fromkeys(topics, time.monotonic())  # s
        self.back = dict.fromkeys(topics, 0)  # messages by camera that are older than an earlier one
        self._subscribed = [
            NegotiatedSubscription(
                self, message_class(kind), topic, self._keeper(name, kind), NEWEST_IMAGES, True, tell
            )
            for name, (topic, kind) in topics.items()
        ]

    def close(self) -> None:
        """Do nothing: the node has no threads."""

    def silent(self) -> dict[str, float]:
        """Return the time, s, since the last message of each camera that is silent."""
        now = time.monotonic()
        with self._lock:
            return {name: now - last for name, last in self._arrived.items() if now - last > SILENT_S}

    def take(self) -> dict[str, ImageMessage]:
        """Return one new image per camera, of nearly the same time; {} while a camera has no new one.

        The time is that of the newest image of the latest camera. Silent cameras are left out.
        """
        with self._lock:
            alive = time.monotonic() - SILENT_S
            active = {name: own for name, own in self._kept.items() if own and self._arrived[name] > alive}
            if not active or any(own[-1].stamp_ns == self._taken[name] for name, own in active.items()):
                return {}
            target = min(own[-1].stamp_ns for own in active.values())
            found = {
                name: min(
                    (message for message in own if message.stamp_ns > self._taken[name]),
                    key=lambda message: abs(message.stamp_ns - target),
                )
                for name, own in active.items()
            }
            self._taken |= {name: message.stamp_ns for name, message in found.items()}
            return found

    def _keeper(self, name: str, kind: str) -> Callable[[bytes, int], Any]:
        def keep(data: bytes, number: int) -> None:
            stamp = stamp_in(data) or self.get_clock().now().nanoseconds  # some drivers give no stamp
            with self._lock:
                own = self._kept[name]
                if own and stamp <= own[-1].stamp_ns:
                    self.back[name] += 1
                    return
                own.append(ImageMessage(stamp, kind, data))
                self._arrived[name] = time.monotonic()

        return keep
