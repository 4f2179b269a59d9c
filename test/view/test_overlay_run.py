"""Overlays of a run: every picture shows its own frames and poses."""

import cv2
import numpy as np
import pytest

from panoptic_ros.capture.image_folder import ImageFolderSource
from panoptic_ros.domain import DetectionSet
from panoptic_ros.errors import DataError
from panoptic_ros.io.colors import bgr_of
from panoptic_ros.view.overlay_run import OverlayRun


@pytest.fixture
def run(tmp_path, rig, make_poses, detect):
    """Sources of two cameras, detections and poses of six instants; camera 1 lacks the third."""
    sources = []
    for camera in rig.cameras[:2]:
        folder = tmp_path / "in" / camera.name
        folder.mkdir(parents=True)
        for i in range(6):
            cv2.imwrite(str(folder / f"{i}.png"), np.full((240, 320, 3), 20 * i, np.uint8))
        sources.append(ImageFolderSource(camera.name, folder))
    poses = [make_poses([(0.0, 0.15 * i)], [4], i) for i in range(6)]
    sets = []
    for i, pose in enumerate(poses):
        cameras = rig.cameras[:1] if i == 2 else rig.cameras[:2]
        views = [detect(camera, pose) for camera in cameras]
        sets.append(DetectionSet(i, pose.stamp_ns, pose.skeleton_hash, views))
    return sources, sets, poses


def test_pictures_show_the_frames_of_their_sets(tmp_path, rig, skeleton, run):
    sources, sets, poses = run
    done = []
    out = tmp_path / "out"
    files = OverlayRun(rig, skeleton).write(out, sources, sets, poses, stills=3, on_frame=done.append)
    assert [path.name for path in files] == ["overlay.mp4", *(path.name for path in files[1:])]
    assert len(files) == 4 and done == [1, 2, 3, 4, 5, 6]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(path.name for path in files)
    capture = cv2.VideoCapture(str(files[0]))
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(30.0)
    pictures = [capture.read()[1].astype(int) for _ in range(6)]
    assert not capture.read()[0]
    levels = [[np.median(p[:, 10:310, 0]), np.median(p[:, 340:640, 0])] for p in pictures]
    expected = [[20 * i, 24 if i == 2 else 20 * i] for i in range(6)]
    assert np.abs(np.array(levels) - expected).max() <= 6
    still = cv2.imread(str(files[1])).astype(int)
    at = rig.cameras[0].project(poses[1].positions[0, 0])[0]
    x, y = np.round(at).astype(int)
    assert np.abs(still[y, x] - bgr_of(4)).max() < 40


def test_nothing_to_draw_and_nothing_left_behind(tmp_path, rig, skeleton, run):
    sources, sets, poses = run
    assert OverlayRun(rig, skeleton).write(tmp_path / "out", sources, [], poses) == []
    (sources[0].files[3]).write_bytes(b"broken")
    with pytest.raises(DataError, match=r"3\.png"):
        OverlayRun(rig, skeleton).write(tmp_path / "out", sources, sets, poses, stills=0)
    assert list((tmp_path / "out").iterdir()) == []
