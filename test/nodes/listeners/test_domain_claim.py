"""Two graphs in one domain: namespaces keep them apart, and who collides is named."""

import pytest

rclpy = pytest.importorskip("rclpy")
from panoptic_ros.errors import EnvironmentProblem, UsageError  # noqa: E402
from panoptic_ros.nodes.listeners import domain_claim  # noqa: E402
from panoptic_ros.nodes.listeners.domain_claim import (  # noqa: E402
    GraphListener,
    claim_domain,
    require_no_other_graph,
)
from panoptic_ros.nodes.middleware.family import message_class  # noqa: E402
from panoptic_ros.nodes.middleware.runtime import in_namespace  # noqa: E402

pytestmark = pytest.mark.ros


def test_a_namespace_is_claimed_once_and_free_again():
    with claim_domain("lab"), claim_domain("hall"):
        with pytest.raises(EnvironmentProblem, match="namespace /lab of ROS domain .* --namespace"):
            claim_domain("lab")
    claim_domain("lab").close()


def test_who_publishes_skeletons_already_is_named(ros):
    other = rclpy.create_node("refinement", namespace="lab")
    other.create_publisher(message_class("panoptic_msgs/msg/Skeletons"), "skeletons", 1)
    apart = rclpy.create_node("collector", namespace="hall")
    require_no_other_graph(apart)
    ours = rclpy.create_node("collector", namespace="lab")
    with pytest.raises(EnvironmentProblem, match="node /lab/refinement publishes /lab/skeletons in"):
        require_no_other_graph(ours)
    for node in (other, apart, ours):
        node.destroy_node()


def test_names_of_namespaces():
    assert in_namespace("") == in_namespace("/") == []
    assert in_namespace("/lab/left")[-1] == "__ns:=/lab/left"
    for bad in ("1lab", "lab left", "lab//left"):
        with pytest.raises(UsageError, match="ROS allows letters"):
            in_namespace(bad)


def test_a_listener_has_waited_since_it_was_made(ros, monkeypatch):
    """Once a second has gone by it looks without waiting; graphs of other namespaces do not matter."""
    apart, listener = GraphListener("hall"), GraphListener("lab")
    other = rclpy.create_node("refinement", namespace="lab")
    other.create_publisher(message_class("panoptic_msgs/msg/Skeletons"), "skeletons", 1)
    apart.require_no_other_graph()
    monkeypatch.setattr(domain_claim.time, "sleep", lambda seconds: pytest.fail("it waits"))
    with pytest.raises(EnvironmentProblem, match="node /lab/refinement publishes /lab/skeletons in"):
        listener.require_no_other_graph()
    apart.require_no_other_graph()
    for each in (apart, listener):
        each.close()
    other.destroy_node()
