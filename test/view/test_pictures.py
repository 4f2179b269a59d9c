"""Pictures in files."""

import cv2
import numpy as np
import pytest

from panoptic_ros.errors import UsageError
from panoptic_ros.view.pictures import Stills, write_image


def _picture(level, size=(64, 48)):
    return np.full((size[1], size[0], 3), level, np.uint8)


def test_pictures(tmp_path):
    write_image(tmp_path / "a.png", _picture(77))
    write_image(tmp_path / "a.JPG", _picture(77))
    assert np.array_equal(cv2.imread(str(tmp_path / "a.png")), _picture(77))
    assert abs(cv2.imread(str(tmp_path / "a.JPG")).mean() - 77) < 2
    with pytest.raises(UsageError, match=r"\.bmp"):
        write_image(tmp_path / "a.bmp", _picture(1))


def test_stills_are_taken_at_or_after_their_instants(tmp_path):
    stills = Stills(tmp_path, (0.0, 0.25, 0.3, 9.0))
    for i in range(11):
        stills.offer(5_000_000_000 + i * 100_000_000, _picture(10 * i))
    stills.close()
    names = [f"overlay_{seconds}s.png" for seconds in ("000.000", "000.300", "001.000")]
    assert [path.name for path in stills.written] == names
    assert [int(cv2.imread(str(path)).mean()) for path in stills.written] == [0, 30, 100]
