"""Read and write offsets of a detector's joints in segment frames (`panoptic bias measure --segments`).

A file holds the middle and left joints. The right side is mirrored. Joint names come from the vocabulary that
all skeletons share.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from panoptic_ros.domain.segments import JointOffset, SegmentModel
from panoptic_ros.errors import ConfigError, DataError, shown
from panoptic_ros.io.documents import read_yaml
from panoptic_ros.io.files import write_bytes
from panoptic_ros.io.known_keys import EACH, keys, tell_unknown
from panoptic_ros.io.loading import parsing
from panoptic_ros.io.skeletons import in_vocabulary

FORMAT = "panoptic-joint-offsets-1"
KEYS = keys("format detector measured_on source licence", offsets={EACH: keys("frame offset")})
LONGEST = 0.2  # m; limit of an offset, larger ones are refused
HEADER = (
    "# Where the detector sees joints: m from where the skeleton of segments has them, in the frame of a\n"
    "# segment: x forward, y left, z up in a T. The right side is the mirror image. See docs/files.md.\n"
)


def read_joint_offsets(path: Path, model: SegmentModel) -> SegmentModel:
    """Return the segment skeleton with the joint offsets of a file.

    Raises:
        ConfigError: naming the file, the joint and the fault.
        DataError: if the file cannot be read.
    """
    document = read_yaml(path)
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise ConfigError(f"{path} has no offsets of joints in segments: it needs format: {FORMAT}")
    tell_unknown(document, KEYS, path)
    rows = document.get("offsets")
    if not isinstance(rows, dict) or not rows:
        raise ConfigError(f"{path} has no offsets")
    with parsing(path, ConfigError):
        return _with_offsets(rows, path, model)


def _with_offsets(rows: dict[Any, Any], path: Path, model: SegmentModel) -> SegmentModel:
    names = dict(zip(in_vocabulary(tuple(model.keypoints)), model.keypoints))
    found: dict[str, JointOffset] = {}
    for word, row in rows.items():
        if str(word).startswith("right_") or word not in names:
            left = ", ".join(name for name in names if not name.startswith("right_"))
            name = str(word)[:60]
            raise ConfigError(f"{path}: {name} is not a joint in the middle or on the left; there are {left}")
        own = _offset(row, f"{path}: offset of {word}")
        found[names[word]] = own
        other = "right_" + str(word).removeprefix("left_")
        if str(word).startswith("left_") and other in names:
            found[names[other]] = mirrored(own, model.names)
    try:
        return model.with_joint_offsets(found)
    except DataError as error:
        raise ConfigError(f"{path}: {error}") from None


def write_joint_offsets(path: Path, offsets: Mapping[str, JointOffset], facts: Mapping[str, Any]) -> None:
    """Write joint offsets of the middle and left joints, and `facts` about the measurement.

    Args:
        offsets: offsets by joint name of the shared vocabulary.
    """
    lines = [HEADER + yaml.safe_dump({"format": FORMAT, **facts}, sort_keys=False, width=110), "offsets:\n"]
    for word, found in offsets.items():
        numbers = ", ".join(f"{value:.4f}" for value in found.offset)
        lines.append(f"  {word}: {{frame: {found.frame}, offset: [{numbers}]}}\n")
    write_bytes(path, "".join(lines).encode())


def mirrored(found: JointOffset, segments: tuple[str, ...]) -> JointOffset:
    """Return the offset mirrored to the other side of the body (y is negated)."""
    x, y, z = found.offset
    return JointOffset(other_side(found.frame, segments), (x, -y, z))


def other_side(name: str, segments: tuple[str, ...]) -> str:
    """Return the name of the mirrored segment; the name itself for a middle segment."""
    other = {"l": "r", "r": "l"}.get(name[:1], "") + name[1:]
    return other if other in segments else name


def _offset(row: Any, where: str) -> JointOffset:
    frame, values = (row.get("frame"), row.get("offset")) if isinstance(row, dict) else (None, None)
    numbers = values if isinstance(values, list) and len(values) == 3 else []
    if not isinstance(frame, str) or not numbers or not all(type(v) in (int, float) for v in numbers):
        raise ConfigError(f"{where} is {shown(row)}; it needs frame, a segment, and offset, three numbers, m")
    if not np.isfinite(numbers).all() or np.linalg.norm(numbers) > LONGEST:
        raise ConfigError(f"{where} = {numbers} is more than {LONGEST} m; no detector is so far off")
    return JointOffset(frame, (float(numbers[0]), float(numbers[1]), float(numbers[2])))
