"""Sync stage: group the views of all cameras into sets, and define the state to save."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from math import ceil

from panoptic_ros.domain import (
    ClockModel,
    DetectionSet,
    EndOfStream,
    ScoreMaps,
    StampLine,
    ViewDetections,
    VisibilityLimit,
)
from panoptic_ros.errors import ConfigError, DataError
from panoptic_ros.stage import Notice, Severity, StageContext, StepResult
from panoptic_ros.stamps.correction import HELD, LATEST_NS, CameraClock, StampCorrection
from panoptic_ros.state import Fields, Stateful, StateLayout
from panoptic_ros.sync.agreement import Agreement, PendingLine
from panoptic_ros.sync.config import SyncConfig
from panoptic_ros.sync.instants import CameraInstants, InstantGrid, Instants, PeriodEstimate, choose_master
from panoptic_ros.sync.jumps import GuardedCamera, SetBackGuard
from panoptic_ros.sync.liveness import LiveCamera, Liveness
from panoptic_ros.sync.majority import Majority, Vote
from panoptic_ros.sync.outliers import StampGate, StampOutliers
from panoptic_ros.sync.overlap import Overlap
from panoptic_ros.sync.queue import CameraQueue, QueuedFrame
from panoptic_ros.sync.resample import Neighbours, interpolate

SECOND = 1_000_000_000
FIRST_FRAMES = 4  # frames of every camera needed to estimate the frame rates
REACH = 0.6  # periods of the sets, maximum distance of a frame from its instant
START = 2  # live: deadlines to wait for the first frames of all cameras
EARLY = "most cameras begin much later"
USUAL_PERIOD = SECOND / 30  # ns, period used if a capture is too short to measure one
LAYOUT = StateLayout(
    "sync",
    (
        "_outliers",
        "_correction",
        "_agreement",
        "_overlap",
        "_guard",
        "_came",
        "_queues",
        "_in_order",
        "_current",
        "_decided",
        "_instants",
        "_next",
        "_closed",
        "_stamp",
        "_liveness",
        "_first",
        "_index",
    ),
    (
        ClockModel,
        ScoreMaps,
        StampLine,
        ViewDetections,
        VisibilityLimit,
        CameraClock,
        GuardedCamera,
        LiveCamera,
        PendingLine,
        StampGate,
        Vote,
        QueuedFrame,
        Fields.named(StampOutliers, "_cameras"),
        Fields.named(
            StampCorrection, "_device _delays _clocks _cameras _most_held _heard _told _implausible"
        ),
        Fields.named(Liveness, "_cameras now_ns _passed_ns"),
        Fields.named(Agreement, "_by_arrival _by_stamps _stamps _lines _start_ns _began"),
        Fields.named(Majority, "votes offset reach _periods _count"),
        Fields.named(Overlap, "_cameras _joined _apart _told started _begin"),
        Fields.named(SetBackGuard, "_cameras _shift"),
        Fields.named(CameraQueue, "frames pace ended silent last_given middle_ns _keeps_last"),
        Fields.named(PeriodEstimate, "_steps newest"),
        Fields.named(InstantGrid, "_rate _phase period"),
        Fields.named(CameraInstants, "master period _same_rate _phases _last"),
        Fields.named(Fraction, "_numerator _denominator", is_value=True),
    ),
    same={"configuration": "_config", "cameras": "_rig.names", "skeleton": "_skeleton_hash"},
)


class SyncStage(Stateful):
    """Stage that groups views by their times on the master time line.

    A set is complete once every camera of the rig is decided. A camera is decided if it has the frame nearest
    to the instant, or a later frame, or has ended. With `deadline_s` = 0, sets therefore depend on timestamps
    alone. Otherwise (live), sets do not wait for silent cameras, and for no camera after the deadline.
    """

    LAYOUT = LAYOUT

    def __init__(self, config: SyncConfig, context: StageContext):
        self._config = config
        self._rig = context.rig
        self._skeleton_hash = context.skeleton.hash
        self._window_ns = config.window_s * SECOND
        self._deadline_ns = round(config.deadline_s * SECOND)
        self._interpolates = config.resampling == "interpolate"
        if config.master != "auto" and config.master not in self._rig.names:
            raise ConfigError(
                f"sync.master = {config.master!r} is not a camera of the rig; it has "
                f"{', '.join(self._rig.names)}"
            )
        self.reset()

    def reset(self) -> None:
        """Drop all frames and clocks; the next set has index 0."""
        self._outliers = StampOutliers(self._rig.names)
        live, start_ns = self._deadline_ns > 0, START * self._deadline_ns
        self._correction = StampCorrection(
            {camera.name: camera.clock for camera in self._rig.cameras},
            self._config.clocks,
            self._config.delays_ms,
            HELD if live else max(HELD, self._config.queue_limit),
        )
        self._agreement: Agreement[ViewDetections] | None = None
        if live:
            self._agreement = Agreement(self._rig.names, start_ns)
        self._overlap = None if live else Overlap(self._rig.names)
        self._guard = SetBackGuard(self._rig.names)
        self._came: tuple[int | None, int | None] = None, None  # arrival of the next record, see `arrived`
        self._liveness = Liveness(self._rig.names) if self._deadline_ns else None
        middles = {camera.name: round(1e9 * camera.middle_s) for camera in self._rig.cameras}
        self._queues = {name: CameraQueue(self._interpolates, middles[name]) for name in self._rig.names}
        self._in_order = list(self._queues.values())
        self._current: int | None = None  # instant that waits for its frames
        self._decided = 0  # number of queues in `_in_order` with a decided choice for that instant
        self._instants: Instants | None = InstantGrid(self._config) if self._config.rate_hz > 0.0 else None
        self._next: int | None = None  # next instant
        self._closed: int | None = None  # newest instant whose set was published or dropped
        self._stamp = -1  # timestamp of the newest set
        self._first: int | None = None  # oldest timestamp among the first frames
        self._index = 0

    def arrived(self, came_ns: int, host_ns: int) -> None:
        """Set the arrival time of the records that follow (see `stage.ArrivalAwareStage`)."""
        self._came = came_ns, host_ns

    def step(self, item: ViewDetections | EndOfStream | ClockModel) -> StepResult[DetectionSet]:
        """Process a view of a camera, the end of a camera's stream, or a clock model.

        Raises:
            DataError: the rig has no such camera, or the skeleton differs.
        """
        notices: list[Notice] = []
        if isinstance(item, ClockModel):
            views, told = self._correction.clock(item)
            notices += told
            self._take(views, notices)
            return self._give(notices, final=False)
        if item.camera not in self._queues:
            raise DataError(
                f"a view of camera {item.camera!r}, which the rig lacks; it has {', '.join(self._rig.names)}"
            )
        if isinstance(item, EndOfStream):
            self._end(item.camera, notices)
        else:
            if item.skeleton_hash != self._skeleton_hash:
                raise DataError(
                    f"camera {item.camera} sends skeleton {item.skeleton_hash}, "
                    f"expected {self._skeleton_hash}"
                )
            views = [item]
            by_stamps = self._agreement is None or self._correction.corrects(item.camera)
            if by_stamps or item.stamp_ns >= LATEST_NS:
                views, outliers = self._outliers.take(item)
                notices += outliers
            self._correct(views, notices)
            if self._correction.holds(item.camera):
                self._hear(item.camera, notices)
        return self._give(notices, final=False)

    def flush(self) -> StepResult[DetectionSet]:
        """Return all remaining sets, and reset the stage."""
        notices: list[Notice] = []
        for camera in self._rig.names:
            self._end(camera, notices)
        result = self._give(notices, final=True)
        self.reset()
        return result

    def _end(self, camera: str, notices: list[Notice]) -> None:
        views, told = self._outliers.end(camera)
        notices += told
        self._correct(views, notices)
        notices += self._correction.end(camera)
        if self._agreement is not None:
            views, told = self._agreement.end(camera)
            notices += told
            self._enqueue([good for view in views for good in self._set_back(view, notices)], notices)
        self._queues[camera].ended = True

    def _correct(self, views: Iterable[ViewDetections], notices: list[Notice]) -> None:
        for view in views:
            corrected, told = self._correction.view(view)
            notices += told
            self._take(corrected, notices)

    def _take(self, views: Iterable[ViewDetections], notices: list[Notice]) -> None:
        for view in views:
            if self._agreement is None:
                self._enqueue(self._set_back(view, notices), notices)
                continue
            agreeing, told = self._agreement.take(view, *self._came)
            notices += told
            for each in agreeing:
                self._enqueue(self._set_back(each, notices), notices)

    def _set_back(self, view: ViewDetections, notices: list[Notice]) -> list[ViewDetections]:
        views, told = self._guard.take(view)
        notices += told
        return views

    def _enqueue(self, views: Iterable[ViewDetections], notices: list[Notice]) -> None:
        for view in views:
            queue = self._queues[view.camera]
            queue.ended = False
            if not queue.add(view):
                notices.append(_dropped("sync.stamp_back", view, "its stamp is not later than the last one"))
                continue
            if self._overlap is not None and self._overlap.is_early(view):
                queue.frames.pop()
                notices.append(_dropped("sync.out_of_time", view, EARLY, "info"))
                continue
            stamp = queue.frames[-1].stamp
            if self._liveness is not None:
                self._liveness.took(view.camera, stamp)
            if not self._is_overdue(stamp):
                self._hear(view.camera, notices)
            if self._is_late(stamp):
                queue.frames.pop()
                notices.append(_dropped("sync.late_frame", view, "its set has been given already"))
            elif len(queue.frames) > self._config.queue_limit:
                lost = queue.frames.popleft().view
                notices.append(_dropped("sync.queue_full", lost, "too many frames wait"))

    def _is_late(self, stamp_ns: int) -> bool:
        """Return whether a frame's set is already closed: the frame is too old for the next instant."""
        if self._closed is None or self._instants is None:
            return False
        return stamp_ns < self._instants.after(self._closed) - self._reach(self._instants)

    # ------------------------------------------------------------------ sets

    def _give(self, notices: list[Notice], final: bool) -> StepResult[DetectionSet]:
        sets: list[DetectionSet] = []
        while self._current is not None or any(queue.frames for queue in self._queues.values()):
            self._start_overlap(notices, final)
            instants = self._instants or self._begin(final)
            if instants is None:
                break
            self._find_silent(instants, notices)
            if self._current is None:
                self._current, self._decided = self._upcoming(instants, final), 0
            if self._current is None:
                break
            instant = self._current
            over = final or self._is_overdue(instant)
            if not self._all_decided(instants, instant, over):
                break
            if self._interpolates and not over and not self._bracketed(instant):
                break
            self._current = None
            self._close(instants, instant, over, sets, notices)
        return StepResult(tuple(sets), tuple(notices))

    def _all_decided(self, instants: Instants, instant: int, over: bool) -> bool:
        """Return whether every camera has its choice. A decided choice is final and not repeated."""
        reach, queues = self._reach(instants), self._in_order
        while self._decided < len(queues):
            queue = queues[self._decided]
            if not queue.choose(instant, reach, instants.period, over).decided:
                return False
            self._decided += 1
        return True

    def _start_overlap(self, notices: list[Notice], final: bool) -> None:
        """Recordings: find cameras that begin far from the others, once all first frames are known."""
        overlap, queues = self._overlap, self._queues
        if overlap is None or overlap.started:
            return
        if final or all(queue.frames or queue.ended for queue in queues.values()):
            notices += overlap.start({n: q.frames[0].stamp for n, q in queues.items() if q.frames})
            for queue in queues.values():
                while queue.frames and overlap.is_early(queue.frames[0].view):
                    notices.append(_dropped("sync.out_of_time", queue.frames.popleft().view, EARLY, "info"))

    def _begin(self, final: bool) -> Instants | None:
        """Return the instants, once the rates of all cameras are known."""
        queues = self._queues
        needed = min(FIRST_FRAMES, self._config.queue_limit)
        enough = all(len(q.frames) >= needed or q.ended for q in queues.values())
        oldest = min(q.frames[0].stamp for q in queues.values() if q.frames)
        if self._first is None:
            self._first = oldest
        if not (enough or self._is_overdue(self._first) or final):
            return None
        periods = {
            name: q.frames[FIRST_FRAMES - 1].period if len(q.frames) >= FIRST_FRAMES else q.pace.period
            for name, q in queues.items()
            if self._overlap is None or not self._overlap.is_apart(name)
        }
        master, period, same = choose_master(periods, self._config.master)
        period = period or (2.0 * self._window_ns if self._window_ns else USUAL_PERIOD)
        self._instants = CameraInstants(master, period, same)
        frames = queues[master].frames
        self._next = frames[0].stamp if frames else oldest
        beyond = self._next - oldest - self._reach(self._instants)
        self._next -= max(0, ceil(beyond / round(period))) * round(period)
        return self._instants

    def _upcoming(self, instants: Instants, final: bool) -> int | None:
        """Return the next instant that has frames; None while it is unknown."""
        heads = [queue.frames[0].stamp for queue in self._queues.values() if queue.frames]
        instant = instants.nearest(min(heads)) if self._next is None else self._next
        while instant + self._reach(instants) < min(heads):
            known = all(queue.frames or queue.gives_no_more for queue in self._queues.values())
            if not (known or self._is_overdue(instant) or final):
                return None
            instant = max(instants.after(instant), instants.nearest(min(heads)))
        if self._next is None and not (
            final or self._deadline_ns or all(q.frames or q.ended for q in self._queues.values())
        ):
            return None
        return instant

    def _reach(self, instants: Instants) -> float:
        return self._window_ns or REACH * instants.period

    def _bracketed(self, instant: int) -> bool:
        """Return whether every camera has a frame at or after the instant, or has ended."""
        return all(
            q.gives_no_more or any(f.stamp >= instant for f in q.frames) for q in self._queues.values()
        )

    # ------------------------------------------------------------------ live

    def _is_overdue(self, instant: int) -> bool:
        """Return whether the deadline of an instant has passed, so that its set waits for no camera."""
        return self._liveness is not None and self._liveness.has_passed(instant, self._deadline_ns)

    def _hear(self, camera: str, notices: list[Notice]) -> None:
        """Record that a camera is alive: a frame was in time, or waits for its clock.

        Other frames do not prove that their camera is alive.
        """
        if self._liveness is not None:
            notices += self._liveness.heard(camera)
            self._queues[camera].silent = False

    def _find_silent(self, instants: Instants, notices: list[Notice]) -> None:
        """Find the cameras that sets no longer wait for."""
        if self._liveness is None:
            return
        told = self._liveness.find_silent(
            (name for name, queue in self._queues.items() if not queue.ended),
            instants.period,
            lambda name: self._queues[name].pace.period,
        )
        for notice in told:
            self._queues[str(notice.values["camera"])].silent = True
        notices += told

    # ------------------------------------------------------------------ views of a set

    def _close(
        self, instants: Instants, instant: int, over: bool, sets: list[DetectionSet], notices: list[Notice]
    ) -> None:
        """Remove the chosen frames from the queues and form a set of them."""
        reach = self._reach(instants)
        choices = {
            name: queue.choose(instant, reach, instants.period, over) for name, queue in self._queues.items()
        }
        chosen = {name: choice.frame for name, choice in choices.items() if choice.frame is not None}
        settled = instants.settle(instant, {name: frame.stamp for name, frame in chosen.items()})
        stamp = instants.stamp_of(settled, [frame.stamp for frame in chosen.values()])
        stamp = max(stamp, self._stamp + 1)
        views: list[ViewDetections] = []
        for name, choice in choices.items():
            queue = self._queues[name]
            for view in choice.surplus:
                why = "another frame of its camera is nearer to the set"
                notices.append(_dropped("sync.surplus_frame", view, why, "info"))
            if choice.frame is not None and self._interpolates:
                neighbours = Neighbours.of(queue, choice, self._rig.camera(name))
                views.append(interpolate(neighbours, stamp - queue.middle_ns))
            elif choice.frame is not None:
                views.append(choice.frame.view)
            queue.take(choice)
        if isinstance(instants, CameraInstants) and instants.master in chosen:
            instants.period = chosen[instants.master].period or instants.period
        self._closed, self._next = settled, instants.after(settled)
        if not views or not self._overlaps(views, notices):
            return
        if len(views) < self._config.minimum_views:
            notices.append(_dropped("sync.few_views", views[0], f"{len(views)} views only"))
            return
        self._stamp = stamp
        sets.append(DetectionSet(self._index, self._stamp, self._skeleton_hash, tuple(views)))
        self._index += 1

    def _overlaps(self, views: list[ViewDetections], notices: list[Notice]) -> bool:
        """Return whether a set may be published (see `Overlap`)."""
        if self._overlap is None:
            return True
        own = {view.camera for view in views}
        others = [queue for name, queue in self._queues.items() if name not in own]
        over = all(queue.ended and not queue.frames for queue in others)
        given, told = self._overlap.closes(views, over)
        notices += told
        if not given:
            why = "no frame of another camera is near it"
            notices += [_dropped("sync.out_of_time", view, why, "info") for view in views]
        return given


def _dropped(code: str, view: ViewDetections, why: str, severity: Severity = "warning") -> Notice:
    text = f"frame {view.frame_number} of camera {view.camera} at {view.stamp_ns} ns was dropped: {why}"
    return Notice(code, severity, text, {"camera": view.camera, "stamp_ns": view.stamp_ns})
