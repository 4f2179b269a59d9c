"""Turns 2D poses, and images if there are any, into motion by the method of a paper."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from panoptic_ros.continuous.elhayek.config import ElhayekConfig
from panoptic_ros.continuous.elhayek.passes import ElhayekPass
from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.running.continuous import ContinuousTask
from panoptic_ros.stage import Progress

PRESETS = ("elhayek-2012",)


def solve_preset(task: ContinuousTask, images: Path | None, alone: bool, progress: Progress) -> ContinuousMotion:
    """Return the motion of all people by the method of Elhayek et al. 2012.

    Args:
        images: capture folder with the images of the cameras, None = 2D poses only.
        alone: the images are the only measurements after the first pose.

    Raises:
        UserError: if the rig, the recording or the images cannot be used.
    """
    model = read_body_model()
    context = replace(task.context, extras={**task.context.extras, "segments": model})
    config = ElhayekConfig(task.config, keypoints=not alone, images=images is not None)
    return ElhayekPass(config, context).run(task.recording, progress)
