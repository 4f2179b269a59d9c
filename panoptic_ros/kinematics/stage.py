"""The kinematics stage: bodies at a fixed rate, from 2D poses or skeletons and from samples of IMUs.

`step_examples` solves a few instants of an artificial person, so that all kernels are compiled at
construction.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from panoptic_ros.domain import DetectionSet, TrackedPoseSet, ViewDetections
from panoptic_ros.domain.bodies import BodySource, BodyStateSet, ImuSample
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState, Device, InstantViews, Subject, ViewPeople
from panoptic_ros.errors import DataError
from panoptic_ros.geometry.chain import Pose, place_all
from panoptic_ros.geometry.rotations import from_quaternions
from panoptic_ros.kinematics.body.measured_body import MeasuredBody
from panoptic_ros.kinematics.body_records import SolvedBody, body_set
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.alignment import DeviceSignals, align
from panoptic_ros.kinematics.imus.measured import ImuMeasurements
from panoptic_ros.kinematics.imus.streams import DeviceAssignment, ImuStreams
from panoptic_ros.kinematics.people.allotment import InstantObservations, PoseAssignment, ViewObservations
from panoptic_ros.kinematics.people.nearest_people import assign_people
from panoptic_ros.kinematics.people.person import PersonState, SolveSources
from panoptic_ros.kinematics.people.seen_people import JointPositions, ViewJoints, joints_as_seen
from panoptic_ros.kinematics.pose.prior import PoseStatistics
from panoptic_ros.kinematics.remembered import CLASSES
from panoptic_ros.kinematics.timeline import InstantSchedule, InstantSelection, LagBuffer
from panoptic_ros.solving.calibration_errors import CalibrationErrors
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Stateful, StateLayout

ODD = "kinematics.odd_stamp"
IN_SPACE = -1  # index of the source of skeletons without 2D poses
NEVER_S = 10.0  # time after which a missing subject is reported
Out = BodyStateSet
STATURE = 1.7
GATE = 0.5  # m
COMPARED_S = 0.5  # duration of the data that are compared with IMUs: longer than a compared rotation
SECONDS = 0.3  # longer than the lag, so that poses are smoothed and lengths and mountings are observed


def step_examples(
    new_person: Callable[[Subject], PersonState],
    model: SegmentModel,
    statistics: PoseStatistics,
    joint_names: tuple[str, ...],
    rate_hz: float,
) -> SolvedBody:
    """Return the first body of a person with an IMU, solved from 3D joints and from views."""
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
    of_record = spread.copy()
    of_record.flags.writeable = False  # kernels are compiled for both
    level = from_quaternions(np.array([1.0, 0.0, 0.0, 0.0]))
    measured = ImuMeasurements(np.ones(1, bool), level[None], np.array([[0.0, 0.0, 9.81]]))
    period = round(1e9 / rate_hz)
    rotations, translations = person.weighing.rotations, person.weighing.translations
    seen = joints @ rotations.swapaxes(1, 2) + translations[:, None]
    scores = np.isfinite(joints[:, 0]).astype(float)[None]
    views = {c: ViewPeople((local[:, :2] / local[:, 2:])[None], scores) for c, local in enumerate(seen)}
    states: list[BodyState] = []
    for k in range(round(SECONDS * rate_hz)):
        stamp = k * period
        if k <= 1:
            person.seen.take_joints(JointPositions(stamp, joints, (spread, of_record)[k]))
        if k > 1:
            for c, view in views.items():
                person.see(ViewJoints(stamp, view.points[0], view.scores[0]), c, of_track=True)
        states += person.step(stamp, measured, period, statistics)[0]
    assign_people([person.tracker], InstantViews(stamp, views), rotations, translations, GATE)
    states += person.flush()
    _compare(person.subject, states[0], measured, rate_hz)
    return SolvedBody(states[0], body, BodySource.TRACK, len(views), 1)


def _compare(subject: Subject, state: BodyState, measured: ImuMeasurements, rate_hz: float) -> None:
    """Estimate heading and clock of IMUs from data without motion."""
    stamps = np.round(np.arange(round(COMPARED_S * rate_hz) + 10) * 1e9 / rate_hz).astype(np.int64)
    turns, forces = (np.repeat(part, len(stamps), axis=0) for part in measured[1:])
    states = [replace(state, stamp_ns=stamp) for stamp in stamps.tolist()]
    align(subject, states, {"example": DeviceSignals(stamps, turns, forces)})


def unworn(device: str) -> Notice:
    """Return the notice of samples from a device that no person wears."""
    text = f"{device} is on no subject; it is left out"
    return Notice("kinematics.imu_unknown", "warning", text, {"device": device})


def odd_stamp(stamp_ns: int, name: str, warns: bool) -> Notice:
    """Return the notice of a timestamp that is far from those of the others."""
    text = f"the stamp {stamp_ns} of {name} is more than 2 s off the others; it is left out"
    return Notice(ODD, "warning" if warns else "info", text, {"device": name})


def jump(stamp_ns: int, name: str) -> Notice:
    """Return the notice of timestamps that continue elsewhere."""
    text = f"stamps of {name} and others continue from {stamp_ns}; bodies start again"
    return Notice("kinematics.jump", "warning", text)


def late(left_out: int, waited_ns: int) -> Notice:
    """Return the notice of skipped instants, whose data had waited for too long."""
    text = (
        f"{left_out} instants were left out, as data had waited for {1e-6 * waited_ns:.0f} ms: this machine "
        "is too slow, or others use it; give fewer subjects or a lower `rate_hz`"
    )
    return Notice("kinematics.late", "warning", text, {"left_out": left_out})


def never_came(number: int, seconds: float) -> Notice:
    """Return the notice of a subject that was not seen for `seconds`, s."""
    text = (
        f"subject {number} was not found in {seconds:g} s: no camera has seen it and no mounted IMU "
        "measures it; check `start`, `id` and the devices of its file"
    )
    return Notice("kinematics.never_came", "warning", text, {"device": f"subject {number}"})


class KinematicsStage(Stateful):
    """Bodies of designated people at a fixed rate.

    The output is delayed by the lag and at most one period of the slowest camera. The method is that of
    Malleson et al. 2020, sections 3 and 4, with the additions in docs/bodies.md.

    The extras of the context hold `subjects`, the designated people; `segments`, the `SegmentModel` of their
    bodies; and `pose_prior`, `PoseStatistics`. A tracked person with the id of a subject is this subject. 2D
    poses come from the views that a track holds. Without a track, they are those nearest to the expected
    body. Without 2D poses, the joints of skeletons are used.
    """

    LAYOUT = StateLayout(
        "kinematics",
        "_people _measured _timeline _pace _streams _waiting _given _last_set _tracks_come _told".split(),
        (*CLASSES, ViewObservations, InstantObservations),
        shared=("_config", "_model", "_parents", "_mean"),
        same={"configuration": "_config", "skeleton": "_hash", "cameras": "_rig.names"},
    )

    def __init__(self, config: KinematicsConfig, context: StageContext):
        self._config, self._skeleton, self._rig = config, context.skeleton, context.rig
        self._calibration = CalibrationErrors.of(context.rig.cameras)
        self._hash, self._joint_names = context.skeleton.hash, context.skeleton.joint_names
        self._subjects: tuple[Subject, ...] = tuple(context.extras.get("subjects", ()))
        self._wearers = DeviceAssignment(self._subjects)
        self._model: SegmentModel | None = context.extras.get("segments")
        self._statistics: PoseStatistics | None = context.extras.get("pose_prior")
        self._parents = None if self._model is None else self._model.parents
        self._mean = None if self._statistics is None else self._statistics.mean
        self._allotment = PoseAssignment(context.rig, config.gate)
        self._lag = round(config.lag * config.rate_hz) if config.window else 0
        self.reset()
        if self._model is not None and self._statistics is not None:
            known = self._model, self._statistics, self._joint_names
            example = step_examples(self._new_person, *known, config.rate_hz)
            body_set(0, 0, 0, self._model, self._skeleton, [example])

    def reset(self) -> None:
        """Discard all people and data."""
        self._people: dict[int, PersonState] = {}
        for subject in self._subjects:
            self._people[subject.id] = self._new_person(subject)
        self._measured: dict[int, MeasuredBody] = {}  # people without a subject file, by id
        self._timeline, self._pace = (
            InstantSchedule(self._config.rate_hz),
            InstantSelection(self._config.rate_hz),
        )
        self._streams = ImuStreams(self._wearers.devices)
        self._waiting: InstantObservations | None = None
        self._given = LagBuffer()
        self._last_set = -1  # index of the last detection set
        self._tracks_come = False
        self._told: set[str] = set()

    def flush(self) -> StepResult[Out]:
        """Return all instants up to the newest sample, including those within the lag."""
        self.waited(0)
        notices = self._take_waiting(None)
        outputs = self._run(notices, at_end=True)
        for person in self._people.values():
            self._given.keep(person.flush())
        outputs += [self._give() for _ in range(len(self._given))]
        self.reset()
        return StepResult(tuple(outputs), tuple(notices))

    def step(self, item: DetectionSet | TrackedPoseSet | ImuSample) -> StepResult[Out]:
        """Add a record, and return the bodies of the instants whose data are complete.

        Raises:
            DataError: If people are of another skeleton, or a camera is not in the rig.
        """
        if not self._people and not self._config.everybody:
            return StepResult()
        if isinstance(item, ImuSample):
            notices = self._take_sample(item)
        elif isinstance(item, DetectionSet):
            notices = self._take_views(item)
        else:
            notices = self._take_tracked(item)
        return StepResult(tuple(self._run(notices)), tuple(notices))

    def waited(self, ns: int) -> None:
        """Record the waiting time of the data, ns: see `stage.LatenessAwareStage` and `InstantSelection`."""
        self._pace.waited_ns = ns

    def lasting_state(self) -> bytes:
        """Return the state that counts after a pause, see `stage.LastingStateStage`.

        It lacks the windows of the bodies, which are nearly all of the full state.
        """
        resting = copy.copy(self)
        resting._people = {number: person.at_rest() for number, person in self._people.items()}
        resting._given = LagBuffer()
        return Stateful.state(resting)

    # ------------------------------------------------------------------ inputs

    def _take_sample(self, item: ImuSample) -> list[Notice]:
        wearer = self._wearers.of(item.device)
        if wearer is None:
            return self._once(unworn(item.device))
        notices = self._came(item.device, item.stamp_ns + self._people[wearer].fitting.offset_ns)
        if not any(notice.code == ODD for notice in notices):
            notices += self._streams.take(item)
        return notices

    def _take_views(self, item: DetectionSet) -> list[Notice]:
        self._check(item.skeleton_hash)
        notices = self._take_waiting(None)
        if item.index <= self._last_set:
            # The recording restarted. Old samples are then recognised by their timestamps, not by the index.
            self._last_set = item.index
        self._waiting = InstantObservations(item.index, tuple(self._observations(v) for v in item.views))
        if not self._tracks_come and len(self._allotment.cameras) < 2:
            notices += self._take_waiting(None)
        return notices

    def _observations(self, view: ViewDetections) -> ViewObservations:
        number = self._allotment.camera(view.camera)
        stamp = view.stamp_ns + round(1e9 * self._rig.cameras[number].middle_s)
        return ViewObservations(number, stamp, view.frame_number, view.points, view.scores)

    def _take_tracked(self, item: TrackedPoseSet) -> list[Notice]:
        self._check(item.skeleton_hash)
        self._tracks_come = True
        if self._config.everybody:
            self._measure(item)
        waiting = self._waiting
        if (
            waiting is not None
            and waiting.number == item.index
            and (item.sources is not None or not len(item.ids))
        ):
            return self._take_waiting(item)
        notices = self._take_waiting(None)
        if waiting is None or waiting.number < item.index:
            # beside views, skeletons are not a source of their own for which instants would wait
            notices += [] if self._timeline.has_cameras() else self._came(IN_SPACE, item.stamp_ns)
            self._take_joints(item)
        return notices

    def _take_joints(self, item: TrackedPoseSet) -> None:
        """Give tracked people their 3D joints.

        If there are 2D poses too, only joints that several views measured are used.
        """
        assert self._model is not None
        positions = joints_as_seen(item, self._model, item.sources is not None)
        for k, number in enumerate(item.ids.tolist()):
            if number in self._people:
                joints = JointPositions(item.stamp_ns, positions[k], item.covariances[k])
                self._people[number].seen.take_joints(joints)

    def _take_waiting(self, item: TrackedPoseSet | None) -> list[Notice]:
        """Process the waiting views with the people who are tracked in these views; return notices."""
        waiting, self._waiting = self._waiting, None
        if waiting is None:
            return []
        self._last_set = waiting.number
        notices: list[Notice] = []
        usable = []
        for view in waiting.views:
            told = self._came(view.camera, view.stamp_ns)
            notices += told
            if not any(notice.code == ODD for notice in told):
                usable.append(view)
        taken, tracked = set(), set()
        if item is not None:
            taken, tracked = self._allotment.by_tracks(self._people, usable, item), set(item.ids.tolist())
            if item.sources is not None:
                self._take_joints(item)
        # a single camera tracks no people
        tracks_begin = self._tracks_come and len(self._allotment.cameras) > 1
        self._allotment.by_places(self._people, usable, taken, tracked, tracks_begin)
        return notices

    def _came(self, source: int | str, stamp_ns: int) -> list[Notice]:
        """Record a sample. Return a notice if its timestamp is wrong or timestamps restart."""
        verdict = self._timeline.came(source, stamp_ns)
        if not verdict:
            return []
        name = source if isinstance(source, str) else (*self._allotment.cameras, "skeletons")[source]
        if verdict in ("odd", "early"):
            return [odd_stamp(stamp_ns, name, verdict == "odd")]
        for person in self._people.values():
            person.restart()
        return [jump(stamp_ns, name)]

    def _measure(self, item: TrackedPoseSet) -> None:
        """Update bodies of people without a subject file, with lengths from their skeletons."""
        assert self._model is not None and self._statistics is not None
        positions = joints_as_seen(item, self._model)
        for k, number in enumerate(item.ids.tolist()):
            if self._is_designated(number):
                continue
            measured = self._measured.setdefault(number, MeasuredBody())
            known = self._config, self._model, self._statistics, self._joint_names
            body = measured.take(*known, (positions[k], item.covariances[k]))
            if body is not None and number in self._people:
                self._people[number].take_body(body)
            elif body is not None:
                self._people[number] = self._new_person(Subject(number, body))

    # ------------------------------------------------------------------ instants

    def _run(self, notices: list[Notice], at_end: bool = False) -> list[Out]:
        outputs = []
        while (stamp := self._timeline.due(at_end)) is not None:
            stride = self._pace.step()
            if not stride:
                self._leave_out(stamp)
                continue
            notices += self._solve(stamp, stride)
            while self._given.is_due(self._timeline.index - self._lag):
                outputs.append(self._give())
        return outputs

    def _measured_at(self, stamp_ns: int) -> dict[int, ImuMeasurements]:
        """Return the measurements of each person's devices at an instant, by id."""
        offsets = {number: person.fitting.offset_ns for number, person in self._people.items()}
        return self._wearers.measured(self._streams, stamp_ns, offsets)

    def _leave_out(self, stamp_ns: int) -> None:
        """Skip an instant.

        Estimates of clock and heading still get its samples, because they need samples without gaps.
        """
        if any(person.fitting.looking for person in self._people.values()):
            for number, measured in self._measured_at(stamp_ns).items():
                self._people[number].feel(stamp_ns, measured)

    def _solve(self, stamp_ns: int, stride: int) -> list[Notice]:
        self._given.add(self._timeline.index, stamp_ns)
        assert self._statistics is not None
        notices = [late(stride - 1, self._pace.waited_ns)] if stride > 1 else []
        notices += self._streams.judge(stamp_ns, stride / self._config.rate_hz)
        measured = self._measured_at(stamp_ns)
        half = max(self._timeline.patience_ns // 2, round(5e8 / self._config.rate_hz))
        for number, person in list(self._people.items()):
            states, told = person.step(stamp_ns, measured[number], half, self._statistics, stride)
            notices += told
            self._given.keep(states)
            if not person.is_expected and person.missed and not self._is_designated(number):
                if not self._given.holds(number):
                    del self._people[number], self._measured[number]
            elif self._timeline.index > NEVER_S * self._config.rate_hz and not person.came:
                notices += self._once(never_came(number, NEVER_S))
        return notices

    def _give(self) -> BodyStateSet:
        """Return the record of the oldest instant that is held."""
        index, stamp_ns, states = self._given.take()
        rows = []
        for number, state in states.items():
            person = self._people[number]
            rows.append(SolvedBody(state, person.body, *person.behind.pop(stamp_ns, SolveSources(0, 0, 0))))
        assert self._model is not None
        known = self._model, self._skeleton, rows, self._calibration
        return body_set(index - 1, stamp_ns, self._timeline.newest_ns, *known)

    # ------------------------------------------------------------------ helpers

    def _new_person(self, subject: Subject) -> PersonState:
        """Return a new person with its own copy of the subject.

        States do not contain the objects that the constructor received.
        """
        assert self._statistics is not None
        subject = copy.deepcopy(subject, {id(self._model): self._model})
        return PersonState(self._config, subject, self._statistics, self._rig, self._joint_names)

    def _is_designated(self, number: int) -> bool:
        return any(subject.id == number for subject in self._subjects)

    def _check(self, skeleton_hash: str) -> None:
        if skeleton_hash != self._hash:
            own = f"{self._skeleton.name} ({self._hash})"
            raise DataError(f"people of skeleton {skeleton_hash}, but kinematics works on {own}")

    def _once(self, notice: Notice) -> list[Notice]:
        key = f"{notice.code} {notice.values['device']}"
        if key in self._told:
            return []
        self._told.add(key)
        return [notice]
