"""Applies subject files to the plan of a run, and designates their people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from panoptic_ros.continuous.config import ContinuousStageConfig
from panoptic_ros.errors import UsageError
from panoptic_ros.identity.subjects import subject_word
from panoptic_ros.io.bag_streams import IMU_KEY
from panoptic_ros.io.body_context import body_extras
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.params import config_of
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.tracking.config import TrackingConfig

PATTERN = "subject*.json"


def subject_files(folder: Path, given: Sequence[Path]) -> tuple[Path, ...]:
    """Return the given subject files and those of a capture folder, each once."""
    found = {path.resolve(): path for path in (*given, *sorted(folder.glob(PATTERN)))}
    return tuple(found.values())


def with_subjects(plan: Plan, paths: Sequence[Path]) -> Plan:
    """Return the plan with the people of these subject files as designated people.

    Raises:
        UserError: if a file is invalid, or the parameters designate people as well.
    """
    if not paths:
        return plan
    config = config_of(plan.configs, TrackingConfig)
    instants = config_of(plan.configs, ContinuousStageConfig)
    for stage, given in (("tracking", config.subjects), ("continuous", instants.subjects)):
        if given:
            raise UsageError(f"--subject and {stage}.subjects both designate people; give one of them")
    people = body_extras(paths)["subjects"]
    words = tuple(subject_word(subject.id, subject.start) for subject in people)
    bodies = config_of(plan.configs, KinematicsConfig)
    configs = {
        **plan.configs,
        "tracking": replace(config, subjects=words),
        "continuous": replace(instants, subjects=words),
        "kinematics": replace(bodies, subjects=tuple(str(path) for path in paths)),
    }
    worn = tuple(device.name for subject in people for device in subject.devices)
    told = [line for subject in people for line in subject.told()]
    notices = (*plan.notices, *told)
    return _with_imus(replace(plan, configs=configs, subjects=tuple(paths), worn=worn, notices=notices))


def with_bodies(plan: Plan) -> Plan:
    """Return the plan with the input of the kinematics stage, if that stage runs.

    Raises:
        UserError: if a file of a subject, of segments or of a prior cannot be used.
    """
    config = config_of(plan.configs, KinematicsConfig)
    if not config.runs:
        return plan
    paths = [Path(path) for path in config.subjects]
    extras = body_extras(paths, config.segments, config.prior, config.offsets)
    return replace(plan, extras={**plan.extras, **extras})


def _with_imus(plan: Plan) -> Plan:
    """Return the plan with only those recorded IMUs that a subject wears.

    Notices name the unused and the missing IMUs.
    """
    imus = {name: path for name, path in plan.imus.items() if name in plan.worn}
    streams = tuple(s for s in plan.streams if s.key != IMU_KEY or s.camera in plan.worn)
    idle = [
        name
        for name in (*plan.imus, *(s.camera for s in plan.streams if s.key == IMU_KEY))
        if name not in plan.worn
    ]
    found = {*imus, *(s.camera for s in streams if s.key == IMU_KEY)}
    silent = [] if plan.live else [name for name in plan.worn if name not in found]
    notices = [f"IMU {name} is on no subject and left out" for name in idle]
    notices += [f"IMU {name}, which a subject wears, has no samples" for name in silent]
    return replace(plan, imus=imus, streams=streams, notices=(*plan.notices, *notices))
