"""Views that come late: what IMUs are compared with is of instants for which all have come."""

from dataclasses import replace

from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.pose_prior import read_prior
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.stage import KinematicsStage
from panoptic_ros.stage import StageContext
from panoptic_ros.study.bodies.body_feed import body_feed

BEGIN, RATE, SECONDS = 1_000_000_000, 30, 5.4
LATE_NS = 14_000_000  # beyond the next views: without tracks, views wait for these


def test_a_clock_that_is_right_seems_right():
    model = read_body_model()
    feed = body_feed(1, RATE, 8.0, 1, model, read_clips())
    extras = {"subjects": feed.subjects, "segments": model, "pose_prior": read_prior("")}
    stage = KinematicsStage(KinematicsConfig(), StageContext(feed.rig, feed.skeleton, extras))
    come = []
    for number in range(round(SECONDS * RATE)):
        stamp, views = BEGIN + number * feed.period_ns, feed.sets[number].views
        at_it = tuple(replace(view, stamp_ns=stamp, frame_number=number) for view in views)
        come.append((stamp + LATE_NS, replace(feed.sets[number], stamp_ns=stamp, index=number, views=at_it)))
        come += [(stamp + ns, replace(one, stamp_ns=stamp + ns)) for ns, one in feed.samples(number)]
    told = [notice for _, item in sorted(come, key=lambda row: row[0]) for notice in stage.step(item).notices]
    (person,) = stage._people.values()
    assert not told and not person.fitting.looking and person.fitting.offset_ns == 0
