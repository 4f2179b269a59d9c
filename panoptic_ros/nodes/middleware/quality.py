"""QoS profiles of the graph's topics, from the flow."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from panoptic_ros.graph.flow import PATIENT, Flow

LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
CLOCKS = QoSProfile(  # latched for as many devices
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

AHEAD = 1024  # replay: blocks of sound, which is ahead of images, or samples of an IMU


def data_quality(flow: Flow, images: bool = False, sound: bool = False) -> QoSProfile:
    """For images, for sound and the timecode in it, or for detections and everything after them.

    Publishers are reliable in both flows, so that subscribers may choose.
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
    """For a subscriber that wants every message, however late it gets to them."""
    late = DurabilityPolicy.TRANSIENT_LOCAL if flow.keeps_for_late else DurabilityPolicy.VOLATILE
    return QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE, durability=late)
