"""The stage: images and their 2D people in, the colours of what these wear out."""

from __future__ import annotations

import numpy as np

from panoptic_ros.appearance.colours import Pattern, colours_of
from panoptic_ros.appearance.config import AppearanceConfig
from panoptic_ros.domain import ViewAppearance, ViewDetections, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.stage import StageContext, StepResult
from panoptic_ros.state import Stateful, StateLayout


class AppearanceStage(Stateful):
    """Reads the colours of clothes off the newest image of each camera, once its people are known."""

    LAYOUT = StateLayout(
        "appearance", ("_images",), (ViewFrame,), same={"configuration": "_config", "skeleton": "_hash"}
    )

    def __init__(self, config: AppearanceConfig, context: StageContext):
        self._config, self._hash = config, context.skeleton.hash
        self._pattern = Pattern(context.skeleton)
        self._images: dict[str, ViewFrame] = {}

    def reset(self) -> None:
        """Forget all images."""
        self._images.clear()

    def flush(self) -> StepResult[ViewAppearance]:
        """Nothing is buffered."""
        self.reset()
        return StepResult()

    def step(self, item: ViewFrame | ViewDetections) -> StepResult[ViewAppearance]:
        """The colours of the people of the newest image; nothing where its people come after another image.

        Raises:
            DataError: if 2D people are of another skeleton.
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
