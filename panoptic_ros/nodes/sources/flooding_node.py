"""Faulty publisher for benchmarks: it floods a topic with damaged or too large copies of messages.

Usage: `-m panoptic_ros.nodes.sources.flooding_node TOPIC TARGET TYPE RATE SECONDS BYTES`.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.utilities import try_shutdown

from panoptic_ros.graph.flow import make_flow
from panoptic_ros.nodes.middleware.family import message_class
from panoptic_ros.nodes.middleware.quality import data_quality
from panoptic_ros.nodes.middleware.runtime import start_ros

SAMPLES = 8  # original messages
VARIANTS = 400  # damaged copies
PATIENCE_S = 10.0
BATCH_S = 0.01
LONGEST = 4.0  # factor on the requested duration after which a slow machine stops


def damaged(data: bytes, size: int, rng: np.random.Generator) -> bytes:
    """Return a message with some changed bytes; it may be truncated, and is padded up to `size` bytes."""
    found = bytearray(data)
    for place in rng.integers(4, len(found), rng.integers(1, 9)):
        found[place] = rng.integers(256)
    if rng.random() < 0.2:
        found = found[: rng.integers(4, len(found))]
    return bytes(found) + rng.bytes(max(0, size - len(found)))


def main(topic: str, target: str, kind: str, rate: float, seconds: float, size: int) -> int:
    """Publish damaged copies of a topic's messages; return how many were published.

    Args:
        topic, target: Topics to copy from and to publish on.
        kind: Message type.
        rate: Messages per second.
        seconds: Duration. A slow machine takes at most `LONGEST` times as long.
        size: Least size of a damaged message, bytes.
    """
    start_ros([])
    node, executor = Node("flooder", enable_rosout=False), SingleThreadedExecutor()
    samples: list[bytes] = []
    executor.add_node(node)
    try:
        quality, cls = data_quality(make_flow("live")), message_class(kind)
        subscription = node.create_subscription(cls, topic, samples.append, quality, raw=True)
        until = time.monotonic() + PATIENCE_S
        while len(samples) < SAMPLES and time.monotonic() < until:
            executor.spin_once(timeout_sec=0.1)
        node.destroy_subscription(subscription)
        rng = np.random.default_rng(1)
        chosen = [bytes(samples[k % len(samples)]) for k in range(VARIANTS if samples else 0)]
        bad = [damaged(data, size, rng) for data in chosen]
        publisher = node.create_publisher(cls, target, quality)
        time.sleep(0.5)  # until readers are matched
        sent, total, begun = 0, round(rate * seconds) if bad else 0, time.monotonic()
        while sent < total and (passed := time.monotonic() - begun) < LONGEST * seconds:
            if sent < rate * passed:
                publisher.publish(bad[sent % len(bad)])
                sent += 1
            else:
                time.sleep(min(BATCH_S, 0.5 / rate))
        return sent
    finally:
        executor.shutdown()
        node.destroy_node()
        try_shutdown()


if __name__ == "__main__":
    source, goal, message, hertz, duration, length = sys.argv[1:]
    print(main(source, goal, message, float(hertz), float(duration), int(length)), flush=True)
