"""`line_delay_us` in rig.json, from files to 3D poses."""

from dataclasses import replace

import captures
import numpy as np
import pytest
from rolling import rolling_points, with_line_delays

from panoptic_ros.cli.main import main
from panoptic_ros.domain import DetectionSet
from panoptic_ros.io.plain_formats import read_detections, read_skeletons, write_detections
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.running.kinematics import view_series

FRAMES, START_NS = 30, 10**9
NOISE_PX = 0.2
RIG = with_line_delays(captures.RIG, (20.0, 40.0, 30.0))


def people(time_s):
    """Two people, of whom one walks, as `captures`, but three times as fast."""
    return captures.people(3.0 * time_s)


@pytest.fixture(scope="module")
def detections(tmp_path_factory):
    """File of what cameras with rolling shutters see; all first rows of a frame are exposed together."""
    sets, rng = [], np.random.default_rng(0)
    for index in range(FRAMES):
        stamp = START_NS + round(index * 1e9 / 30.0)
        views = []
        for camera in RIG.cameras:
            whole = captures.view(camera, index, stamp, noise=0.0)
            points = rolling_points(camera, people, 1e-9 * stamp)
            points = points + NOISE_PX * rng.standard_normal(points.shape)
            scores = np.where(camera.contains(points), 0.9, 0.0)
            points = np.where(scores[..., None] > 0.0, points, np.nan)
            views.append(replace(whole, points=points, scores=scores))
        sets.append(DetectionSet(index, stamp, captures.SKELETON.hash, tuple(views)))
    path = tmp_path_factory.mktemp("rolling") / "detections.json.gz"
    write_detections(path, captures.SKELETON.joint_names, sets)
    return path


def worst_errors(rig, detections, folder):
    """mm, largest error of a joint in each frame, after the start."""
    write_rig(folder / "rig.json", rig)
    files = ["--rig", str(folder / "rig.json"), "--detections", str(detections)]
    assert main(["solve", *files, "--out", str(folder / "s.json"), "--quiet"]) == 0
    worst = []
    for frame in read_skeletons(folder / "s.json").frames[8:]:
        truth = people(1e-9 * frame.stamp_ns)
        gaps = np.linalg.norm(frame.positions[:, None] - truth[None], axis=-1).max(-1)
        worst.append(1e3 * gaps.min(axis=0).max())
    return np.array(worst)


def test_solve_takes_every_joint_at_the_exposure_of_its_row(detections, tmp_path):
    assert worst_errors(RIG, detections, tmp_path).max() < 5.0
    assert np.median(worst_errors(captures.RIG, detections, tmp_path)) > 20.0


def test_bodies_are_solved_from_views_at_their_middle_rows(detections):
    series = view_series(RIG, read_detections(detections))
    for number, camera in enumerate(RIG.cameras):
        middle = round(1e3 * camera.line_delay_us * 0.5 * (camera.image_size[1] - 1))
        assert series[number].stamps[0] == START_NS + middle
