"""Videos and pictures in files: complete or not there."""
import cv2
import numpy as np
import pytest

from panoptic_ros.errors import ConfigError, DataError, EnvironmentProblem, UsageError
from panoptic_ros.view.video import OverlayVideo, Stills, write_image


def _picture(level, size=(64, 48)):
    return np.full((size[1], size[0], 3), level, np.uint8)


@pytest.mark.parametrize("codec", ["mpeg4", "vp9"])
def test_a_video_comes_back_as_it_was_written(tmp_path, codec):
    path = tmp_path / "deep" / "a.mp4"
    with OverlayVideo(path, (64, 48), 25.0, codec) as video:
        for i in range(12):
            video.write(_picture(20 * i))
            assert not path.exists()
    capture = cv2.VideoCapture(str(path))
    assert capture.get(cv2.CAP_PROP_FPS) == 25.0
    levels = [capture.read()[1].mean() for _ in range(12)]
    assert not capture.read()[0] and np.abs(np.array(levels) - 20 * np.arange(12)).max() < 8
    assert [p.name for p in path.parent.iterdir()] == ["a.mp4"]


def test_an_interruption_leaves_nothing(tmp_path):
    with pytest.raises(KeyboardInterrupt), OverlayVideo(tmp_path / "a.mp4", (64, 48), 25.0) as video:
        video.write(_picture(1))
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_no_frames_no_file_and_closing_twice(tmp_path):
    video = OverlayVideo(tmp_path / "a.mp4", (64, 48), 25.0)
    video.close()
    video.close()
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(UsageError, match="closed"):
        video.write(_picture(1))


def test_a_damaged_file_is_noticed(tmp_path):
    video = OverlayVideo(tmp_path / "a.mp4", (64, 48), 25.0)
    video.write(_picture(1))
    video.frame_count += 5  # as if five frames had not reached the disk
    with pytest.raises(EnvironmentProblem, match="1 of 6 frames arrived; is the disk full"):
        video.close()
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises((EnvironmentProblem, DataError), match="cannot write"):
        OverlayVideo(tmp_path / "file" / "a.mp4", (64, 48), 25.0)
    with pytest.raises(UsageError, match="even"):
        OverlayVideo(tmp_path / "a.mp4", (63, 48), 25.0)
    with pytest.raises(UsageError, match=r"\.mp4"):
        OverlayVideo(tmp_path / "a.avi", (64, 48), 25.0)
    with pytest.raises(ConfigError, match="mpeg4, vp9, h264"):
        OverlayVideo(tmp_path / "a.mp4", (64, 48), 25.0, "av1")
    with OverlayVideo(tmp_path / "a.mp4", (64, 48), 25.0) as video, pytest.raises(DataError, match="64x48"):
        video.write(_picture(1, (48, 64)))


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
