"""QoS profiles of the graph's topics, chosen by the flow."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from panoptic_ros.graph.flow import PATIENT, Flow

LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
CLOCKS = QoSProfile(  # latched for up to 64 devices
    history=HistoryPolicy.KEEP_LAST,
    depth=64,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
NEWEST = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
END_OF_STREAM = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)

AHEAD = 1024  # messages, replay: audio blocks, which are sent ahead of images, or IMU samples


def data_quality(flow: Flow, images: bool = False, sound: bool = False) -> QoSProfile:
    """Return the QoS profile for images, for frequent data, or for detections and all later records.

    Publishers are reliable in both flows, so that subscribers may choose.

    Args:
        images: whether the topic carries images or depth maps.
        sound: whether the topic carries audio, its timecode or IMU samples.
    """
    late = DurabilityPolicy.TRANSIENT_LOCAL if flow.keeps_for_late else DurabilityPolicy.VOLATILE
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=_sound_depth(flow) if sound else flow.image_depth if images else flow.depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=late,
    )


def _sound_depth(flow: Flow) -> int:
    return max(flow.depth, AHEAD if flow.keeps_for_late else PATIENT)


def collecting_quality(flow: Flow) -> QoSProfile:
    """Return the QoS profile for a subscriber that needs every message, even with a long delay."""
    late = DurabilityPolicy.TRANSIENT_LOCAL if flow.keeps_for_late else DurabilityPolicy.VOLATILE
    return QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE, durability=late)
