"""The examples in the documents do what they say."""

import shutil
import subprocess
import sys
from pathlib import Path

import captures
import numpy as np
import pytest
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")

import panoptic_ros  # noqa: E402
from panoptic_ros.domain import JointState, RefinedPoseSet  # noqa: E402
from panoptic_ros.io.messages import to_message  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402

EXAMPLES = Path(panoptic_ros.__file__).parents[1] / "docs" / "examples"
pytestmark = [
    pytest.mark.ros,
    pytest.mark.skipif(not EXAMPLES.is_dir(), reason="the examples are part of the checkout only"),
]
STUB = """#pragma once
#include <functional>
#include <memory>
#include <string>
namespace rclcpp {
struct QoS { QoS(int) {} };
struct SensorDataQoS : QoS { SensorDataQoS() : QoS(5) {} };
template <class M> struct Subscription { using SharedPtr = std::shared_ptr<Subscription<M>>; };
struct Node {
  explicit Node(const std::string &) {}
  template <class M, class F>
  typename Subscription<M>::SharedPtr create_subscription(const std::string &, const QoS &, F && f)
  { std::function<void(const M &)> take = f; (void)take; return nullptr; }
};
inline void init(int, char **) {}
inline void spin(std::shared_ptr<Node>) {}
inline void shutdown() {}
}
"""


def test_the_subscriber_in_python_tells_distances(tmp_path):
    positions = np.zeros((2, len(captures.SKELETON), 3))
    positions[1, :, 0] = 2.5
    shape = positions.shape[:2]
    people = RefinedPoseSet(
        0,
        5,
        captures.SKELETON.hash,
        positions,
        np.broadcast_to(np.eye(3), (*shape, 3, 3)),
        np.ones(shape),
        np.full(shape, 4),
        np.full(shape, JointState.MEASURED),
        np.ones(2),
        ids=np.array([1, 12]),
    )
    rclpy.init(args=[])
    node = rclpy.create_node("tester")
    executor = rclpy.executors.SingleThreadedExecutor()
    executor.add_node(node)
    log = tmp_path / "log"
    with log.open("wb") as file:
        example = subprocess.Popen([sys.executable, EXAMPLES / "distance.py"], stdout=file)
    try:
        publisher = node.create_publisher(message_class("panoptic_msgs/msg/Skeletons"), "/skeletons", 10)
        message = to_message(people, ros_messages())

        def told():
            publisher.publish(message)
            return "\n" in log.read_text()

        spin_until(executor, told, 40.0)
        assert log.read_text().splitlines()[0] == "1 and 12: 2.50 m"
    finally:
        example.kill()
        example.wait()
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs a C++ compiler")
def test_the_subscriber_in_cpp_compiles_against_the_real_messages(tmp_path):
    """rclcpp is not on PyPI: a stand-in has what the example uses of it."""
    (tmp_path / "rclcpp").mkdir()
    (tmp_path / "rclcpp" / "rclcpp.hpp").write_text(STUB)
    include = Path(sys.prefix) / "include"
    folders = [tmp_path, include, *(path for path in include.iterdir() if path.is_dir())]
    done = subprocess.run(
        [
            "g++",
            "-std=c++17",
            "-fsyntax-only",
            "-Wall",
            "-Wextra",
            "-Werror",
            *(f"-I{p}" for p in folders),
            EXAMPLES / "distance.cpp",
        ],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr[-2000:]
