"""Read the data inputs of the kinematics stage: subjects, segment skeleton and pose prior."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from panoptic_ros.domain.subjects import Subject
from panoptic_ros.errors import UsageError
from panoptic_ros.io.body_models import DEFAULT_MODEL, read_body_model
from panoptic_ros.io.joint_offsets import read_joint_offsets
from panoptic_ros.io.kinematic_files import read_subject
from panoptic_ros.io.pose_prior import read_prior


def body_extras(
    subjects: Sequence[Path], segments: str = "", prior: str = "", offsets: str = ""
) -> Mapping[str, Any]:
    """Return the extras of `kinematics.KinematicsStage`.

    Args:
        subjects: Subject files.
        segments: Segment skeleton, name or file; "" = the default.
        prior: Pose prior file; "" = the installed prior.
        offsets: File with the joint positions of the detector relative to the segments; "" = the positions in
            the segment skeleton.

    Raises:
        UserError: naming the file and the fault, or an id or a device that two subjects share.
    """
    model = read_body_model(segments or DEFAULT_MODEL)
    if offsets:
        model = read_joint_offsets(Path(offsets), model)
    people = tuple(read_subject(path, model) for path in subjects)
    _require_distinct(subjects, people)
    return {"subjects": people, "segments": model, "pose_prior": read_prior(prior, model)}


def _require_distinct(paths: Sequence[Path], people: Sequence[Subject]) -> None:
    owners: dict[object, Path] = {}
    for path, subject in zip(paths, people):
        for key, what in [(subject.id, f"id {subject.id}")] + [
            (device.name, f"device {device.name}") for device in subject.devices
        ]:
            if key in owners:
                raise UsageError(f"{owners[key]} and {path} both have {what}; change one of them")
            owners[key] = path
