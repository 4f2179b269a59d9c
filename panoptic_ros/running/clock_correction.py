"""The stamps of a recording's cameras, corrected before it is solved."""
from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from panoptic_ros.errors import UsageError
from panoptic_ros.graph.clocks_from_motion import find_clocks
from panoptic_ros.io.clock_offsets import write_clocks
from panoptic_ros.offsets import regroup
from panoptic_ros.running.saved_offsets import saved_lines, saved_offsets
from panoptic_ros.running.solve import SolveTask
from panoptic_ros.stage import Progress, untold
from panoptic_ros.view.clock_lines import clock_lines


@dataclass(frozen=True)
class Correction:
    """What is done about the clocks of cameras; by itself nothing.

    Args:
        saved: file with offsets that were found before, to be added to the stamps.
        from_motion: find offsets and drifts from the motion of people.
        out: file to write to what was found.
        trusted: camera whose stamps are right; "": those of most cameras if they agree, else the mean.

    Raises:
        UsageError: on choices that do not go together.
    """

    saved: Path | None = None
    from_motion: bool = False
    out: Path | None = None
    trusted: str = ""

    def __post_init__(self) -> None:
        if self.saved and self.from_motion:
            raise UsageError("give --offsets FILE or --offsets-from-motion, which finds them anew, not both")
        if not self.from_motion and (self.out or self.trusted):
            raise UsageError("--offsets-out and --trusted-camera need --offsets-from-motion")


def corrected(
    task: SolveTask, correction: Correction, progress: Progress = untold
) -> tuple[SolveTask, list[str]]:
    """The task with corrected stamps and sets grouped anew, and lines that tell what was done.

    Raises:
        UserError: if a file cannot be used or written, or a camera is not there.
    """
    if correction.from_motion:
        found = find_clocks(task.sets, task.context, task.configs, correction.trusted, progress)
        if correction.out:
            write_clocks(correction.out, found.clocks)
        return replace(task, sets=found.sets), clock_lines(found.clocks)
    if correction.saved:
        return _moved(task, correction.saved)
    return task, []


def _moved(task: SolveTask, path: Path) -> tuple[SolveTask, list[str]]:
    """By offsets that were saved."""
    names = task.context.rig.names
    saved = saved_offsets(path, names)
    frames = Counter(view.camera for item in task.sets for view in item.views)
    corrections = {
        name: np.full(count, 1e9 * saved[name].offset_s if name in saved else 0.0)
        for name, count in frames.items()
    }
    return replace(task, sets=regroup(task.sets, corrections)), saved_lines(saved, names)
