"""Overlays: the right colour at the right pixel, whatever the lens, the scale and the state."""

import numpy as np
import pytest

from panoptic_ros.domain import JointState
from panoptic_ros.errors import DataError
from panoptic_ros.io.colors import bgr_of
from panoptic_ros.view.overlay import DETECTION_COLOR, draw_view

BLACK = np.zeros((240, 320, 3), np.uint8)
MEASURED, PREDICTED, FILLED, MISSING = (
    JointState.MEASURED,
    JointState.PREDICTED,
    JointState.FILLED,
    JointState.MISSING,
)


def _near(image, pixel, color, radius=1):
    """Whether a colour is within `radius` of a pixel."""
    x, y = (round(float(value)) for value in pixel)
    patch = image[max(0, y - radius) : y + radius + 1, max(0, x - radius) : x + radius + 1]
    return bool((np.abs(patch.astype(int) - color).max(-1) <= 40).any())


@pytest.mark.parametrize("scale", [1.0, 0.5, 2.0])
@pytest.mark.parametrize("distortion", [(0.0,), (-0.3, 0.1, 0.01, -0.01)])
def test_joints_and_bones_are_where_they_are_seen(make_camera, make_poses, skeleton, scale, distortion):
    camera = make_camera("cam", 0.3, size=(640, 480), distortion=distortion)
    black = np.zeros((480, 640, 3), np.uint8)
    poses = make_poses([(0.2, 0.8), (0.0, -0.5)], [3, 8])
    picture = draw_view(black, camera, poses, skeleton, scale=scale)
    assert picture.shape == (round(480 * scale), round(640 * scale), 3)
    for person, identity in enumerate(poses.ids):
        for joint in range(4):
            pixel = (camera.project(poses.positions[person, joint])[0] + 0.5) * scale - 0.5
            assert _near(picture, pixel, bgr_of(identity))
        for parent, child in skeleton.bones:
            middle = poses.positions[person, [parent, child]].mean(0)
            assert _near(picture, (camera.project(middle)[0] + 0.5) * scale - 0.5, bgr_of(identity))
    assert black.max() == 0


def test_predicted_joints_are_hollow_and_missing_ones_are_not_drawn(make_camera, make_poses, skeleton):
    camera = make_camera("cam", 0.0, size=(1280, 960))
    alone = [[MISSING, PREDICTED, MISSING, MEASURED]]  # no bone connects them
    poses = make_poses([(0.0, 0.0)], [5], states=alone)
    picture = draw_view(np.zeros((960, 1280, 3), np.uint8), camera, poses, skeleton)
    pixels = camera.project(make_poses([(0.0, 0.0)], [5]).positions[0])[0]
    assert _near(picture, pixels[3], bgr_of(5), 0)
    assert not _near(picture, pixels[1], bgr_of(5), 1) and _near(picture, pixels[1], bgr_of(5), 8)
    assert not _near(picture, pixels[2], bgr_of(5), 8)


def test_filled_joints_are_hollow_squares(make_camera, make_poses, skeleton):
    camera = make_camera("cam", 0.0, size=(1280, 960))
    poses = make_poses([(0.0, 0.0)], [5], states=[[MISSING, MISSING, MISSING, FILLED]])
    picture = draw_view(np.zeros((960, 1280, 3), np.uint8), camera, poses, skeleton)
    x, y = np.round(camera.project(poses.positions[0, 3])[0]).astype(int)
    lit = (np.abs(picture.astype(int) - bgr_of(5)).max(-1) < 40)[y - 9 : y + 10, x - 9 : x + 10]
    assert not lit[9, 9]
    rows, columns = np.flatnonzero(lit.any(1)), np.flatnonzero(lit.any(0))
    assert lit[rows[1]][columns[1] : columns[-1]].all()  # its corners are full, as a ring's are not


def test_bones_that_reach_behind_the_camera_are_clipped(make_camera, make_poses, skeleton):
    camera = make_camera("cam", 0.0, radius=0.3)
    poses = make_poses([(0.0, 0.0)], [1])
    positions = poses.positions.copy()
    positions[0, 1] = [5.0, 0.0, 1.2]  # the head is behind the camera, the hip before it
    behind = type(poses)(
        0,
        0,
        skeleton.hash,
        positions,
        poses.covariances,
        poses.scores,
        poses.views,
        poses.states,
        poses.person_scores,
        ids=[1],
    )
    picture = draw_view(BLACK, camera, behind, skeleton)
    assert _near(picture, camera.project(positions[0, 0])[0], bgr_of(1))
    assert not picture[:, :100].any() and not picture[:, 220:].any()  # nothing is thrown across


def test_people_out_of_view_leave_the_picture_alone(make_camera, make_poses, skeleton):
    poses = make_poses([(0.0, 60.0), (50.0, 0.0)], [1, 2])  # far aside; behind the camera
    assert not draw_view(BLACK, make_camera("cam", 0.0), poses, skeleton).any()
    assert not draw_view(BLACK, make_camera("cam", 0.0), None, skeleton).any()
    assert not draw_view(BLACK, make_camera("cam", 0.0), make_poses([], []), skeleton).any()


def test_detections_are_thin_and_grey(make_camera, make_poses, detect, skeleton):
    camera = make_camera("cam", 0.0)
    seen = detect(camera, make_poses([(0.0, 0.0)], [1]), shift=(30.0, 0.0))
    picture = draw_view(BLACK, camera, None, skeleton, seen)
    x, y = seen.points[0, [0, 2]].mean(0)
    lit = np.flatnonzero(picture[round(y)].max(-1))
    assert len(lit) <= 3 and abs(lit.mean() - x) < 1.0
    assert np.ptp(picture, axis=-1).max() == 0 and picture.max() <= max(DETECTION_COLOR)


def test_the_label_stays_inside_of_the_picture(make_camera, make_poses, skeleton):
    camera = make_camera("cam", 0.0)
    high = make_poses([(1.0, 0.0)], [7])
    one = draw_view(BLACK, camera, high, skeleton)
    other = draw_view(BLACK, camera, make_poses([(1.0, 0.0)], [7777]), skeleton)
    assert (one != other).any()


def test_what_does_not_fit_is_refused(make_camera, make_poses, skeleton):
    camera = make_camera("cam", 0.0)
    with pytest.raises(DataError, match="image 100x90, calibrated 320x240"):
        draw_view(np.zeros((90, 100, 3), np.uint8), camera, None, skeleton)
    poses = make_poses([(0, 0)], [1])
    object.__setattr__(poses, "skeleton_hash", "other")
    with pytest.raises(DataError, match="of skeleton other"):
        draw_view(BLACK, camera, poses, skeleton)


def test_ids_have_colours_that_differ():
    colors = np.array([bgr_of(i) for i in range(12)], int)
    apart = np.abs(colors[:, None] - colors[None]).max(-1) + 999 * np.eye(12, dtype=int)
    assert apart.min() >= 25 and bgr_of(3) == bgr_of(np.int64(3))
