"""Subject files of a run, and what they tell tracking."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from panoptic_ros.domain.subjects import Subject
from panoptic_ros.errors import UsageError
from panoptic_ros.identity.subjects import subject_word
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.kinematic_files import read_subject
from panoptic_ros.params import config_of
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.tracking.config import TrackingConfig

PATTERN = "subject*.json"


def subject_files(folder: Path, given: Sequence[Path]) -> tuple[Path, ...]:
    """Those that are given, and those of a capture folder."""
    found = {path.resolve(): path for path in (*given, *sorted(folder.glob(PATTERN)))}
    return tuple(found.values())


def read_subjects(paths: Sequence[Path]) -> tuple[Subject, ...]:
    """The people of these files.

    Raises:
        UserError: naming the file and what is wrong, or the id that stands twice.
    """
    model = read_body_model()
    people = tuple(read_subject(path, model) for path in paths)
    ids = [subject.id for subject in people]
    for number in sorted(set(ids)):
        if ids.count(number) > 1 or number < 0:
            names = ", ".join(str(path) for path, found in zip(paths, ids) if found == number)
            raise UsageError(f"subjects have distinct ids from 0 on: {names}: id {number}; change `id`")
    return people


def with_subjects(plan: Plan, paths: Sequence[Path]) -> Plan:
    """The plan of a run whose designated people are those of these files.

    Raises:
        UserError: as `read_subjects`, or if the parameters designate people too.
    """
    if not paths:
        return plan
    config = config_of(plan.configs, TrackingConfig)
    if config.subjects:
        raise UsageError("--subject and tracking.subjects both tell who is designated; give one of them")
    words = tuple(subject_word(subject.id, subject.start) for subject in read_subjects(paths))
    configs = {**plan.configs, "tracking": replace(config, subjects=words)}
    return replace(plan, configs=configs, subjects=tuple(paths))
