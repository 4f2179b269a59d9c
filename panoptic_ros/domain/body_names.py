"""What frames and joints of a body are called outside, as REP 155 has it: with the body's id behind."""

from __future__ import annotations

from panoptic_ros.domain.segments import SegmentModel


def link_names(model: SegmentModel, body: str) -> list[str]:
    """Frames and links (S) of the segments of a body: "body_p4" of the root, else "lThigh_p4"."""
    return [f"body_{body}", *(f"{segment}_{body}" for segment in model.names[1:])]


def joint_names(model: SegmentModel, body: str) -> list[str]:
    """Names (3 S - 3) of the joint angles of a body: "l_y_shoulder_p4"."""
    return [f"{name}_{body}" for name in model.joint_names]
