"""External names of a body's frames and joints, after REP 155: the body's id is the suffix."""

from __future__ import annotations

from panoptic_ros.domain.segments import SegmentModel


def link_names(model: SegmentModel, body: str) -> list[str]:
    """Return the names (S) of the frames and links of a body's segments: "body_p4" (root), "lThigh_p4"."""
    return [f"body_{body}", *(f"{segment}_{body}" for segment in model.names[1:])]


def joint_names(model: SegmentModel, body: str) -> list[str]:
    """Return the names (3 S - 3) of the joint angles of a body: "l_y_shoulder_p4"."""
    return [f"{name}_{body}" for name in model.joint_names]
