"""One host of the network benchmark.

`-m panoptic_ros.nodes.sources.network_probe send|receive SECONDS OUT [CAMERA ...]`

Senders publish 2D poses whose size matches a detector with score maps. The receiver records the arrivals.
"""

from __future__ import annotations

import array
import json
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.utilities import try_shutdown

from panoptic_ros.graph.flow import make_flow
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.nodes.middleware.family import message_class, ros_messages
from panoptic_ros.nodes.middleware.quality import data_quality
from panoptic_ros.nodes.middleware.runtime import start_ros

RATE = 30.0  # Hz, messages per camera
FLOATS = 1250  # 10 kB per message


def main(role: str, seconds: float, out: str, cameras: Sequence[str]) -> None:
    """Send or receive for some time, and write the received messages to a file.

    Args:
        out: JSON file with [camera, number, latency in s, time of arrival in s] per message.
    """
    start_ros([])
    node, executor = Node(f"probe_{role}"), SingleThreadedExecutor()
    executor.add_node(node)
    topic, quality = TOPICS["detections"], data_quality(make_flow("live"))
    kind, came = message_class(topic.message), []

    def take(camera: str, message: Any) -> None:
        now = time.time()
        stamp = message.header.stamp
        came.append([camera, message.frame_number, now - stamp.sec - 1e-9 * stamp.nanosec, now])

    try:
        if role == "send":
            publishers = [node.create_publisher(kind, topic.of(camera), quality) for camera in cameras]
            for publisher in publishers:
                node.create_timer(1.0 / RATE, partial(_send, publisher, kind, iter(range(10**9))))
        else:
            for camera in cameras:
                node.create_subscription(kind, topic.of(camera), partial(take, camera), quality)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            executor.spin_once(timeout_sec=0.1)
        Path(out).write_text(json.dumps(came))
    finally:
        executor.shutdown()
        node.destroy_node()
        try_shutdown()


def _send(publisher: Any, kind: Any, numbers: Any) -> None:
    header = ros_messages().header(time.time_ns(), "probe")
    points = array.array("d", bytes(8 * FLOATS))
    publisher.publish(kind(header=header, frame_number=next(numbers), points=points))


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), sys.argv[3], sys.argv[4:])
