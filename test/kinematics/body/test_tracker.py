"""A body that is lost and comes back is the same person's."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.domain.subjects import ViewPeople, ViewSeries
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.session import solve_recording
from panoptic_ros.simulation.bodies.capture import BodyScene, simulate_body
from panoptic_ros.study.bodies.cases import case_of, prior_without

MODEL, CLIPS = read_body_model(), read_clips()
SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def hidden():
    """Cameras alone, of the stature alone, and nobody to be seen from 5 to 6.5 s."""
    take = simulate_body(BodyScene(("02_05",), seconds=8.0, cameras=4), 9, MODEL, CLIPS)
    case = case_of(take, prior_without(("02_05",), CLIPS, MODEL)).with_inputs(4, 0).of_stature()
    nobody = ViewPeople(
        np.zeros((0, len(case.recording.joint_names), 2)), np.zeros((0, len(case.recording.joint_names)))
    )
    views = {}
    for camera, view in case.recording.views.items():
        since = view.stamps - view.stamps[0]
        gone = (since > 5 * SECOND) & (since < 6.5 * SECOND)
        people = tuple(nobody if g else p for g, p in zip(gone, view.people))
        views[camera] = ViewSeries(view.stamps, people)
    return replace(case, recording=replace(case.recording, views=views))


def test_whoever_comes_back_has_the_lengths_that_were_learnt(hidden):
    solved = solve_recording(hidden.recording, hidden.subjects, KinematicsConfig(), hidden.statistics)
    first = solved.states[0].stamp_ns
    shins = {}
    shin, foot = MODEL.index("lShin"), MODEL.index("lFoot")
    for state in solved.states:
        shins[1e-9 * (state.stamp_ns - first)] = np.linalg.norm(state.places[foot] - state.places[shin])
    stamps = np.array(sorted(shins))
    assert np.diff(stamps).max() > 0.5, "the body is given up"
    before = [shins[t] for t in stamps if t < 5.0][-1]
    after = next(shins[t] for t in stamps if t > 6.5)
    assert before != pytest.approx(shins[0.0], abs=1e-3), "lengths were learnt"
    assert after == pytest.approx(before, abs=1e-6)
