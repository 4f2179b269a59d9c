"""Images wait for their depth maps on topics, and go on when the depth is over."""
import numpy as np
import pytest
from spinning import spin_until

from panoptic_ros.domain import ViewFrame
from panoptic_ros.graph.flow import make_flow
from panoptic_ros.io.messages import depth_message, image_message, stamp_of

pytest.importorskip("rclpy")
pytestmark = pytest.mark.ros


RAW = ("depths", "sensor_msgs/msg/Image", "a/depth_registered/image_raw")
COMPRESSED = (
    "compressed_depths", "sensor_msgs/msg/CompressedImage", "a/depth_registered/image_raw/compressedDepth"
)  # fmt: skip


def compressed(message):
    """A CompressedImage with the stamp of a depth map; what is in it is nobody's business here."""
    from panoptic_ros.nodes.family import ros_messages

    return ros_messages().make(
        "sensor_msgs/msg/CompressedImage", header=message.header, format="16UC1; compressedDepth png", data=[]
    )


@pytest.mark.parametrize(("parameter", "kind", "topic"), [RAW, COMPRESSED])
def test_images_go_on_with_their_depth_maps_and_after_the_last_without(executor, parameter, kind, topic):
    from rclpy.node import Node
    from rclpy.parameter import Parameter

    from panoptic_ros.nodes.depth_input import DepthInput
    from panoptic_ros.nodes.family import message_class, ros_messages
    from panoptic_ros.nodes.quality import data_quality
    from panoptic_ros.nodes.streams import StreamEnds

    flow, pairs = make_flow("replay"), []
    node = Node("taker", parameter_overrides=[Parameter(parameter, value=["a"])])
    depths = DepthInput(node, flow, pairs.append)
    ends = StreamEnds(node, depths.over)
    depths.listen(["a", "b"], ends)
    source = Node("source")
    publisher = source.create_publisher(message_class(kind), topic, data_quality(flow, images=True))
    frames = [
        ViewFrame("a", 10**9 * i, i, np.zeros((4, 6, 3), np.uint8), depth=np.full((2, 3), i, np.float32))
        for i in range(4)
    ]
    for frame in frames:
        depths.take_image("a", image_message(frame, ros_messages()))
    depths.take_image("b", image_message(frames[0], ros_messages()))
    assert [pair.camera for pair in pairs] == ["b"]
    for frame in (frames[0], frames[2]):
        message = depth_message(frame, ros_messages())
        publisher.publish(message if parameter == "depths" else compressed(message))
    announcer = StreamEnds(source, lambda topic: None)
    announcer.announce(publisher.topic_name, 2)
    executor.add_node(node)
    executor.add_node(source)
    spin_until(executor, lambda: len(pairs) == 5)
    assert [stamp_of(pair.image.header) // 10**9 for pair in pairs[1:]] == [0, 1, 2, 3]
    assert [None if pair.depth is None else stamp_of(pair.depth.header) // 10**9 for pair in pairs[1:]] == [
        0, None, 2, None,
    ]  # fmt: skip
