"""The service for people at requested instants: answers, waits and refusals."""

import numpy as np
import pytest
from free_cameras import START_NS, FreeCapture
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")

from rclpy.qos import QoSProfile  # noqa: E402

from panoptic_ros.graph.topics import TOPICS  # noqa: E402
from panoptic_ros.io.messages import from_message, to_message  # noqa: E402
from panoptic_ros.io.messages.family import time_ns  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages, service_class  # noqa: E402
from panoptic_ros.nodes.sources.statics_node import StaticsNode  # noqa: E402
from panoptic_ros.nodes.stages.instant_service import MOST_WAITING  # noqa: E402
from panoptic_ros.nodes.stages.stage_node import StageNode  # noqa: E402

pytestmark = pytest.mark.ros
SECOND = 1_000_000_000
CAPTURE = FreeCapture(seconds=2.0)
VIEWS = [item.views[0] for item in CAPTURE.sets]


class Caller:
    """Views that are published one by one, and requests."""

    def __init__(self, executor, stage):
        self.executor, self.stage = executor, stage
        self.node = rclpy.create_node("caller")
        executor.add_node(self.node)
        kind = message_class("panoptic_msgs/msg/ViewDetections")
        self.publishers = {
            name: self.node.create_publisher(kind, TOPICS["detections"].of(name), 10)
            for name in CAPTURE.rig.names
        }
        self.kind = service_class("panoptic_msgs/srv/SkeletonsAt")
        many = QoSProfile(depth=4 * MOST_WAITING)
        self.client = self.node.create_client(self.kind, "skeletons_at", qos_profile=many)
        self.sent = 0

    def play(self, until_ns):
        """Publish the views up to a time, each after the stage has taken the one before."""
        while self.sent < len(VIEWS) and VIEWS[self.sent].stamp_ns <= until_ns:
            view = VIEWS[self.sent]
            self.publishers[view.camera].publish(to_message(view, ros_messages()))
            self.sent += 1
            spin_until(self.executor, lambda: self.stage.taken == self.sent)

    def ask(self, stamp_ns, patience_s=0.0):
        request = self.kind.Request()
        request.stamp.sec, request.stamp.nanosec = divmod(stamp_ns, SECOND)
        request.patience.sec, request.patience.nanosec = divmod(round(patience_s * SECOND), SECOND)
        return self.client.call_async(request)

    def answer(self, future):
        spin_until(self.executor, future.done)
        return future.result()


def stamp(message):
    return time_ns(message.header.stamp)


def test_answers_waits_and_refusals(executor):
    node = StageNode("continuous", {"flow": "live", "active": True})
    executor.add_node(node)
    executor.add_node(StaticsNode(CAPTURE.rig, CAPTURE.context.skeleton))
    caller = Caller(executor, node.statistics["continuous"])
    spin_until(executor, lambda: caller.client.service_is_ready(), 60.0)
    spin_until(executor, lambda: all(p.get_subscription_count() for p in caller.publishers.values()))
    refused = caller.answer(caller.ask(START_NS))
    assert not refused.ok and refused.reason == "no views have come yet; waited for 0 s"

    caller.play(START_NS + SECOND)
    asked = START_NS + SECOND // 2 + 1_234_567
    found = caller.answer(caller.ask(asked))
    assert found.ok and found.reason == "" and stamp(found.skeletons) == asked
    people = from_message(found.skeletons, "RefinedPoseSet")
    truth = CAPTURE.joints(1e-9 * (asked - START_NS))
    gaps = np.linalg.norm(truth[:, None] - people.positions[None], axis=-1).mean(axis=-1)
    assert people.ids.tolist() == [0, 1] and gaps.min(axis=0).max() < 5e-3
    oldest, newest = time_ns(found.oldest), time_ns(found.newest)
    assert START_NS <= oldest < asked < newest <= START_NS + SECOND

    new = caller.answer(caller.ask(newest + 40_000_000, 0.05))
    assert not new.ok and new.reason == "the stamp is 0.040 s after the newest instant; waited for 0.05 s"
    assert time_ns(new.newest) == newest and new.skeletons.skeletons == []

    waits = caller.ask(START_NS + 12 * SECOND // 10, 30.0)
    part = caller.ask(newest - 20_000_000, 0.1)  # some of its views have come
    assert caller.answer(part).ok and not waits.done()
    caller.play(START_NS + 2 * SECOND)
    late = caller.answer(waits)
    assert late.ok and len(late.skeletons.skeletons) == 2
    assert stamp(late.skeletons) == START_NS + 12 * SECOND // 10

    old = caller.answer(caller.ask(START_NS + 10_000_000, 9.0))  # refused at once
    assert not old.ok and "before the oldest instant" in old.reason

    many = [caller.ask(time_ns(old.newest) - 1_000_000 * k) for k in range(40)]  # at once
    assert all(caller.answer(one).ok for one in many)
    new = time_ns(old.newest) + SECOND
    too_many = [caller.answer(one) for one in [caller.ask(new, 1.0) for _ in range(MOST_WAITING + 9)]]
    reasons = [one.reason.partition("; ")[2] for one in too_many]
    assert reasons == ["waited for 1 s"] * MOST_WAITING + ["waited for 0 s"] * 9
    assert node.healthy
