"""The study `offsets-shifted`: clock offsets from motion on a recording with two shifted cameras."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from panoptic_ros.domain import DetectionSet, Rig, ViewDetections
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.clocks_from_motion import find_clocks
from panoptic_ros.io.recorded_people import read_people
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.stage import Progress, StageContext, each
from panoptic_ros.study.study import Case, Column, Row, Study

Array = np.ndarray
FRAMES = (0.0, 0.5, 1.0, 2.0, 4.0)  # shifts of cameras, frames
REACH = 4  # limit of the shift of views, frames in either direction


class ShiftedOffsets(Study):
    """Offsets of a recording as it is, and of shifted ones less the shifts and the offsets as it is.

    The last column is the error of a found offset: offset plus shift, relative to the mean over the cameras,
    minus the same of the unshifted recording.
    """

    columns = (
        Column("camera", "camera"),
        Column("shift", "shifted by frames", "+g"),
        Column("offset_s", "found ms", "+.1f", 1e3),
        Column("stated_s", "stated ms", ".1f", 1e3),
        Column("from_unshifted_s", "from unshifted ms", "+.2f", 1e3),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--rig", type=Path, metavar="FILE", required=True, help="calibration of the recording"
        )
        parser.add_argument(
            "--detections", type=Path, metavar="FILE", required=True, help="2D people of the recording"
        )

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        rig = read_rig(self.options.rig)
        people = read_people(self.options.detections, rig)
        sets, context, configs = people.sets, StageContext(rig, people.skeleton), configure({})
        period = int(np.median(np.diff([item.stamp_ns for item in sets])))
        unshifted = np.zeros(len(rig))
        for k, frames in enumerate(each(FRAMES, len(FRAMES), progress, "shifts")):
            shifts = np.zeros(len(rig))
            if frames:
                first = (k - 1) % len(rig)
                shifts[[first, (first + 2) % len(rig)]] = frames, frames if k % 2 else -frames
            clocks = find_clocks(shifted(sets, rig, shifts, period), context, configs).clocks
            late = clocks.offsets + 1e-9 * period * shifts
            late = late - late.mean()
            unshifted = unshifted if k else late
            for c, camera in enumerate(rig.names):
                yield {
                    "camera": camera,
                    "shift": float(shifts[c]),
                    "offset_s": float(clocks.offsets[c]),
                    "stated_s": float(clocks.deviations[c]),
                    "corrected": bool(clocks.applied[c]),
                    "from_unshifted_s": float(late[c] - unshifted[c]),
                }


def shifted(sets: Sequence[DetectionSet], rig: Rig, shifts: Array, period: int) -> list[DetectionSet]:
    """Shift the timestamps of each camera by a number of frames (C,) and regroup the views.

    Each view moves to the nearest set.
    """
    given = [item.stamp_ns for item in sets]
    instants = np.array(sorted({t + k * period for t in given for k in range(-REACH, REACH + 1)}), np.int64)
    places: list[dict[str, ViewDetections]] = [{} for _ in instants]
    for item in sets:
        for view in item.views:
            stamp = view.stamp_ns + round(period * float(shifts[rig.index(view.camera)]))
            near = int(np.abs(instants - stamp).argmin())
            places[near].setdefault(view.camera, replace(view, stamp_ns=max(0, stamp)))
    return [
        DetectionSet(i, int(t), sets[0].skeleton_hash, tuple(p[n] for n in rig.names if n in p))
        for i, (t, p) in enumerate(zip(instants, places))
        if t >= 0
    ]
