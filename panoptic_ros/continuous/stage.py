"""Continuous stage: people at instants of a fixed rate, from views that are taken one by one."""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
from math import ceil

from panoptic_ros.continuous.bones import LearntLengths, PairDistances
from panoptic_ros.continuous.config import ContinuousStageConfig
from panoptic_ros.continuous.example import follow_example
from panoptic_ros.continuous.follow import Entry, ViewTrack
from panoptic_ros.continuous.motion import JointFilters
from panoptic_ros.continuous.online import BEFORE_S, LEARNING_S, OnlineMotion, OnlinePerson
from panoptic_ros.continuous.periods import CameraPeriods
from panoptic_ros.continuous.problem import LearntNoise
from panoptic_ros.continuous.reports import ABSENT_S, pose_set
from panoptic_ros.continuous.returns import SeenPerson
from panoptic_ros.continuous.seen_views import SeenViews
from panoptic_ros.continuous.view_order import TimedFrame, ViewOrder
from panoptic_ros.domain import (
    ClockModel,
    DetectionSet,
    RefinedPoseSet,
    StampLine,
    SubjectSet,
    ViewDetections,
)
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.errors import ConfigError, DataError
from panoptic_ros.identity.subjects import PublicIds
from panoptic_ros.solving.example import easy_instants
from panoptic_ros.solving.frames import CameraFrame, camera_frames
from panoptic_ros.stage import InstantRange, Notice, StageContext, StepResult
from panoptic_ros.stamps.correction import CameraClock, StampCorrection
from panoptic_ros.stamps.rates import exact_rate
from panoptic_ros.state import Fields, Stateful, StateLayout

SECOND = 1_000_000_000
LATE_NS = 50_000_000  # ns of delay per instant that is skipped after each computed one
FEW = 5  # number of views of a camera that are left out before it is reported
FAULTS = {
    "back": "repeat, or stamps run backwards",
    "late": "come after instants that needed them: their stamps are wrong, or continuous.wait_s is too short",
    "ahead": "have stamps far ahead of those of most cameras",
}


