"""The sync stage."""
from __future__ import annotations

from collections import deque
from dataclasses import replace

from panoptic_ros.domain import ClockModel, DetectionSet, EndOfStream, ViewDetections
from panoptic_ros.errors import DataError
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.sync.config import SyncConfig


class SyncStage:
    """Groups views by their stamps.

    A set is given when every camera of the rig has a frame waiting, inside of the window or beyond
    it (or has ended), or when a frame newer than the deadline has come. So with `deadline_s` = 0 the
    sets depend on the stamps alone.
    """

    def __init__(self, config: SyncConfig, context: StageContext):
        self._window_ns = round(config.window_s * 1e9)
        self._deadline_ns = round(config.deadline_s * 1e9)
        self._config = config
        self._rig = context.rig
        self._skeleton_hash = context.skeleton.hash
        self.reset()

    def reset(self) -> None:
        """Forget all frames; the next set has index 0."""
        self._waiting: dict[str, deque[ViewDetections]] = {name: deque() for name in self._rig.names}
        self._last: dict[str, int] = {}
        self._ended: set[str] = set()
        self._newest = -1
        self._closed_until = -1  # no frame up to here may start a set any more
        self._index = 0
        self._models: dict[str, ClockModel] = {}

    def step(self, item: ViewDetections | EndOfStream | ClockModel) -> StepResult[DetectionSet]:
        """Take the view of one camera, the news that no more will come from it, or its clock model.

        The stamps of views that come after a model of their camera are moved by it to the master time line.

        Raises:
            DataError: if the rig lacks the camera or the skeleton is another.
        """
        if isinstance(item, ClockModel):
            if item.device in self._waiting:
                self._models[item.device] = item
            return StepResult()
        if item.camera not in self._waiting:
            raise DataError(
                f"a view of camera {item.camera!r}, which the rig lacks; it has "
                f"{', '.join(self._rig.names)}"
            )
        notices: list[Notice] = []
        if isinstance(item, EndOfStream):
            self._ended.add(item.camera)
        else:
            self._take(item, notices)
        return self._give(notices, final=False)

    def flush(self) -> StepResult[DetectionSet]:
        """Give all sets that still wait."""
        result = self._give([], final=True)
        self.reset()
        return result

    def _take(self, view: ViewDetections, notices: list[Notice]) -> None:
        if view.skeleton_hash != self._skeleton_hash:
            raise DataError(
                f"camera {view.camera} sends skeleton {view.skeleton_hash}, expected {self._skeleton_hash}"
            )
        model = self._models.get(view.camera)
        if model is not None:
            view = replace(view, stamp_ns=model.master_from_device(view.stamp_ns)[0])
        if view.stamp_ns <= self._last.get(view.camera, -1):
            notices.append(_notice("sync.stamp_back", view, "its stamp is not later than the one before"))
            return
        self._last[view.camera] = view.stamp_ns
        self._newest = max(self._newest, view.stamp_ns)
        self._ended.discard(view.camera)
        if view.stamp_ns <= self._closed_until:
            notices.append(_notice("sync.late_frame", view, "its set has been given already"))
            return
        queue = self._waiting[view.camera]
        queue.append(view)
        if len(queue) > self._config.queue_limit:
            notices.append(_notice("sync.queue_full", queue.popleft(), "too many frames wait"))

    def _give(self, notices: list[Notice], final: bool) -> StepResult[DetectionSet]:
        sets = []
        while True:
            heads = [queue[0].stamp_ns for queue in self._waiting.values() if queue]
            if not heads:
                break
            opened = min(heads)
            closes = opened + self._window_ns
            complete = all(q or name in self._ended for name, q in self._waiting.items())
            overdue = 0 < self._deadline_ns < self._newest - opened
            if not (complete or overdue or final):
                break
            views = self._collect(closes, notices)
            self._closed_until = closes
            if len(views) < self._config.minimum_views:
                notices.append(_notice("sync.few_views", views[0], f"{len(views)} views only"))
                continue
            stamps = sorted(view.stamp_ns for view in views)
            stamp = stamps[(len(stamps) - 1) // 2]
            sets.append(DetectionSet(self._index, stamp, self._skeleton_hash, tuple(views)))
            self._index += 1
        return StepResult(tuple(sets), tuple(notices))

    def _collect(self, closes: int, notices: list[Notice]) -> list[ViewDetections]:
        """The first frame of every camera up to `closes`; further ones inside are surplus."""
        views = []
        for queue in self._waiting.values():
            inside = []
            while queue and queue[0].stamp_ns <= closes:
                inside.append(queue.popleft())
            views += inside[:1]
            notices += [_notice("sync.surplus_frame", v, "a second frame in one set") for v in inside[1:]]
        return views


def _notice(code: str, view: ViewDetections, why: str) -> Notice:
    text = f"frame {view.frame_number} of camera {view.camera} at {view.stamp_ns} ns was dropped: {why}"
    return Notice(code, "warning", text, {"camera": view.camera, "stamp_ns": view.stamp_ns})
