"""Turns 2D poses into motion by the method of Elhayek et al. 2012."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from panoptic_ros.continuous.elhayek.passes import ElhayekPass
from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.errors import UsageError
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.kinematic_files import read_subject
from panoptic_ros.running.continuous import ContinuousTask
from panoptic_ros.stage import Progress, untold

PRESET = "elhayek-2012"


def check_preset(options: Mapping[str, Any]) -> None:
    """Check that no option of `panoptic continuous` lacks the preset that it needs.

    Raises:
        UsageError: naming the option.
    """
    if options["subject"] and not options["preset"]:
        raise UsageError(
            f"--subject needs --preset {PRESET}: the curves of joints use no skeleton and learn bone lengths"
        )


def solve_preset(
    task: ContinuousTask, subject: Path | None = None, progress: Progress = untold
) -> ContinuousMotion:
    """Return the motion of all people by the method of Elhayek et al. 2012.

    Args:
        subject: file with the skeleton of a person.

    Raises:
        UserError: if the rig, the recording or the subject cannot be used.
    """
    model = read_body_model()
    known = None if subject is None else read_subject(subject, model)
    context = replace(task.context, extras={**task.context.extras, "segments": model})
    return ElhayekPass(task.config, context, known).run(task.recording, progress)
