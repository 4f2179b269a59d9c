"""Bags for tests."""

import captures

from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.messages import bag_messages, to_message


def write_bag(path, views, rig=captures.RIG, skeleton=captures.SKELETON):
    """A bag with detections; without a rig or a skeleton model where None is given."""
    family = bag_messages()
    with BagWriter(path) as bag:
        if rig is not None:
            bag.write("/rig", 0, to_message(rig, family))
        if skeleton is not None:
            bag.write("/skeleton_model", 0, to_message(skeleton, family))
        for view in views:
            topic = "/" + TOPICS["detections"].of(view.camera)
            bag.write(topic, view.stamp_ns, to_message(view, family))
    return path
