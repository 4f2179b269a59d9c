"""The 3D plot: geometry that is right, a picture with the right colours in it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from panoptic_ros.domain import Rig
from panoptic_ros.errors import DataError, EnvironmentProblem
from panoptic_ros.geometry import Intrinsics
from panoptic_ros.io.colors import bgr_of
from panoptic_ros.view.plot3d import frustum_lines, head_paths, plot_capture


def test_frusta_end_at_the_images_corners(make_camera):
    camera = make_camera("cam", 0.7, distortion=(-0.1, 0.02))
    lines = frustum_lines(camera, 0.5)
    assert lines.shape == (8, 2, 3) and np.allclose(lines[:4, 0], camera.centre)
    pixels, seen = camera.project(lines[:4, 1])
    assert seen.all() and np.allclose(pixels, [[0, 0], [319, 0], [319, 239], [0, 239]], atol=1e-6)
    assert np.allclose(lines[4:, 0], lines[:4, 1]) and np.allclose(lines[4:, 1], np.roll(lines[:4, 1], -1, 0))


def test_frusta_of_wide_lenses_stay_near(make_camera):
    camera = make_camera("cam", 0.7)
    for focal in (100.0, 60.0):  # with these corners are at 115 and 190 degrees
        matrix = np.array([[focal, 0, 160], [0, focal, 120], [0, 0, 1]])
        wide = replace(camera, intrinsics=Intrinsics(matrix, np.zeros(4), "fisheye"))
        lines = frustum_lines(wide, 0.5)
        away = np.linalg.norm(lines[:4, 1] - camera.centre, axis=1)
        assert (away < 1.2).all() and np.allclose(wide.cam_from_world.apply(lines[:4, 1])[:, 2], 0.5)


def test_paths_of_heads_have_gaps_where_people_are_away(skeleton, make_poses):
    poses = [make_poses([(0.1 * i, 0.0)], [5], i) for i in range(4)]
    poses[2] = make_poses([(9.0, 9.0)], [2], 2)
    paths = head_paths(skeleton, poses)
    assert list(paths) == [2, 5]
    assert np.isnan(paths[5][:, 0]).tolist() == [False, False, True, False]
    assert np.allclose(paths[5][3], [0.3, 0.0, 1.7])


def test_the_plot_shows_everybody(tmp_path, rig, skeleton, make_poses):
    poses = [make_poses([(0.1 * i, 0.5), (-0.1 * i, -0.5)], [3, 8], i) for i in range(10)]
    plot_capture(tmp_path / "plot.png", rig, skeleton, poses, title="two people")
    picture = cv2.imread(str(tmp_path / "plot.png")).astype(int)
    assert picture.shape == (540, 1400, 3)
    for half in (picture[:, :700], picture[:, 760:]):
        for identity in (3, 8):
            assert (np.abs(half - bgr_of(identity)).max(-1) < 12).sum() > 50
    first = (tmp_path / "plot.png").read_bytes()
    plot_capture(tmp_path / "plot.png", rig, skeleton, poses, title="two people")
    assert (tmp_path / "plot.png").read_bytes() == first


def test_plots_without_people_and_of_one_camera(tmp_path, rig, skeleton, make_poses):
    plot_capture(tmp_path / "a.png", Rig(rig.cameras[:1]), skeleton, [])
    plot_capture(tmp_path / "b.png", rig, skeleton, [make_poses([], [])])
    whole = make_poses([(0.0, 0.5)], [3])
    gone = {
        "positions": np.full_like(whole.positions, np.nan),
        "states": np.zeros_like(whole.states),
        "scores": np.zeros_like(whole.scores),
    }
    plot_capture(tmp_path / "c.png", rig, skeleton, [replace(whole, **gone)])
    assert all(cv2.imread(str(tmp_path / f"{name}.png")) is not None for name in "abc")


def test_what_cannot_be_plotted(tmp_path, rig, skeleton, make_poses):
    pose = make_poses([(0, 0)], [1])
    object.__setattr__(pose, "skeleton_hash", "other")
    with pytest.raises(DataError, match="of skeleton other"):
        plot_capture(tmp_path / "a.png", rig, skeleton, [pose])
    (tmp_path / "file").write_text("")
    with pytest.raises((EnvironmentProblem, DataError), match="cannot write"):
        plot_capture(tmp_path / "file" / "a.png", rig, skeleton, [])
