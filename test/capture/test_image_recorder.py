"""Single images of cameras become a capture folder whose files are whole at any time."""

import cv2
import numpy as np
import pytest

from panoptic_ros.capture.image_recorder import ImageRecorder, RecordedImage
from panoptic_ros.errors import DataError, EnvironmentProblem
from panoptic_ros.running.calibration.recorded_images import open_images


def image_of(stamp_ns, grey):
    data = cv2.imencode(".png", np.full((12, 16), grey, np.uint8))[1].tobytes()
    return RecordedImage(stamp_ns, ".png", data)


def test_images_are_read_again_with_their_stamps(tmp_path):
    recorder = ImageRecorder(tmp_path / "r")
    recorder.add({"left": image_of(5, 10), "right": image_of(6, 20)})
    recorder.add({"right": image_of(100, 30)})
    assert recorder.counts == {"left": 1, "right": 2}
    with open_images(tmp_path / "r") as recorded:
        read = {
            source.camera: [(frame.stamp_ns, int(frame.image[0, 0, 0])) for frame in source]
            for source in recorded.sources
        }
    assert read == {"left": [(5, 10)], "right": [(6, 20), (100, 30)]}


def test_a_recording_is_never_overwritten(tmp_path):
    recorder = ImageRecorder(tmp_path / "r")
    assert not (tmp_path / "r").exists()
    recorder.add({"left": image_of(5, 10)})
    with pytest.raises(DataError, match="exists already"):
        ImageRecorder(tmp_path / "r")


def test_images_that_cannot_all_be_written_leave_nothing(tmp_path):
    recorder = ImageRecorder(tmp_path / "r")
    recorder.add({"left": image_of(5, 10), "right": image_of(6, 20)})
    (tmp_path / "r" / "right").rename(tmp_path / "away")
    (tmp_path / "r" / "right").write_text("no folder")
    with pytest.raises((DataError, EnvironmentProblem)):
        recorder.add({"left": image_of(50, 10), "right": image_of(60, 20)})
    (tmp_path / "r" / "right").unlink()
    (tmp_path / "away").rename(tmp_path / "r" / "right")
    files = sorted(path.name for path in (tmp_path / "r").rglob("*") if path.is_file())
    assert files == ["000000.png", "000000.png", "timestamps.csv"]
    assert len((tmp_path / "r" / "timestamps.csv").read_text().splitlines()) == 3
