"""OpenCV works on the calling thread for a while, and as before afterwards."""

import cv2
import pytest

from panoptic_ros.detection.one_thread import one_thread


def test_threads_are_as_before_whatever_happens():
    before = cv2.getNumThreads()
    with pytest.raises(ValueError), one_thread():
        assert cv2.getNumThreads() == 1
        raise ValueError
    assert cv2.getNumThreads() == before
