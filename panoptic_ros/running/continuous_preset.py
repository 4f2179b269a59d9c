"""Turns 2D poses, and images if there are any, into motion by the method of a paper."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

from panoptic_ros.capture.folder import CaptureFolder, open_capture_folder
from panoptic_ros.continuous.elhayek.config import ElhayekConfig
from panoptic_ros.continuous.elhayek.passes import ElhayekPass
from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.errors import UsageError
from panoptic_ros.io.body_models import read_body_model, read_body_shape
from panoptic_ros.running.continuous import ContinuousTask
from panoptic_ros.stage import Progress, Recording


class _WithImages:
    """Recording (`stage.Recording`) with the images of a capture folder as records "image"."""

    def __init__(self, recording: Recording, images: CaptureFolder):
        self._recording, self._images = recording, images

    def records(
        self, topic: str, scope: str = "", begin_ns: int | None = None, end_ns: int | None = None
    ) -> Iterable[Any]:
        """Return the records of a topic; images camera by camera, one at a time in memory."""
        if topic == "image":
            return chain.from_iterable(self._images.sources)
        return self._recording.records(topic, scope, begin_ns, end_ns)


def solve_preset(
    task: ContinuousTask, images: Path | None, alone: bool, progress: Progress
) -> ContinuousMotion:
    """Return the motion of all people by the method of Elhayek et al. 2012.

    Args:
        images: capture folder with the images of the cameras, None = 2D poses only.
        alone: the images are the only measurements after the first pose.

    Raises:
        UserError: if the rig, the recording or the images cannot be used.
    """
    if alone and images is None:
        raise UsageError("--images-only needs the images; name their folder with --images FOLDER")
    model = read_body_model()
    extras = {"segments": model, "body_shape": read_body_shape(model)}
    context = replace(task.context, extras={**task.context.extras, **extras})
    stage = ElhayekPass(ElhayekConfig(task.config, not alone, images is not None), context)
    if images is None:
        return stage.run(task.recording, progress)
    with open_capture_folder(images, rig=task.context.rig) as folder:
        return stage.run(_WithImages(task.recording, folder), progress)
