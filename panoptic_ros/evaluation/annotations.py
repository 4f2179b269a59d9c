"""Manual 3D annotation of the Shelf and Campus data sets, as a JSON document.

    {"unit": "m", "joint_names": [...], "frames": {"300": [{"id": 0, "joints": [[x, y, z], ...]}]}}

Frames have numbers and no timestamps. A person who is not listed in a frame may still be present.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from panoptic_ros.errors import DataError, one_line, shown
from panoptic_ros.evaluation.sequences import SkeletonFrame, SkeletonSequence

SHELF_PERIOD_NS = 40_000_000  # 25 Hz


def is_annotation(document: Any) -> bool:
    """Return whether a JSON document looks like an annotation."""
    return isinstance(document, dict) and isinstance(document.get("frames"), dict)


def parse_annotation(document: Any, where: str, frame_period_ns: int = SHELF_PERIOD_NS) -> SkeletonSequence:
    """Return the annotated people; the timestamp of a frame is its number times `frame_period_ns`.

    Raises:
        DataError: If the document is invalid. The message names `where` and the fault.
    """
    if document.get("unit") != "m":
        raise DataError(f"{where}: the unit is {shown(document.get('unit'))}, expected 'm'")
    try:
        names = tuple(str(name) for name in document["joint_names"])
        frames = []
        for number in sorted(document["frames"], key=int):
            people = document["frames"][number]
            joints = [[(joint or [np.nan] * 3)[:3] for joint in p["joints"]] for p in people]
            positions = np.array(joints, np.float64).reshape(len(people), len(names), 3)
            ids = np.array([int(person["id"]) for person in people], np.int64)
            frames.append(SkeletonFrame(int(number) * frame_period_ns, ids, positions))
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise DataError(f"{where}: no annotation of 3D joints: {one_line(error)}") from None
    return SkeletonSequence(names, tuple(frames))
