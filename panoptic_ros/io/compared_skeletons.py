"""Read 3D poses for an evaluation, select their joints, and match joint names between result and truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence
from panoptic_ros.evaluation.annotations import is_annotation, parse_annotation
from panoptic_ros.evaluation.pairing import MIN_COMMON
from panoptic_ros.io.documents import read_json
from panoptic_ros.io.known_keys import EACH, OTHERS, keys, tell_unknown
from panoptic_ros.io.loading import parsing
from panoptic_ros.io.plain_formats import read_skeletons
from panoptic_ros.io.skeletons import in_vocabulary, shared_names, skeleton_names

ANNOTATION_KEYS = keys(
    f"unit joint_names {OTHERS}",
    frames={EACH: [keys(f"id joints {OTHERS}")]},  # other programs write these files, with further keys
)


def read_sequence(path: Path) -> SkeletonSequence:
    """Read 3D poses from a plain file or an annotation file.

    Raises:
        DataError: naming the file and the fault.
    """
    document: Any = read_json(path)
    if is_annotation(document):
        tell_unknown(document, ANNOTATION_KEYS, path)
        with parsing(path):
            return parse_annotation(document, str(path))
    plain = read_skeletons(path)
    try:
        return SkeletonSequence(
            plain.joint_names,
            tuple(
                SkeletonFrame(f.stamp_ns, f.ids, f.positions, f.covariances, f.ignore, f.views)
                for f in plain.frames
            ),
        )
    except DataError as error:
        raise DataError(f"{path}: {error}") from None


def only_joints(truth: SkeletonSequence, text: str) -> SkeletonSequence:
    """Return the truth reduced to some joints.

    Args:
        text: name or YAML file of a skeleton, whose joints may be missing in the truth. Or joint names,
            separated by commas, in the spelling of any installed skeleton.

    Raises:
        UsageError: if the truth lacks a named joint, or if fewer than MIN_COMMON joints remain to match
            people.
    """
    whole = text in skeleton_names() or text.endswith((".yaml", ".yml"))
    words = shared_names(text) if whole else in_vocabulary([name.strip() for name in text.split(",")])
    own = dict(zip(in_vocabulary(truth.joint_names), truth.joint_names))
    unknown = [word for word in words if word not in own]
    if unknown and not whole:
        raise UsageError(f"--joints {unknown[0]}: the truth's joints are {', '.join(truth.joint_names)}")
    kept = [name for word, name in own.items() if word in words]
    if len(kept) < MIN_COMMON:
        raise UsageError(
            f"--joints {text} leaves {len(kept)} of the truth's joints; the matching of people needs "
            f"{MIN_COMMON} or more"
        )
    return truth.with_joints(kept)


def spelt_alike(result: SkeletonSequence, truth: SkeletonSequence) -> SkeletonSequence:
    """Rename the joints of the result as in the truth, e.g. left_hip to lHip.

    Raises:
        DataError: if two joints of the result map to one joint of the truth.
    """
    theirs = dict(zip(in_vocabulary(truth.joint_names), truth.joint_names))
    words = zip(result.joint_names, in_vocabulary(result.joint_names))
    names = tuple(name if name in truth.joint_names else theirs.get(word, name) for name, word in words)
    for name in names:
        if names.count(name) > 1:
            raise DataError(f"several joints of the result have names that mean {name}")
    return replace(result, joint_names=names)
