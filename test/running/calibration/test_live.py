"""A board before live cameras is recorded with a guide, and calibrated at Ctrl-C; the recording stays."""

import re
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
from board_images import artwork, board_poses, photograph, small_rig

rclpy = pytest.importorskip("rclpy")
from rclpy.qos import QoSProfile, ReliabilityPolicy  # noqa: E402

from panoptic_ros.calibration.boards import parse_board  # noqa: E402
from panoptic_ros.cli.main import main  # noqa: E402
from panoptic_ros.domain import Rig, ViewFrame  # noqa: E402
from panoptic_ros.io.messages.images import compressed_image_message, image_message  # noqa: E402
from panoptic_ros.io.rigs import read_rig  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.running.calibration import live, live_cameras  # noqa: E402

pytestmark = pytest.mark.ros
BOARD = "charuco:5x4:60mm"
# names that no other graph has which may run in the same ROS domain
RIG = Rig(tuple(replace(c, name=name) for c, name in zip(small_rig(2).cameras, ("guide_a", "guide_b"))))
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class FakeCameras:
    """Drivers that show a moving board in real time: guide_a raw, guide_b as JPEG. A context manager."""

    def __init__(self, pictures):
        self._pictures, self._over = pictures, threading.Event()
        self._context = rclpy.context.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node("fake_cameras", context=self._context)
        make = self._node.create_publisher
        self._publishers = (
            make(message_class("sensor_msgs/msg/Image"), "/guide_a/image_raw", BEST_EFFORT),
            make(
                message_class("sensor_msgs/msg/CompressedImage"), "/guide_b/image_raw/compressed", BEST_EFFORT
            ),
        )
        self._thread = threading.Thread(target=self._publish)

    def _publish(self):
        for images in iter(lambda: next(self._pictures, None), None):
            if self._over.wait(0.1):
                return
            stamp = time.time_ns()
            frames = [ViewFrame(c.name, stamp, 0, image) for c, image in zip(RIG.cameras, images)]
            self._publishers[0].publish(image_message(frames[0], ros_messages()))
            self._publishers[1].publish(compressed_image_message(frames[1], ros_messages(), 95))

    def __enter__(self):
        self._thread.start()

    def __exit__(self, *exception):
        self._over.set()
        self._thread.join()
        self._node.destroy_node()
        self._context.try_shutdown()


def pictures():
    """Yield the images of both cameras, of a board in another place each time, without end."""
    board = parse_board(BOARD)
    printed = artwork(board)
    made = [
        [cv2.cvtColor(photograph(camera, board, pose, printed), cv2.COLOR_GRAY2BGR) for camera in RIG.cameras]
        for pose in board_poses(40)
    ]
    while True:
        yield from made


def test_a_board_before_live_cameras_gives_a_rig(tmp_path):
    out = tmp_path / "o"
    words = ["--board", BOARD, "--synchronous", "--cameras", "guide_a,guide_b", "--port", "0", "--no-browser"]
    with FakeCameras(pictures()):
        program = subprocess.Popen(
            [sys.executable, "-m", "panoptic_ros.cli.main", "calibrate", "--live", *words, "--out", str(out)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        assert program.stdout is not None
        said = ""
        for line in program.stdout:
            said += line
            predicted = re.search(r"predicted error .*: ([\d.]+) mm", line)
            if predicted and float(predicted[1]) < 2.0:
                break
        program.send_signal(signal.SIGINT)
        said += program.communicate(timeout=60)[0]
    assert program.returncode == 0, said
    assert "open http://127.0.0.1:" in said and re.search(r"guide_\w: .*(cover|tilt|turn|show)", said)
    found = read_rig(out / "rig.json")
    assert found.names == ("guide_a", "guide_b")
    centres = [camera.cam_from_world.inverse().translation for camera in found.cameras]
    assert np.linalg.norm(centres[1] - centres[0]) == pytest.approx(0.8, abs=0.03)
    kept = sorted(path.suffix for path in (out / "recording").rglob("*") if path.is_file())
    assert set(kept) == {".csv", ".jpg", ".png"}
    again = ["calibrate", str(out / "recording"), "--board", BOARD, "--synchronous", "--quiet"]
    assert main([*again, "--out", str(tmp_path / "again")]) == 0
    assert (tmp_path / "again" / "rig.json").read_bytes() == (out / "rig.json").read_bytes()


@pytest.mark.parametrize(
    "words, said",
    [
        ([], "give a folder or bag with images of the board, or --live"),
        (["x", "--live"], "--live records from cameras"),
        (["x", "--cameras", "cam0"], "--cameras is for --live"),
        (["x", "--no-browser"], "--no-browser is for --live"),
        (["--live", "--people"], "--people is not for --live"),
        (["--live", "--paper", "a4"], "--paper is for `panoptic calibrate print`"),
        (["x", "--paper", "a4"], "--paper is for `panoptic calibrate print`"),
        (["--live", "--floor", "1"], "--floor is not for --live"),
        (["--live", "--board", "wand:0/150/500mm"], "--live needs a flat board"),
        (["--live", "--cameras", "a", "--topics", "b.yaml"], "leave --cameras out"),
        (["--live", "--topics", "none.yaml"], "none.yaml"),
    ],
)
def test_options_that_do_not_fit_are_refused(words, said, tmp_path, capsys):
    assert main(["calibrate", *words, "--out", str(tmp_path / "o")]) == 2
    told = capsys.readouterr().err
    assert said in told and told.count("\n") == 1
    assert not (tmp_path / "o").exists()


def test_cameras_that_are_not_there_are_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(live_cameras, "PATIENCE_S", 1.0)
    assert main(["calibrate", "--live", "--cameras", "no_such", "--out", str(tmp_path / "o")]) == 2
    told = capsys.readouterr().err  # other graphs may publish images
    assert re.search(r"no camera (no_such )?publishes images within 1 s", told) and told.count("\n") == 1


def test_a_stop_during_the_search_for_cameras_is_obeyed_at_once():
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        live_cameras.find_cameras(["no_such"], None, print, lambda: True)
    assert time.monotonic() - begin < 0.5 * live_cameras.PATIENCE_S


def test_topics_without_images_are_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(live, "PATIENCE_S", 1.0)
    with FakeCameras(iter([])):
        assert (
            main(["calibrate", "--live", "--cameras", "guide_a,guide_b", "--out", str(tmp_path / "o")]) == 2
        )
    told = capsys.readouterr().err
    assert (
        "no image of camera guide_a came on /guide_a/image_raw within 1 s" in told and told.count("\n") == 1
    )
    assert not (tmp_path / "o").exists()


def test_a_recording_is_not_overwritten(tmp_path, capsys):
    (tmp_path / "o" / live.RECORDING).mkdir(parents=True)
    assert main(["calibrate", "--live", "--out", str(tmp_path / "o")]) == 2
    assert "exists already" in capsys.readouterr().err
