"""Sources whose stamps are corrected by a clock."""

import cv2
import numpy as np
import pytest

from panoptic_ros.capture.image_folder import ImageFolderSource
from panoptic_ros.capture.timed import CorrectedSource
from panoptic_ros.errors import DataError

LINE = {"reference_ns": 100_000_000, "offset_ns": -50_000_000, "drift": 0.5}


def source(tmp_path):
    for k in range(4):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.zeros((8, 8, 3), np.uint8))
    return ImageFolderSource("a", tmp_path, start_ns=0, frame_rate=10.0)


def test_stamps_move_by_offset_and_drift_and_none_falls_below_zero(tmp_path):
    with CorrectedSource(source(tmp_path), LINE) as corrected:
        frames = [(frame.frame_number, frame.stamp_ns) for frame in corrected]
        assert frames == [(1, 50_000_000), (2, 200_000_000), (3, 350_000_000)]
        assert frames == [(frame.frame_number, frame.stamp_ns) for frame in corrected]
        assert (corrected.camera, corrected.frame_rate, corrected.frame_count) == ("a", 10.0, 4)


def test_a_line_without_numbers_is_refused(tmp_path):
    with pytest.raises(DataError, match="camera a: .* is not a correction"):
        CorrectedSource(source(tmp_path), {"offset_ns": "soon"})
