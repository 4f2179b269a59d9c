"""Convert records to ROS messages and back, for rclpy's message classes and those of rosbags.

`MessageFamily` represents one family of message classes. The converters fill flat arrays without a Python
loop over values. `from_message` builds the record, whose checks refuse invalid content.
"""

from panoptic_ros.io.messages.camera_infos import camera_info_message
from panoptic_ros.io.messages.depths import depth_from_message
from panoptic_ros.io.messages.family import MessageFamily, bag_messages, stamp_of
from panoptic_ros.io.messages.images import (
    compressed_image_message,
    depth_frame_from_message,
    depth_message,
    frame_from_message,
    image_message,
)
from panoptic_ros.io.messages.records import from_message, to_message

__all__ = [
    "MessageFamily",
    "bag_messages",
    "camera_info_message",
    "compressed_image_message",
    "depth_frame_from_message",
    "depth_from_message",
    "depth_message",
    "frame_from_message",
    "from_message",
    "image_message",
    "stamp_of",
    "to_message",
]