class ContinuousStage(Stateful):
    """Stage that converts views of single cameras to people at the instants k / rate on the master clock.

    An instant is given as soon as a view newer than the instant plus the lag has come. It depends only on the
    views up to the instant plus the lag, so the order of arrival does not matter. People whom no view has
    shown for half a second are left out, and so are people who are not among designated subjects.
    """

    LAYOUT = StateLayout(
        "continuous",
        (
            "_correction",
            "_order",
            "_next",
            "_index",
            "_reference_ns",
            "_newest_ns",
            "_settled",
            "_faults",
            "_found",
            *(
                f"_motion.{name}"
                for name in (
                    "_periods",
                    "_frames",
                    "_times",
                    "_number",
                    "_newest",
                    "_clock",
                    "_people",
                    "_lost",
                    "ids",
                    "_tracker.active",
                    "_tracker.pair_s",
                    "_tracker._free",
                    "_tracker._numbers",
                )
            ),
        ),
        (
            ClockModel,
            StampLine,
            ViewDetections,
            CameraFrame,
            TimedFrame,
            CameraClock,
            OnlinePerson,
            ViewTrack,
            JointFilters,
            Entry,
            SeenViews,
            SeenPerson,
            PublicIds,
            SubjectSet,
            LearntNoise,
            LearntLengths,
            PairDistances,
            Fields.named(
                StampCorrection, "_device _delays _clocks _cameras _most_held _heard _told _implausible"
            ),
            Fields.named(CameraPeriods, "_last _steps _periods"),
            Fields.named(
                ViewOrder,
                "_cameras _wait_ns _waiting _newest _accepted _steps _corrections _counts _others _silent "
                "_begin_ns _shift_ns taken_ns",
            ),
        ),
        same={"configuration": "_config", "cameras": "_rig.names", "skeleton": "_skeleton.hash"},
    )

    def __init__(self, config: ContinuousStageConfig, context: StageContext):
        if config.active and len(context.rig) < 2:
            raise ConfigError(
                f"continuous.active: {len(context.rig)} camera is not enough for 3D; give two or more"
            )
        self._config, self._rig, self._skeleton = config, context.rig, context.skeleton
        self._arrays = RigArrays.of(context.rig)
        self._lag_ns = round(config.lag * SECOND)
        self._rate = exact_rate(config.rate_hz)
        self._waited_ns = 0
        self._look: Callable[[], None] = _no_request
        self.reset()
        if config.active:
            camera_frames(easy_instants(context.rig, context.skeleton), self._arrays, context.skeleton)
            follow_example(context.skeleton)

    def reset(self) -> None:
        """Drop all views, people and clocks."""
        config = self._config
        self._correction = StampCorrection(
            {camera.name: camera.clock for camera in self._rig.cameras}, config.clocks, config.delays_ms
        )
        self._order = ViewOrder(self._rig.names, round(config.wait_s * SECOND))
        self._motion = OnlineMotion(self._arrays, self._skeleton, config)
        self._next: int | None = None  # number k of the next instant
        self._index = 0  # number of instants given so far
        self._reference_ns: int | None = None  # origin of the times of the motion
        self._newest_ns = 0  # time of the newest view that the motion has taken
        self._settled = True  # False: there may be work for `settle`
        self._faults: Counter[str] = Counter()  # views that were left out, by fault and camera
        self._found: list[tuple[int, int]] = []  # new and earlier ids of subjects that are not reported yet

    def forget(self) -> None:
        """Drop all views. People may return; ids, subjects and the index of instants continue."""
        motion, index, reference_ns = self._motion, self._index, self._reference_ns
        self.reset()
        self._motion.succeed(motion)
        self._index, self._reference_ns = index, reference_ns
        self._motion.ids.begun_ns = None

    def lasting_state(self) -> bytes:
        """Return what matters after a pause: ids, subjects, the index (see `stage.LastingStateStage`)."""
        resting = copy.copy(self)
        resting._motion = copy.copy(self._motion)
        resting._motion.ids = copy.copy(self._motion.ids)
        resting.forget()
        return Stateful.state(resting)

    def waited(self, ns: int) -> None:
        """Record the waiting time of the views, ns. Instants are left out if it is long."""
        self._waited_ns = ns

    def step(self, item: ViewDetections | ClockModel | SubjectSet) -> StepResult[RefinedPoseSet]:
        """Take a view or a clock model; return the people at all instants that are due.

        A `SubjectSet` replaces the designation of subjects. It gives no output.

        Raises:
            DataError: the skeleton differs, or the rig has no such camera.
        """
        if not self._config.active:
            return StepResult()
        notices: list[Notice] = []
        if isinstance(item, SubjectSet):
            self._motion.ids.designate(item)
            return StepResult()
        if isinstance(item, ClockModel):
            views, told = self._correction.clock(item)
        else:
            self._check(item)
            views, told = self._correction.view(replace(item, maps=None, limit=None))
        notices += own(told)
        self._put(views, item, notices)
        return StepResult(tuple(self._give(notices)), tuple(notices))

    def flush(self) -> StepResult[RefinedPoseSet]:
        """Return all instants up to the newest view, and reset the stage."""
        notices: list[Notice] = []
        for camera in self._rig.names if self._config.active else ():
            notices += own(self._correction.end(camera))
        outputs = self._give(notices, at_end=True)
        self.reset()
        return StepResult(tuple(outputs), tuple(notices))

    def settle(self) -> None:
        """Learn from the views that were taken (see `stage.IdleWorkStage`)."""
        if not self._settled:
            self._settled = True
            self._motion.settle()

    # ------------------------------------------------------------------ requested instants

    def instants(self) -> InstantRange:
        """Return the instants that may be requested: those about which views are kept."""
        known = self._order.known_ns
        if self._reference_ns is None or known is None:
            return InstantRange(0, -1)
        oldest = self._newest_ns - round((LEARNING_S - BEFORE_S) * SECOND)
        return InstantRange(max(oldest, self._reference_ns), max(known - 1, self._newest_ns))

    def has_all_of(self, stamp_ns: int) -> bool:
        """Return whether a view newer than an instant plus the lag has come; take the views up to there."""
        known = self._order.known_ns
        if known is None:
            return False
        complete = known > stamp_ns + self._lag_ns
        self._take(stamp_ns + self._lag_ns if complete else known - 1)
        return complete

    def at(self, stamp_ns: int) -> RefinedPoseSet:
        """Return the people at an instant (ns) in `instants`, from the views that were taken."""
        return self._people_at(0, stamp_ns)

    def before_output(self, look: Callable[[], None]) -> None:
        """Call a function in each step before people at due instants are computed (see `RequestStage`)."""
        self._look = look

    # ------------------------------------------------------------------ views

    def _check(self, view: ViewDetections) -> None:
        if view.camera not in self._arrays.index:
            raise DataError(
                f"a view of camera {view.camera!r}, which the rig lacks; it has {', '.join(self._rig.names)}"
            )
        if view.skeleton_hash != self._skeleton.hash:
            raise DataError(
                f"camera {view.camera} sends skeleton {view.skeleton_hash}, expected {self._skeleton.hash}"
            )

    def _put(
        self, views: Iterable[ViewDetections], item: ViewDetections | ClockModel, notices: list[Notice]
    ) -> None:
        """Let corrected views wait for their turn.

        Args:
            item: the record that led to them. If it is one of them, it has the uncorrected timestamp.
        """
        for view in views:
            stamp = view.stamp_ns
            if isinstance(item, ViewDetections) and item.frame_number == view.frame_number:
                stamp = item.stamp_ns
            single = DetectionSet(0, view.stamp_ns, view.skeleton_hash, (view,))
            for frame in camera_frames([single], self._arrays, self._skeleton):
                time_ns = view.stamp_ns + round(self._motion.middle_delay(frame.camera) * SECOND)
                fault = self._order.put(TimedFrame(time_ns, frame.camera, frame), time_ns - stamp)
                if fault:
                    self._faults[f"{fault} {view.camera}"] += 1
                    notices += self._left_out(fault, view.camera)

    def _left_out(self, fault: str, camera: str) -> list[Notice]:
        """Return a notice about a view of a camera that is left out, if there were a few before."""
        if self._faults[f"{fault} {camera}"] < FEW:
            return []
        text = f"views of camera {camera} {FAULTS[fault]}; they are left out"
        values = {"camera": camera, "device": camera, "left_out": 1}
        return [Notice(f"continuous.{fault}_views", "warning", text, values)]

    def _take(self, until_ns: int) -> None:
        """Give the motion all views up to a time."""
        for view in self._order.take(until_ns):
            if self._reference_ns is None:
                self._reference_ns = view.time_ns
            self.settle()
            self._motion.take(view.frame, 1e-9 * (view.time_ns - self._reference_ns))
            self._found += self._motion.find_subjects(view.time_ns)
            self._newest_ns = view.time_ns
            self._settled = False

    # ------------------------------------------------------------------ instants

    def _stamp_of(self, k: int) -> int:
        return round(k * SECOND / self._rate)

    def _first_from(self, time_ns: int) -> int:
        """Return the number of the first instant that is not before a time."""
        return ceil(time_ns * self._rate / SECOND)

    def _give(self, notices: list[Notice], at_end: bool = False) -> list[RefinedPoseSet]:
        """Return the people at the instants that are due.

        Args:
            at_end: no view follows, so all instants up to the newest view are due.
        """
        outputs: list[RefinedPoseSet] = []
        left_out, looked = 0, at_end
        known = (self._order.last_ns or self._newest_ns) if at_end else self._order.known_ns
        while known is not None:
            first = self._order.next_ns
            if self._next is None and first is None:
                break
            if self._next is None or (
                first is not None and self._stamp_of(self._next) > self._newest_ns + ABSENT_S * SECOND
            ):  # no person is reported before the next view
                assert first is not None
                self._next = max(self._next or 0, self._first_from(first))
            stamp = self._stamp_of(self._next)
            if stamp > known if at_end else stamp + self._lag_ns >= known:
                break
            self._take(stamp + self._lag_ns)
            following = self._order.next_ns
            if not looked and (following is None or following >= known):  # requests take no more views
                looked = True
                self._look()
            if self._next % (1 + self._waited_ns // LATE_NS) == 0:
                outputs.append(self._people_at(self._index, stamp))
                self._index += 1
            else:
                left_out += 1
            self._next += 1
        notices += [late(left_out, self._waited_ns)] if left_out else []
        notices += [designated(*ids) for ids in self._found]
        self._found.clear()
        return outputs

    def _people_at(self, index: int, stamp_ns: int) -> RefinedPoseSet:
        people = []
        if self._reference_ns is not None:
            found = self._motion.at(1e-9 * (stamp_ns - self._reference_ns))
            people = [(person.id, person.report) for person in found]
        newest = self._newest_ns or -1
        return pose_set(index, stamp_ns, self._skeleton.hash, len(self._skeleton), people, newest)


def _no_request() -> None:
    """Stand for the answers to requests while there is no service."""


def own(notices: Iterable[Notice]) -> list[Notice]:
    """Return notices about timestamps as those of this stage."""
    return [replace(notice, code=f"continuous.{notice.code.partition('.')[2]}") for notice in notices]


def designated(number: int, before: int) -> Notice:
    """Return the notice of a subject that was found.

    Args:
        number: id of the subject.
        before: earlier id of the person.
    """
    text = f"subject {number} is the person who was {before} on /skeletons_at"
    return Notice("continuous.designated", "info", text, {"id": number, "before": before})


def late(left_out: int, waited_ns: int) -> Notice:
    """Return the notice of instants that are left out, because views have waited for too long."""
    text = (
        f"{left_out} instants of /skeletons_at were left out, as views had waited for "
        f"{1e-6 * waited_ns:.0f} ms: this machine is too slow, or others use it; give a lower `rate_hz`"
    )
    return Notice("continuous.late", "warning", text, {"left_out": left_out})
