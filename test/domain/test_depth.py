"""Depth maps as records."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.domain import DepthFrame
from panoptic_ros.errors import DataError


def test_a_depth_frame_keeps_a_read_only_view() -> None:
    depth = np.full((3, 4), 2.0, np.float32)
    frame = DepthFrame("kinect", 7, 0, depth)
    assert frame.image_size == (4, 3) and np.shares_memory(frame.depth, depth)
    assert not frame.depth.flags.writeable and depth.flags.writeable


@pytest.mark.parametrize(
    ("depth", "told"),
    [
        (np.ones((3, 4)), "float64"),
        (np.ones((3, 4, 1), np.float32), r"\(3, 4, 1\)"),
        (np.ones((0, 4), np.float32), r"\(0, 4\)"),
    ],
)
def test_other_arrays_are_refused(depth: np.ndarray, told: str) -> None:
    with pytest.raises(DataError, match=told):
        DepthFrame("kinect", 7, 0, depth)


def test_a_depth_frame_needs_a_name_and_a_whole_stamp() -> None:
    depth = np.ones((3, 4), np.float32)
    with pytest.raises(DataError, match="name"):
        DepthFrame("", 7, 0, depth)
    with pytest.raises(DataError, match="stamp_ns"):
        DepthFrame("kinect", 7.5, 0, depth)  # type: ignore[arg-type]
