"""Corrects the timestamps of a recording's cameras before `solve`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from panoptic_ros.errors import UsageError
from panoptic_ros.graph.clocks_from_motion import find_clocks
from panoptic_ros.io.clock_files import write_clocks
from panoptic_ros.offsets.regroup import regroup
from panoptic_ros.offsets.sound.passes import APART
from panoptic_ros.running.plans.saved_clocks import RecordingClocks, with_line_delays
from panoptic_ros.running.solve import SolveTask
from panoptic_ros.running.sound.clocks import clocks_from_sound, recorded_sound
from panoptic_ros.stage import Progress, part_of, untold
from panoptic_ros.view.clock_lines import clock_lines, contradictions, sound_lines


@dataclass(frozen=True)
class Correction:
    """Options of the correction of camera clocks. By default, nothing is corrected.

    Args:
        saved: File with known clocks, which correct the timestamps, and line delays.
        from_sound: Capture folder or bag with the cameras' sound, from which offsets and drifts are
            estimated.
        apart: Maximum distance between microphones, m, see `offsets.sound.SoundClocksConfig`.
        from_motion: Estimate offsets and drifts from the motion of people. After a correction by sound,
            estimate the residual offsets and drifts.
        out: Output file for the estimates.
        trusted: Camera with correct timestamps. "" = most cameras if they agree, else the mean of all.

    Raises:
        UsageError: if options contradict each other.
    """

    saved: Path | None = None
    from_motion: bool = False
    from_sound: Path | None = None
    apart: float = APART
    out: Path | None = None
    trusted: str = ""

    def __post_init__(self) -> None:
        found = self.from_motion or self.from_sound is not None
        if self.saved and found:
            option = "--offsets-from-motion" if self.from_motion else "--offsets-from-sound"
            raise UsageError(f"give --offsets FILE or {option}, which estimates them again, not both")
        if not found and (self.out or self.trusted):
            raise UsageError(
                "--offsets-out and --trusted-camera need --offsets-from-motion or --offsets-from-sound"
            )


def corrected(
    task: SolveTask, correction: Correction, progress: Progress = untold
) -> tuple[SolveTask, list[str]]:
    """Return the task with corrected timestamps and regrouped detection sets, and lines about the correction.

    Raises:
        UserError: if a file cannot be used or written, or a camera does not exist.
    """
    told: list[str] = []
    heard = None
    first_ns = min((view.stamp_ns for item in task.sets for view in item.views), default=0)
    if correction.from_sound is not None:
        share = part_of(progress, 0.0, 0.3 if correction.from_motion else 1.0)
        recorders, _ = recorded_sound(correction.from_sound)
        heard = clocks_from_sound(
            recorders,
            task.context.rig.names,
            task.context.rig,
            trusted=correction.trusted,
            apart=correction.apart,
            progress=share,
        )
        task = replace(task, sets=regroup(task.sets, heard.clocks.corrections(task.sets)))
        told, clocks = sound_lines(heard), heard.clocks
    if correction.from_motion:
        share = part_of(progress, 0.3, 1.0) if heard else progress
        found = find_clocks(task.sets, task.context, task.configs, correction.trusted, share)
        task, clocks = replace(task, sets=found.sets), found.clocks
        told += clock_lines(found.clocks)
        if heard:
            told += contradictions(heard, found.clocks)
            clocks = heard.clocks.then(found.clocks)
    if correction.from_motion or heard:
        if correction.out:
            write_clocks(correction.out, clocks, first_ns)
        return task, told
    if correction.saved:
        return _moved(task, correction.saved)
    return task, []


def _moved(task: SolveTask, path: Path) -> tuple[SolveTask, list[str]]:
    """Return the task with saved clocks and line delays, and lines about them."""
    rig = task.context.rig
    clocks = RecordingClocks.of(path, rig.names, task.sets)
    shifts: dict[str, list[int]] = {}
    for view in (view for item in task.sets for view in item.views):
        moved = clocks.corrected(view.camera, view.stamp_ns)
        shifts.setdefault(view.camera, []).append(moved - view.stamp_ns)
    corrections = {name: np.array(own, float) for name, own in shifts.items()}
    context = replace(task.context, rig=with_line_delays(rig, clocks.saved))
    return replace(task, context=context, sets=regroup(task.sets, corrections)), clocks.told(rig.names)
