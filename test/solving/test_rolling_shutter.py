"""Cameras of known line delays see every joint at the exposure of its image row."""

from dataclasses import replace

import numpy as np
from rolling import rolling_points, with_line_delays

from panoptic_ros.domain import DetectionSet
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.solving.joint_records import JointPredictions, PersonCandidates
from panoptic_ros.solving.joints import solve_joints
from panoptic_ros.solving.scene import gather, scene_of
from panoptic_ros.solving.triangulation import SolverRules

LINE_DELAYS_US = (0.0, 30.0, 15.0)
VELOCITY = np.array([6.0, -4.0, 3.0])  # m/s
STAMPS_S = (0.004, -0.011, -0.002, -0.014, 0.006)  # of the first rows, from the instant


def scene_in_motion(scenes, rig, taken=None):
    """The scene of a person who passes, taken by the cameras `taken` and solved with those of `rig`."""
    still, instant = scenes.proposals(rig, [scenes.person()]).detections, scenes.person()
    views = []
    for view, camera, stamp in zip(still.views, (taken or rig).cameras, STAMPS_S):
        points = rolling_points(camera, lambda t: (instant + t * VELOCITY)[None], stamp)
        views.append(replace(view, points=points, stamp_ns=still.stamp_ns + round(1e9 * stamp)))
    item = DetectionSet(0, still.stamp_ns, still.skeleton_hash, tuple(views))
    arrays, skeleton = RigArrays.of(rig), scenes.skeleton
    evidence = gather(item, arrays, skeleton, skeleton.hash, 0.0)
    precision = np.full(evidence.scores.shape, 500.0)
    return scene_of(item, evidence, precision, np.array(skeleton.mirror), arrays)


def worst_error(scenes, rig, taken=None):
    """m, largest error of the joints of that person, whose velocity is known."""
    scene, truth = scene_in_motion(scenes, rig, taken), scenes.person()
    views, joints = len(rig), len(truth)
    shifts = np.tile(VELOCITY, (1, joints, 1))
    guides = JointPredictions(
        truth[None] + 0.03, np.full((1, joints), 0.05), shifts, np.zeros((1, joints), bool)
    )
    source = np.tile(np.arange(joints), (1, views, 1))
    found = PersonCandidates(np.arange(views)[None], source, guides, np.array([0]), guides.positions)
    rules = SolverRules(50.0, 50.0, 50.0, 4.0, 45)
    return np.abs(solve_joints(found, scene.observations, rules).positions[0] - truth).max()


def test_a_person_in_motion_is_exact_with_the_line_delays_of_the_rig(scenes):
    rolling = with_line_delays(scenes.ring(5), LINE_DELAYS_US)
    assert worst_error(scenes, rolling) < 1e-5
    assert worst_error(scenes, scenes.ring(5), rolling) > 0.03


def test_delays_are_those_of_the_rows(scenes):
    rig = with_line_delays(scenes.ring(5), LINE_DELAYS_US)
    scene = scene_in_motion(scenes, rig)
    for v, camera in enumerate(rig.cameras):
        line, middle = 1e-6 * camera.line_delay_us, 0.5 * (camera.image_size[1] - 1)
        assert abs(scene.cams.delays[v] - STAMPS_S[v] - line * middle) < 1e-9
        matrix = camera.intrinsics.matrix  # the lens does not distort
        rows = matrix[1, 1] * scene.evidence.plane[v, :, 1] + matrix[1, 2]
        assert np.abs(scene.delays[v] - STAMPS_S[v] - line * rows).max() < 1e-9


def test_global_shutters_have_the_delays_of_their_views(scenes):
    scene = scene_in_motion(scenes, scenes.ring(5))
    assert (scene.cams.delays == scene.evidence.delays).all()
    assert (scene.delays == scene.evidence.delays[scene.evidence.view][:, None]).all()
