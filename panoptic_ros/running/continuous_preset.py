"""Turns 2D poses, and images if there are any, into motion by the method of Elhayek et al. 2012."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from panoptic_ros.capture.folder import open_capture_folder
from panoptic_ros.continuous.elhayek.passes import ElhayekPass, Fitted
from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.io.kinematic_files import read_subject
from panoptic_ros.running.continuous import ContinuousTask, with_segments
from panoptic_ros.running.grouping import views_in_order
from panoptic_ros.stage import Progress, Recording

PRESET = "elhayek-2012"


class RecordingWithImages:
    """Recording (`stage.Recording`) with the images of cameras as records "image", one at a time in memory.

    Args:
        recording: everything else.
        frames: returns the images, camera by camera.
    """

    def __init__(self, recording: Recording, frames: Callable[[], Iterable[ViewFrame]]):
        self._recording, self._frames = recording, frames

    def records(
        self, topic: str, scope: str = "", begin_ns: int | None = None, end_ns: int | None = None
    ) -> Iterable[Any]:
        """Return the records of a topic; all images, whatever the limits."""
        return self._frames() if topic == "image" else self._recording.records(topic, scope, begin_ns, end_ns)


def check_preset(options: Mapping[str, Any]) -> None:
    """Check that no option of `panoptic continuous` lacks the preset that it needs or contradicts another.

    Raises:
        UsageError: naming the option.
    """
    for name in ("images", "score_maps"):
        if options[name] and not options["preset"]:
            told = f"--{name.replace('_', '-')} needs --preset {PRESET}"
            raise UsageError(f"{told}: the curves of joints use 2D people alone")
    if options["images"] and options["offsets"]:
        raise UsageError("--images does not go with --offsets, which corrects the timestamps of 2D people")


def solve_preset(
    task: ContinuousTask, subject: Path | None, images: Path | None, score_maps: bool, progress: Progress
) -> ContinuousMotion:
    """Return the motion of all people by the method of Elhayek et al. 2012.

    Args:
        subject: file with the skeleton of a person.
        images: capture folder whose images are fitted.
        score_maps: fit the score maps of the views.

    Raises:
        UserError: if the rig, the recording, the subject, the images or the score maps cannot be used.
    """
    context = with_segments(task.context)
    known = None if subject is None else read_subject(subject, context.extras["segments"])
    fitted: Fitted = "joints" if images is None else "images"
    if score_maps:
        _check_maps(task)
        fitted = "maps"
    work = ElhayekPass(task.config, context, known, fitted)
    if images is None:
        return work.run(task.recording, progress)
    with open_capture_folder(images, rig=task.context.rig) as folder:
        frames = partial(chain.from_iterable, folder.sources)
        return work.run(RecordingWithImages(task.recording, frames), progress)


def _check_maps(task: ContinuousTask) -> None:
    """Check that some view has score maps.

    Raises:
        DataError: if there is none.
    """
    views = views_in_order(task.recording.records("detection_sets"))
    if views and all(view.maps is None for view in views):
        raise DataError(
            f"none of the {len(views)} views has score maps, which --score-maps needs; give a bag or images "
            "of a detector that has them, or leave the option out"
        )
