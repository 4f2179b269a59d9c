"""Videos of JPEG pictures are read back by OpenCV, exactly as many and as good as written."""
from __future__ import annotations

import cv2
import numpy as np
import pytest

from panoptic_ros.errors import DataError, EnvironmentProblem, UsageError
from panoptic_ros.io.motion_jpeg import MotionJpegWriter


def picture(number, size=(96, 64)):
    """A smooth picture with a bright column that says its number."""
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    image = np.stack([2 * x % 200, 3 * y % 180, (x + y) % 160], axis=-1).astype(np.uint8)
    image[:, 4 * number : 4 * number + 4] = 255
    return image


def record(path, count=9, rate=29.97):
    with MotionJpegWriter(path, (96, 64), rate) as video:
        for number in range(count):
            video.write(picture(number))


def test_pictures_come_back_in_order_and_quality(tmp_path):
    record(tmp_path / "video.mp4")
    capture = cv2.VideoCapture(str(tmp_path / "video.mp4"))
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == 9
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(29.97, abs=1e-6)
    for number in range(9):
        good, image = capture.read()
        assert capture.get(cv2.CAP_PROP_POS_MSEC) == pytest.approx(1e3 * number / 29.97, abs=0.5)
        assert good and cv2.PSNR(image, picture(number)) > 30.0
    assert not capture.read()[0]
    capture.set(cv2.CAP_PROP_POS_FRAMES, 5)
    assert cv2.PSNR(capture.read()[1], picture(5)) > 30.0, "any picture can be reached"
    assert [p.name for p in tmp_path.iterdir()] == ["video.mp4"]


def test_equal_pictures_give_equal_bytes(tmp_path):
    record(tmp_path / "a.mp4")
    record(tmp_path / "b.mp4")
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_nothing_is_left_of_what_fails(tmp_path):
    with pytest.raises(RuntimeError), MotionJpegWriter(tmp_path / "a.mp4", (96, 64), 25.0) as video:
        video.write(picture(0))
        raise RuntimeError
    with pytest.raises(DataError, match="without pictures"):
        MotionJpegWriter(tmp_path / "a.mp4", (96, 64), 25.0).close()
    assert not list(tmp_path.iterdir())


def test_mistakes_are_told(tmp_path):
    with MotionJpegWriter(tmp_path / "a.mp4", (96, 64), 25.0) as video:
        video.write(picture(0))
        with pytest.raises(DataError, match="96x64"):
            video.write(picture(0, (64, 64)))
    with pytest.raises(UsageError):
        video.write(picture(1))
    with pytest.raises(UsageError):
        MotionJpegWriter(tmp_path / "b.mp4", (96, 64), 0.0)
    (tmp_path / "file").write_text("")
    with pytest.raises((EnvironmentProblem, DataError)):
        MotionJpegWriter(tmp_path / "file" / "a.mp4", (96, 64), 25.0)
