"""Who comes back is told from who was there all the time."""

import numpy as np
from captures import RIG, SKELETON, person

from panoptic_ros.domain.subjects import Instant, Subject, ViewPeople
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.pose_prior import read_prior
from panoptic_ros.kinematics.body.evidence import Weighing
from panoptic_ros.kinematics.body.sight import Sites
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.people.presence import Presence
from panoptic_ros.kinematics.people.returning import LOOKS, Absence, Appearance

FRAME = 33_000_000


def seen(*places):
    return [Appearance(np.array([x, y, 1.0]), {0: (np.zeros((3, 2)), np.ones(3))}) for x, y in places]


def absent(looks, begin=0, place=(0.0, 0.0, 1.0), alone=False):
    """Looks one after another; the numbers of those in which the subject is back."""
    absence, back = Absence(np.array(place), -200_000_000, alone), []
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
    return Instant(stamp_ns, people, {})


def test_who_is_seen_in_part_is_neither_elsewhere_nor_somebody_else():
    subject = Subject(0, read_body_model().body(1.7))
    weighing = Weighing(KinematicsConfig(), subject, read_prior(), RIG, SKELETON.joint_names)
    expected = Sites(np.arange(len(SKELETON.joint_names)), person((0.0, 0.0), 0.3))
    presence, at = Presence(), half_seen((0.0, 0.0), 10 * FRAME)
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
