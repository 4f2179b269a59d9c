"""A few instants of nobody in particular, which reach all compiled kernels of the moving body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from panoptic_ros.domain.bodies import BodySource
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState, Device, Instant, Subject, ViewPeople
from panoptic_ros.geometry.chain import Pose, place_all
from panoptic_ros.geometry.rotations import from_quaternions
from panoptic_ros.kinematics.body_records import Solved
from panoptic_ros.kinematics.imus.alignment import Felt, align
from panoptic_ros.kinematics.imus.measured import Measured
from panoptic_ros.kinematics.people.nearest_people import assign_people
from panoptic_ros.kinematics.people.person import Person
from panoptic_ros.kinematics.people.seen_people import SeenJoints, SeenPoints
from panoptic_ros.kinematics.pose.prior import PoseStatistics

STATURE = 1.7
GATE = 0.5  # m
COMPARED_S = 0.5  # of what is compared with IMUs: more than a turn takes
SECONDS = 0.3  # more than the lag, so that poses are smoothed, and time for a look at lengths and mountings


def step_examples(
    new_person: Callable[[Subject], Person],
    model: SegmentModel,
    statistics: PoseStatistics,
    joint_names: tuple[str, ...],
    rate_hz: float,
) -> Solved:
    """Solve for somebody with an IMU, from joints in space and from views: the first body."""
    body = model.body(STATURE)
    device = Device("example", 0, np.zeros(3), np.eye(3))
    person = new_person(Subject(0, body, (device,), measured=False))
    root, count = np.array([[0.0, 0.0, 1.0]]), len(model.names)
    places, _ = place_all(body.chain, root, np.tile(np.eye(3), (1, count, 1, 1)))
    pose = Pose(root[0], np.tile(np.eye(3), (count, 1, 1)))
    joints = np.full((len(joint_names), 3), np.nan)
    for j, name in enumerate(joint_names):
        if name in body.keypoints:
            segment, offset = body.keypoints[name]
            joints[j] = places[0, segment] + pose.turns[segment] @ offset
    spread = np.tile(1e-4 * np.eye(3), (len(joint_names), 1, 1))
    level = from_quaternions(np.array([1.0, 0.0, 0.0, 0.0]))
    measured = Measured(np.ones(1, bool), level[None], np.array([[0.0, 0.0, 9.81]]))
    period = round(1e9 / rate_hz)
    rotations, translations = person.weighing.rotations, person.weighing.translations
    seen = joints @ rotations.swapaxes(1, 2) + translations[:, None]
    scores = np.isfinite(joints[:, 0]).astype(float)[None]
    views = {c: ViewPeople((local[:, :2] / local[:, 2:])[None], scores) for c, local in enumerate(seen)}
    states: list[BodyState] = []
    for k in range(round(SECONDS * rate_hz)):
        stamp = k * period
        if k <= 1:
            person.seen.take_joints(SeenJoints(stamp, joints, spread))
        if k > 1:
            for c, view in views.items():
                person.see(SeenPoints(stamp, view.points[0], view.scores[0]), c, of_track=True)
        states += person.step(stamp, measured, period, statistics)[0]
    assign_people([person.tracker], Instant(stamp, views), rotations, translations, GATE)
    states += person.flush()
    _compare(person.subject, states[0], measured, rate_hz)
    return Solved(states[0], body, BodySource.TRACK, len(views), 1)


def _compare(subject: Subject, state: BodyState, measured: Measured, rate_hz: float) -> None:
    """Look for heading and clock of IMUs while nothing moves."""
    stamps = np.round(np.arange(round(COMPARED_S * rate_hz) + 10) * 1e9 / rate_hz).astype(np.int64)
    turns, forces = (np.repeat(part, len(stamps), axis=0) for part in measured[1:])
    states = [replace(state, stamp_ns=stamp) for stamp in stamps.tolist()]
    align(subject, states, {"example": Felt(stamps, turns, forces)})
