"""Read and write bias tables: config/biases/*.yaml and the files of `panoptic bias measure`.

A file holds the offsets of the middle and left joints. The right side is mirrored. Joint names come from the
vocabulary that all skeletons share.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from panoptic_ros.domain import BiasTable, SkeletonModel
from panoptic_ros.errors import ConfigError, shown
from panoptic_ros.io.documents import read_yaml
from panoptic_ros.io.files import write_bytes
from panoptic_ros.io.known_keys import keys, tell_unknown
from panoptic_ros.io.loading import parsing
from panoptic_ros.io.resources import share_folder
from panoptic_ros.io.skeletons import in_vocabulary

Array = np.ndarray
FORMAT = "panoptic-biases-1"
KEYS = keys("format offsets detector measured_on source licence")
# Largest offset, torso lengths. A body is about four torso lengths high.
LARGEST = 10.0
TORSO = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")
HEADER = (
    "# From the detector's joints to the reference's: forward, left, up in the torso frame, torso lengths.\n"
    "# The right side is the mirror image of the left. See docs/files.md.\n"
)


def bias_table_names() -> tuple[str, ...]:
    """Return the names of the installed tables."""
    return tuple(sorted(path.stem for path in (share_folder() / "config" / "biases").glob("*.yaml")))


def read_bias_table(name_or_path: str, skeleton: SkeletonModel) -> BiasTable:
    """Read the bias table for the joints of a skeleton; joints that are not in the file have offset 0.

    The offset of a `derived` joint is the mean of the offsets of its source joints.

    Args:
        name_or_path: installed table, or path of a YAML file.

    Raises:
        ConfigError: if the table does not exist or has another format, or if the skeleton has no torso.
        DataError: if the file cannot be read.
    """
    path = Path(name_or_path).expanduser()
    if path.suffix not in (".yaml", ".yml"):
        path = share_folder() / "config" / "biases" / f"{name_or_path}.yaml"
        if not path.is_file():
            known = ", ".join(bias_table_names())
            raise ConfigError(
                f"unknown bias table {shown(name_or_path)}; there are {known}, or the path of a YAML file"
            )
    document = read_yaml(path)
    with parsing(path, ConfigError):
        entries = _entries(document, path)
    words = in_vocabulary(skeleton.joint_names)
    offsets = np.array([offset_of(word, entries) for word in words])
    for joint, sources in skeleton.derived:
        offsets[joint] = offsets[list(sources)].mean(axis=0)
    return BiasTable(path.stem, offsets, torso_of(skeleton.joint_names, f"skeleton {skeleton.name}"))


def write_bias_table(path: Path, offsets: Mapping[str, Sequence[float]], facts: Mapping[str, Any]) -> None:
    """Write a bias table: offsets of the middle and left joints, and `facts` about the measurement."""
    lines = [HEADER + yaml.safe_dump({"format": FORMAT, **facts}, sort_keys=False, width=110), "offsets:\n"]
    lines += [f"  {word}: [{', '.join(f'{v:.4f}' for v in row)}]\n" for word, row in offsets.items()]
    write_bytes(path, "".join(lines).encode())


def torso_of(joint_names: Sequence[str], owner: str) -> tuple[int, int, int, int]:
    """Return the joint indices of left shoulder, right shoulder, left hip and right hip.

    Raises:
        ConfigError: if one of them is missing.
    """
    words = in_vocabulary(joint_names)
    for word in TORSO:
        if word not in words:
            raise ConfigError(f"{owner} has no {word}, so no torso frame for a bias table")
    a, b, c, d = (words.index(word) for word in TORSO)
    return a, b, c, d


def offset_of(word: str, entries: Mapping[str, Array]) -> Array:
    """Return the offset (3,) of a joint in torso lengths; mirror the left entry for a right joint."""
    if word.startswith("right_"):
        return entries.get("left_" + word.removeprefix("right_"), np.zeros(3)) * (1.0, -1.0, 1.0)
    return entries.get(word, np.zeros(3))


def _entries(document: Any, path: Path) -> dict[str, Array]:
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise ConfigError(f"{path} is not a bias table: it needs format: {FORMAT}")
    tell_unknown(document, KEYS, path)
    rows = document.get("offsets")
    if not isinstance(rows, dict) or not rows:
        raise ConfigError(f"{path} has no offsets")
    entries = {}
    for word, row in rows.items():
        good = isinstance(row, list) and len(row) == 3 and all(type(v) in (int, float) for v in row)
        if not good or not (np.abs(np.array(row, float)) < LARGEST).all() or str(word).startswith("right_"):
            raise ConfigError(
                f"{path}: offset of {shown(word)}: "
                f"needs a left or middle joint and three numbers, at most {LARGEST:g}"
            )
        entries[str(word)] = np.array(row, float)
    return entries
