"""The stage finds a subject again that was out of sight, and takes nobody else meanwhile."""

from dataclasses import replace

import numpy as np
import pytest
from captures import CONTEXT, RIG, SKELETON, person
from stage_cases import SECOND

from panoptic_ros.domain import DetectionSet, JointState, TrackedPoseSet, ViewDetections
from panoptic_ros.domain.subjects import Subject
from panoptic_ros.domain.view_sources import ViewSources
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.pose_prior import read_prior

RATE = 30
LEAVES, RETURNS, END = 30, 60, 80  # frames


def views_of(places, frame):
    """A set of 2D people who stand at these (x, y) m."""
    stamp = round(frame * SECOND / RATE)
    views = []
    for camera in RIG.cameras:
        pixels = np.array([camera.project(person(place, 0.3))[0] for place in places])
        pixels += 0.5 * np.random.default_rng([frame, RIG.index(camera.name)]).standard_normal(pixels.shape)
        scores = np.full(pixels.shape[:2], 0.9)
        views.append(
            ViewDetections(
                camera.name, stamp, frame, camera.image_size, SKELETON.hash, pixels, scores, scores.max(1)
            )
        )
    return DetectionSet(frame, stamp, SKELETON.hash, tuple(views))


def recording(back, bystander):
    """Sets in which the subject stands at (0, 0), is out of sight, and stands at `back` then."""
    sets = []
    for frame in range(END):
        mine = [(0.0, 0.0)] if frame < LEAVES else [back] if frame >= RETURNS else []
        sets.append(views_of([*mine, bystander(frame)], frame))
    return sets


def tracked_until_lost(sets):
    """The sets, each with who is tracked in it: the subject in all views while it is there at first."""
    found = []
    for item in sets:
        count = int(item.index < LEAVES)
        shape = (count, len(SKELETON.joint_names))
        names = tuple(view.camera for view in item.views)
        sources = ViewSources(names, np.full(len(names), item.index), np.zeros((count, len(names)), int))
        found += (
            item,
            TrackedPoseSet(
                item.index,
                item.stamp_ns,
                SKELETON.hash,
                np.tile(person((0.0, 0.0), 0.3), (count, 1, 1)),
                np.tile(1e-4 * np.eye(3), (*shape, 1, 1)),
                np.ones(shape),
                np.full(shape, len(names)),
                np.full(shape, JointState.MEASURED),
                np.ones(count),
                sources=sources,
                ids=np.zeros(count, int),
            ),
        )
    return found


def walking_through(frame):
    """Somebody who comes to where the subject was, and stays there."""
    return (max(0.0, 1.5 - 0.06 * max(0, frame - LEAVES)), 0.1)


def bodies_of(sets, designated=True, **values):
    """What the stage gives, of the subject or of everybody."""
    model, prior = read_body_model(), read_prior()
    subject = Subject(0, model.body(1.7), (), start=np.array([0.0, 0.0, 0.95]))
    extras = {"subjects": (subject,) if designated else (), "segments": model, "pose_prior": prior}
    config = configure({"kinematics": {"rate_hz": 30.0, "lag": 0.0, **values}})["kinematics"]
    stage = make_stage("kinematics", config, replace(CONTEXT, extras=extras))
    results = [stage.step(item) for item in sets] + [stage.flush()]
    return [body for result in results for body in result.outputs]


def solved(sets, **values):
    """Stamps, s, and middles of the joints (N, 2) m of the subject."""
    bodies = [body for body in bodies_of(sets, **values) if len(body.ids)]
    stamps = np.array([body.stamp_ns / SECOND for body in bodies])
    return stamps, np.array([np.nanmedian(body.keypoints[0], axis=0)[:2] for body in bodies])


@pytest.mark.parametrize("items", [list, tracked_until_lost])
def test_who_stands_where_the_subject_left_is_not_taken_and_the_subject_is_found_elsewhere(items):
    back = (-0.9, -0.7)
    stamps, places = solved(items(recording(back, walking_through)))
    # as it was going, until it is given up
    gone = (stamps > (LEAVES + 1) / RATE) & (stamps < RETURNS / RATE)
    assert np.linalg.norm(places[gone], axis=1).max(initial=0.0) < 0.2
    assert stamps[gone].max(initial=0.0) < LEAVES / RATE + 0.7
    after = stamps > (RETURNS + 5) / RATE
    assert after.sum() > 10 and np.linalg.norm(places[after] - back, axis=1).max() < 0.15


@pytest.mark.parametrize("lag", [0.0, 0.1])
def test_everybody_has_a_body_until_it_is_given_up_and_the_instants_that_the_lag_holds_back_are_given(lag):
    sets = tracked_until_lost(recording((0.0, 0.0), walking_through))
    bodies = bodies_of(sets, designated=False, everybody=True, lag=lag)
    there = np.array([item.stamp_ns / SECOND for item in bodies if len(item.ids)])
    assert len(bodies) >= END - 1
    assert np.abs(there.max() - (LEAVES / RATE + 0.5)) < 0.1  # LOST_S after the last data
    assert len(there) > 0.9 * (there.max() - there.min()) * RATE
