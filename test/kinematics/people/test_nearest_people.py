"""Who stands where a subject starts is told by views that agree."""

import numpy as np
from captures import RIG, SKELETON, person

from panoptic_ros.domain.subjects import InstantViews, Subject, ViewPeople
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.pose_prior import read_prior
from panoptic_ros.kinematics.body.evidence import EvidenceBuilder
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.people.nearest_people import nearest_to_start

SUBJECT = Subject(0, read_body_model().body(1.7), start=np.array([0.0, 0.0, 0.95]))
WEIGHING = EvidenceBuilder(KinematicsConfig(), SUBJECT, read_prior(), RIG, SKELETON.joint_names)


def on_plane(camera, place):
    """A 2D person on the plane at distance 1."""
    local = person(place, 0.3) @ camera.cam_from_world.rotation.T + camera.cam_from_world.translation
    return local[:, :2] / local[:, 2:]


def behind(camera, metres):
    """A place on the ray of a camera through where the subject starts."""
    way = SUBJECT.start[:2] - camera.centre[:2]
    return metres * way / np.linalg.norm(way)


def instant(views):
    """Of places by camera."""
    people = {}
    for number, places in views.items():
        points = np.array([on_plane(RIG.cameras[number], place) for place in places])
        people[number] = ViewPeople(points, np.full(points.shape[:2], 0.9))
    return InstantViews(0, people)


def rows(found, at):
    """Who was taken, by camera."""
    return {
        camera: next(k for k, one in enumerate(at.views[camera].points) if np.array_equal(one, own[0]))
        for camera, own in found.items()
    }


def test_views_that_agree_tell_who_it_is():
    other = behind(RIG.cameras[0], 1.3)
    at = instant({k: [other, (0.0, 0.0)] for k in range(3)})
    assert rows(nearest_to_start(SUBJECT, at, WEIGHING, alone=False), at)[1] == 1


def test_a_view_that_misses_the_subject_does_not_tell_it():
    other = behind(RIG.cameras[0], 1.3)
    assert nearest_to_start(SUBJECT, instant({0: [other]}), WEIGHING, alone=False) == {}
    assert nearest_to_start(SUBJECT, instant({0: [other], 1: [other]}), WEIGHING, alone=False) == {}


def test_one_view_tells_it_where_it_may():
    at = instant({0: [(2.0, 0.0), (0.2, 0.1)]})
    assert rows(nearest_to_start(SUBJECT, at, WEIGHING), at) == {0: 1}
    assert nearest_to_start(SUBJECT, instant({0: [(0.0, 2.0)]}), WEIGHING) == {}
