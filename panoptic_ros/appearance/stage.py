"""Appearance stage: images and their 2D poses in, colours of the clothes out."""

from __future__ import annotations

import numpy as np

from panoptic_ros.appearance.colours import ColourSamples, colours_of
from panoptic_ros.appearance.config import AppearanceConfig
from panoptic_ros.domain import ViewAppearance, ViewDetections, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.stage import StageContext, StepResult
from panoptic_ros.state import Stateful, StateLayout


class AppearanceStage(Stateful):
    """Stage that measures clothing colours in the newest image of each camera, when its detections arrive."""

    LAYOUT = StateLayout(
        "appearance", ("_images",), (ViewFrame,), same={"configuration": "_config", "skeleton": "_hash"}
    )

    def __init__(self, config: AppearanceConfig, context: StageContext):
        self._config, self._hash = config, context.skeleton.hash
        self._pattern = ColourSamples(context.skeleton)
        self._images: dict[str, ViewFrame] = {}

    def reset(self) -> None:
        """Forget all images."""
        self._images.clear()

    def flush(self) -> StepResult[ViewAppearance]:
        """Forget all images and return no records: nothing is buffered."""
        self.reset()
        return StepResult()

    def step(self, item: ViewFrame | ViewDetections) -> StepResult[ViewAppearance]:
        """Keep an image, or return the colours of the people whose detections have arrived.

        Nothing is returned if the detections do not belong to the newest image of their camera.

        Raises:
            DataError: if the 2D poses are of another skeleton model.
        """
        if isinstance(item, ViewFrame):
            self._images[item.camera] = item
            return StepResult()
        if item.skeleton_hash != self._hash:
            raise DataError(
                f"2D people of skeleton {item.skeleton_hash}, but appearance works on {self._hash}"
            )
        frame = self._images.get(item.camera)
        if frame is None or (frame.frame_number, frame.stamp_ns) != (item.frame_number, item.stamp_ns):
            return StepResult()
        del self._images[item.camera]
        if not len(item.points):
            return StepResult()
        points = np.where(item.scores[..., None] > 0.0, item.points, np.nan)
        colours = colours_of(frame.image, points, self._pattern, self._config.fewest)
        return StepResult((ViewAppearance(item.camera, item.stamp_ns, item.frame_number, colours),))
