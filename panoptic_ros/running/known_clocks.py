"""Applies saved clocks before the continuous pass, and adds them to the clocks that the pass estimates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from panoptic_ros.continuous.clocks import CameraTimes
from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.domain import DetectionSet
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.running.continuous import ContinuousTask
from panoptic_ros.running.plans.saved_clocks import RecordingClocks, with_line_delays

Array = np.ndarray
SECOND = 1e9


def with_saved_clocks(task: ContinuousTask, path: Path) -> tuple[ContinuousTask, RecordingClocks]:
    """Return the task with corrected timestamps and saved line delays, and the clocks of a file.

    Views whose corrected timestamps are negative are left out.

    Raises:
        UserError: if the file cannot be used.
    """
    sets = list(task.recording.records("detection_sets"))
    rig = task.context.rig
    clocks = RecordingClocks.of(path, rig.names, sets)
    recording = InMemoryRecording({"detection_sets": [_moved(item, clocks) for item in sets]})
    context = replace(task.context, rig=with_line_delays(rig, clocks.saved))
    return replace(task, context=context, recording=recording), clocks


def whole_clocks(motion: ContinuousMotion, known: RecordingClocks) -> ContinuousMotion:
    """Return a motion whose clocks refer to the uncorrected timestamps: the known clocks, then the estimate.

    Clocks and line delays that were not estimated have the saved standard deviations.
    """
    values, covariance = motion.clocks.values.copy(), motion.clocks.covariance.copy()
    at, count = motion.reference_ns, len(motion.cameras)
    estimated = motion.clocks.deviations.max(axis=1) > 0.0
    for c, name in enumerate(motion.cameras):
        if name not in known.saved:
            continue
        clock, line = known.saved[name], known.lines[name]
        values[0, c] += (line.corrected(at) - at) / SECOND * (1.0 + values[1, c])
        values[1, c] += line.drift * (1.0 + values[1, c])
        if not estimated[0]:
            since = (at - line.reference_ns) / SECOND if known.drifting else 0.0
            change = np.array([[1.0, since], [0.0, 1.0]])
            both = np.ix_([c, count + c], [c, count + c])
            covariance[both] = change @ np.diag([clock.offset_sd_s, clock.drift_sd]) ** 2 @ change.T
        if not estimated[2]:
            covariance[2 * count + c, 2 * count + c] = (1e-6 * clock.line_delay_sd_us) ** 2
    return replace(motion, clocks=CameraTimes(values, covariance))


def _moved(item: DetectionSet, clocks: RecordingClocks) -> DetectionSet:
    views = ((view, clocks.corrected(view.camera, view.stamp_ns)) for view in item.views)
    return replace(item, views=tuple(replace(view, stamp_ns=at) for view, at in views if at >= 0))
