"""The record of solved bodies."""

from dataclasses import replace

import numpy as np
from captures import SKELETON

from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.kinematics.body_records import SolvedBody, body_set

MODEL = read_body_model()


def recorded(skeleton):
    count = len(MODEL.names)
    body, spreads = MODEL.body(1.75), np.tile(1e-4 * np.eye(6), (count, 1, 1))
    places, frames = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
    state = BodyState(0, 3, places, frames, covariances=spreads)
    return body_set(0, 0, 0, MODEL, skeleton, [SolvedBody(state, body, 0, 2, 0)])


def test_constant_biases_of_the_detector_are_in_what_places_say_of_their_errors_and_in_no_rotation():
    plain = recorded(SKELETON)
    floors = np.linspace(0.0, 0.03, len(SKELETON))
    item = recorded(replace(SKELETON, bias_floors=tuple(floors.tolist())))
    assert np.array_equal(item.keypoints, plain.keypoints, equal_nan=True)
    known = np.isfinite(plain.keypoints[0, :, 0])
    more = (item.keypoint_covariances - plain.keypoint_covariances)[0, known]
    assert known.sum() > 10 and np.allclose(more, (floors[known] ** 2)[:, None, None] * np.eye(3))
    more = (item.covariances - plain.covariances)[0]
    assert np.allclose(more[:, :3, :3], (floors**2).mean() * np.eye(3))
    assert not more[:, 3:].any() and not more[:, :, 3:].any()
