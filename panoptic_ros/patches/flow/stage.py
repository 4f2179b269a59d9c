"""The stage: images and their 2D people in, 2D tracks on these people out."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from panoptic_ros.domain import PatchTracks, ViewDetections, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.patches.flow.config import FlowConfig
from panoptic_ros.patches.flow.samples import Pattern
from panoptic_ros.patches.flow.sharing import Sharing
from panoptic_ros.patches.flow.tracking import followed, ready
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Stateful, StateLayout

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Seen:
    """The newest image of a camera, and the points on its people once these are known.

    Args:
        grey: (h, w) uint8. scale: px of the image per px of it. begins: (N, 2) px of it.
    """

    stamp_ns: int
    frame_number: int
    grey: Array
    scale: float
    begins: Array | None = None
    persons: Array | None = None
    parts: Array | None = None


class FlowStage(Stateful):
    """Follows points on people from each image of a camera to the next, each camera on its own."""

    LAYOUT = StateLayout("flow", ("_seen",), (Seen,), same={"configuration": "_config", "skeleton": "_hash"})

    def __init__(self, config: FlowConfig, context: StageContext):
        self._config, self._hash = config, context.skeleton.hash
        self._pattern = Pattern(context.skeleton)
        self._sharing = Sharing(context.rig, config.views)
        self._seen: dict[str, Seen] = {}
        ready()

    def reset(self) -> None:
        """Forget all images."""
        self._seen.clear()

    def flush(self) -> StepResult[PatchTracks]:
        """Nothing is buffered."""
        self.reset()
        return StepResult()

    def step(self, item: ViewFrame | ViewDetections) -> StepResult[PatchTracks]:
        """The tracks from the image before to this one; 2D people say what to follow to the next one.

        Raises:
            DataError: if 2D people are of another skeleton.
        """
        if isinstance(item, ViewDetections):
            self._take_people(item)
            return StepResult()
        before, now = self._seen.get(item.camera), self._made_small(item)
        if before is not None and item.stamp_ns <= before.stamp_ns:
            text = f"camera {item.camera}: image {item.frame_number} is not newer than the one before"
            return StepResult(notices=(Notice("flow.old_stamp", "warning", text),))
        self._seen[item.camera] = now
        if before is None or before.begins is None or before.grey.shape != now.grey.shape:
            return StepResult()
        if 1e-9 * (now.stamp_ns - before.stamp_ns) > self._config.longest_gap:
            return StepResult()
        return StepResult((self._tracks(item, before, now),))

    def _made_small(self, item: ViewFrame) -> Seen:
        image = item.image
        shrink = max(1.0, image.shape[1] / self._config.width)
        if shrink > 1.0:
            size = (round(image.shape[1] / shrink), max(1, round(image.shape[0] / shrink)))
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        return Seen(item.stamp_ns, item.frame_number, grey, item.image.shape[1] / grey.shape[1])

    def _take_people(self, item: ViewDetections) -> None:
        if item.skeleton_hash != self._hash:
            raise DataError(f"2D people of skeleton {item.skeleton_hash}, but flow works on {self._hash}")
        seen = self._seen.get(item.camera)
        if seen is None or seen.frame_number != item.frame_number or seen.stamp_ns != item.stamp_ns:
            return
        laid = self._pattern.lay(item.points, item.scores > 0.0)
        shares = self._sharing.shares(item.camera, laid.middles, laid.scales)
        kept = self._sharing.followed(item.camera, laid.persons, shares)
        begins = (laid.points[kept] + 0.5) / seen.scale - 0.5
        self._seen[item.camera] = Seen(
            seen.stamp_ns,
            seen.frame_number,
            seen.grey,
            seen.scale,
            begins,
            laid.persons[kept],
            laid.parts[kept],
        )

    def _tracks(self, item: ViewFrame, before: Seen, now: Seen) -> PatchTracks:
        assert before.begins is not None and before.persons is not None and before.parts is not None
        ends, information, kept = followed(before.grey, now.grey, before.begins, before.begins)
        begins, scale = before.begins[kept], before.scale
        return PatchTracks(
            item.camera,
            item.stamp_ns,
            item.frame_number,
            before.stamp_ns,
            before.frame_number,
            self._hash,
            (begins + 0.5) * scale - 0.5,
            (ends + 0.5) * scale - 0.5,
            information / scale**2,
            before.persons[kept],
            before.parts[kept],
        )
