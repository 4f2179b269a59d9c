"""Simulated camera drivers of other packages, which also publish messages that this graph does not expect.

`python -m panoptic_ros.nodes.sources.stand_in_drivers RIG TOPIC HZ` publishes grey images of all cameras of a
rig. Their timestamps are the system time; {} in TOPIC stands for the camera. A line on standard input names
the foreign message to publish: detections, skeletons or diagnostics. Any other line destroys the publishers
of foreign messages. The program ends when standard input ends.
"""

from __future__ import annotations

import selectors
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.utilities import try_shutdown

from panoptic_ros.domain import JointState, RefinedPoseSet, ViewDetections, ViewFrame
from panoptic_ros.graph.flow import make_flow
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import image_message, to_message
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.io.skeletons import load_skeleton
from panoptic_ros.nodes.middleware.family import message_class, ros_messages
from panoptic_ros.nodes.middleware.quality import data_quality
from panoptic_ros.nodes.middleware.runtime import start_ros


class StandInDrivers(Node):
    """Node that publishes images and, on demand, foreign messages.

    Args:
        rig: file of the rig.
        topic: of the images, where {} stands for the camera.
    """

    def __init__(self, rig: Path, topic: str):
        super().__init__("stand_in_drivers")
        self._rig = read_rig(rig)
        quality = data_quality(make_flow("live"))
        kind = message_class("sensor_msgs/msg/Image")
        self._images = {
            name: self.create_publisher(kind, topic.format(name), quality) for name in self._rig.names
        }
        first = self._rig.names[0]
        self._topics = {
            "detections": "/" + TOPICS["detections"].of(first),
            "skeletons": "/" + TOPICS["skeletons"].name,
            "diagnostics": "/diagnostics",
        }
        # publishers, made on demand: a graph does not start beside another one
        self._foreign: dict[str, Any] = {}
        self._number = 0

    def publish(self) -> None:
        """Publish an image of every camera."""
        stamp = time.time_ns()
        for camera in self._rig.cameras:
            width, height = camera.image_size
            grey = np.full((height, width, 3), 60 + self._number % 60, np.uint8)
            frame = ViewFrame(camera.name, stamp, self._number, grey)
            self._images[camera.name].publish(image_message(frame, ros_messages()))
        self._number += 1

    def take_order(self, what: str) -> None:
        """Publish one foreign message of this kind; any other word destroys their publishers."""
        if what not in self._topics:
            self._end_foreign()
            return
        message = self._message(what)
        if what not in self._foreign:
            self._foreign[what] = self.create_publisher(type(message), self._topics[what], 10)
            time.sleep(0.5)
        self._foreign[what].publish(message)

    def _end_foreign(self) -> None:
        """Destroy the publishers of foreign messages."""
        for publisher in self._foreign.values():
            self.destroy_publisher(publisher)
        self._foreign.clear()

    def _message(self, what: str) -> Any:
        family, stamp = ros_messages(), time.time_ns()
        if what == "diagnostics":
            value = family.make("diagnostic_msgs/msg/KeyValue", key="taken", value="several")
            status = family.make(
                "diagnostic_msgs/msg/DiagnosticStatus",
                level=b"\x00",
                name="panoptic: sync",
                message="",
                hardware_id="",
                values=[value],
            )
            header = family.header(stamp, "")
            return family.make("diagnostic_msgs/msg/DiagnosticArray", header=header, status=[status])
        coco = load_skeleton("coco17")
        joints = len(coco.joint_names)
        if what == "detections":
            view = ViewDetections(
                "unknown",
                stamp,
                0,
                (64, 48),
                load_skeleton("panoptic19").hash,
                np.zeros((0, 19, 2)),
                np.zeros((0, 19)),
                np.zeros(0),
            )
            return to_message(view, family)
        people = RefinedPoseSet(
            0,
            stamp,
            coco.hash,
            np.zeros((1, joints, 3)),
            np.tile(np.eye(3), (1, joints, 1, 1)),
            np.ones((1, joints)),
            np.full((1, joints), 2),
            np.full((1, joints), JointState.MEASURED),
            np.ones(1),
            ids=np.array([7]),
        )
        return to_message(people, family)


def main() -> int:
    """Publish until standard input ends; return the exit code."""
    rate = float(sys.argv[3])
    start_ros([])
    node = StandInDrivers(Path(sys.argv[1]), sys.argv[2])
    asked = selectors.DefaultSelector()
    asked.register(sys.stdin, selectors.EVENT_READ)
    due = time.monotonic()
    while True:
        node.publish()
        due = max(due + 1.0 / rate, time.monotonic())
        while (left := due - time.monotonic()) > 0:
            if asked.select(left):
                line = sys.stdin.readline()
                if not line:
                    try_shutdown()
                    return 0
                node.take_order(line.strip())


if __name__ == "__main__":
    sys.exit(main())
