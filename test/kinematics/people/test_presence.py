"""The stage finds a subject again that was out of sight, and takes nobody else meanwhile.

Who comes back is told from who was there all the time.
"""

from dataclasses import replace

import numpy as np
import pytest
from captures import CONTEXT, RIG, SKELETON, person
from stage_cases import SECOND

from panoptic_ros.domain import DetectionSet, JointState, TrackedPoseSet, ViewDetections
from panoptic_ros.domain.subjects import InstantViews, Subject, ViewPeople
from panoptic_ros.domain.view_sources import ViewSources
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.pose_prior import read_prior
from panoptic_ros.kinematics.body.evidence import EvidenceBuilder
from panoptic_ros.kinematics.body.sight import ExpectedJoints
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.people.presence import LOOKS, PersonSighting, SubjectPresence, SubjectSearch

RATE = 30
LEAVES, RETURNS, END = 30, 60, 80  # frames
FRAME = 33_000_000


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


def seen(*places):
    return [PersonSighting(np.array([x, y, 1.0]), {0: (np.zeros((3, 2)), np.ones(3))}) for x, y in places]


def absent(looks, begin=0, place=(0.0, 0.0, 1.0), alone=False):
    """Looks one after another; the numbers of those in which the subject is back."""
    absence, back = SubjectSearch(np.array(place), -200_000_000, alone), []
    for k, appearances in enumerate(looks):
        if absence.look(appearances, begin + k * FRAME, 0.5):
            back.append(k)
    return back


def test_somebody_who_stays_or_walks_past_is_never_taken():
    bystander = [seen((3.0 - 0.04 * k, 0.2)) for k in range(120)]  # right through where the subject was last
    assert absent(bystander) == []


def test_a_newcomer_is_taken_once_several_looks_agree():
    looks = [seen((3.0, 0.0)) for _ in range(30)] + [seen((3.0, 0.0), (1.0, 1.0)) for _ in range(5)]
    assert absent(looks)[0] == 30 + LOOKS - 1


def test_a_ghost_of_one_look_and_who_is_too_far_are_not():
    ghosts = [seen((0.9, 0.9)) if k % 40 == 39 else [] for k in range(120)]
    assert absent(ghosts) == []
    assert absent([seen() for _ in range(12)] + [seen((9.0, 0.0)) for _ in range(10)]) == []


def test_who_never_left_is_found_at_once():
    assert absent([seen((0.3, 0.0)) for _ in range(5)])[0] == LOOKS - 1


def test_whoever_is_seen_is_the_subject_where_nobody_else_was():
    looks = [seen((0.9, 0.0)) for _ in range(5)]
    assert absent(looks) == [] and absent(looks, alone=True)[0] == LOOKS - 1


def half_seen(place, stamp_ns):
    """Somebody of whom two views show what is above the hips, at an instant."""
    people, joints = {}, person(place, 0.3)
    for number in (0, 1):
        pose = RIG.cameras[number].cam_from_world
        local = joints @ pose.rotation.T + pose.translation
        points = np.where(joints[:, 2:] > 1.2, local[:, :2] / local[:, 2:], np.nan)
        people[number] = ViewPeople(points[None], np.full((1, len(points)), 0.9))
    return InstantViews(stamp_ns, people)


def test_who_is_seen_in_part_is_neither_elsewhere_nor_somebody_else():
    subject = Subject(0, read_body_model().body(1.7))
    weighing = EvidenceBuilder(KinematicsConfig(), subject, read_prior(), RIG, SKELETON.joint_names)
    expected = ExpectedJoints(np.arange(len(SKELETON.joint_names)), person((0.0, 0.0), 0.3))
    presence, at = SubjectPresence(), half_seen((0.0, 0.0), 10 * FRAME)
    mine = {camera: (people.points[0], people.scores[0]) for camera, people in at.views.items()}
    assert presence.own(mine, expected, weighing, at).keys() == {0, 1}
    presence.saw(at, True, expected.middle)
    found = {}
    for k in range(11, 40):
        at = half_seen((0.3, 0.0), k * FRAME)
        found = presence.back(at, weighing, [], 0.5, expected) if presence.is_away else {}
        presence.saw(at, bool(found), expected.middle)
        if found:
            break
    assert found.keys() == {0, 1}
