"""Defines the options of any run, whatever its source, and applies them to the plan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from panoptic_ros.assembly.config import AssemblyConfig
from panoptic_ros.capture.imus import imu_devices
from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.detection.upright import NOT_KNOWN, rolls_of
from panoptic_ros.domain import SkeletonModel
from panoptic_ros.domain.upright import Z_UP
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.topics import check_names
from panoptic_ros.io.clock_files import SavedClock
from panoptic_ros.io.detector_context import bias_extras, detector_extras, noise_only
from panoptic_ros.io.skeletons import DEFAULT_SKELETON
from panoptic_ros.offsets.config import OffsetsConfig
from panoptic_ros.offsets.sound.passes import APART
from panoptic_ros.params import config_of
from panoptic_ros.running.plans.designated import with_bodies, with_subjects
from panoptic_ros.running.plans.duration import begins
from panoptic_ros.running.plans.parameters import Parameters, with_occluders
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.plans.saved_clocks import NEAR_NS, saved_clocks, saved_lines, with_line_delays
from panoptic_ros.stamps.delays import delay_entry
from panoptic_ros.sync.config import SyncConfig


@dataclass(frozen=True)
class RunOptions:
    """Options of any run. Options that are not given change nothing.

    Args:
        parameters: {stage: {parameter: value}}.
        model: Pose model: name, card or ONNX file. It takes precedence over the parameter `detection.model`.
        skeleton: Working skeleton: name or YAML file; "" = not given.
        usual_skeleton: Default for `skeleton`, unless a recording has its own skeleton.
        occluders: File of static objects that occlude people.
        offsets: File with known clock offsets of cameras, added to their timestamps.
        from_sound: Estimate the clocks of the cameras from their recorded sound.
        apart: Maximum distance between microphones, m, where the rig does not give it.
        subjects: Files of designated people, in addition to those of a capture folder.
        imus: File of IMU samples.
    """

    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    model: str = ""
    skeleton: str = ""
    usual_skeleton: str = DEFAULT_SKELETON
    occluders: Path | None = None
    offsets: Path | None = None
    from_sound: bool = False
    apart: float = APART
    subjects: tuple[Path, ...] = ()
    imus: Path | None = None

    def all_parameters(self) -> Parameters:
        """Return the parameters, including the model."""
        values = {stage: dict(given) for stage, given in self.parameters.items()}
        if self.model:
            values.setdefault("detection", {})["model"] = self.model
        return values

    @property
    def chosen_skeleton(self) -> str:
        """Return the working skeleton for a recording that has none of its own."""
        return self.skeleton or self.usual_skeleton

    def detector(self) -> tuple[SkeletonModel, Mapping[str, Any]]:
        """Return the working skeleton and the extras of the stages, for the pose model."""
        config = config_of(configure(self.all_parameters()), DetectionConfig)
        return detector_extras(config.model, self.chosen_skeleton)

    def complete(self, plan: Plan) -> Plan:
        """Complete the plan with the options that do not depend on its source.

        These are occluders, clock offsets, designated people, biases of the detector's joints, and the up
        direction that turns images upright.

        Raises:
            UserError: if a file cannot be used, or the plan already has delays of cameras.
        """
        check_names(plan.rig.names)
        plan = plan if self.offsets is None else _with_offsets(plan, self.offsets)
        rig = with_occluders(plan.rig, self.occluders)
        if self.imus is not None and self.subjects:
            plan = replace(plan, imus=dict.fromkeys(imu_devices(self.imus), self.imus))
        plan = with_bodies(with_subjects(plan, self.subjects))
        table = config_of(plan.configs, AssemblyConfig).bias_table
        told = noise_only(plan.skeleton.bias_floors) if rig.cameras else []
        plan = replace(
            plan,
            rig=rig,
            extras={**plan.extras, **bias_extras(table, plan.skeleton)},
            notices=(*rig.notices, *plan.notices, *told),
        )
        return _with_upright_images(plan) if plan.stage == "detection" else plan


class Source(Protocol):
    """Source of the records of a run: a capture folder, videos, devices, bags, topics of drivers, or IMUs.

    Each source makes the plan of a run from the same options.
    """

    def __call__(self, options: RunOptions, /) -> Plan:
        """Return the plan.

        Raises:
            UserError: on any fault that the user can fix, before anything has started.
        """
        ...


NO_OPTIONS = RunOptions()
SECOND = 1_000_000_000


def _with_offsets(plan: Plan, path: Path) -> Plan:
    """Return the plan with known clock offsets as delays of the cameras, and with known line delays."""
    sync, offsets = config_of(plan.configs, SyncConfig), config_of(plan.configs, OffsetsConfig)
    if sync.delays_ms:
        raise UsageError("--offsets and sync.delays_ms both state the delays of stamps; give one of them")
    saved = saved_clocks(path, plan.rig.names)
    first, drifting = _contains_reference(plan, saved)
    delays = tuple(delay_entry(name, clock.line(first, drifting)) for name, clock in saved.items())
    configs = {
        **plan.configs,
        "sync": replace(sync, delays_ms=delays),
        "offsets": replace(offsets, delays_ms=delays),
    }
    told = tuple(line.strip() for line in saved_lines(saved, plan.rig.names, drifting))
    # offsets may be seconds, so the streams are aligned by their corrected timestamps
    more = {name: round(SECOND * offset.offset_s) for name, offset in saved.items()}
    streams = tuple(replace(s, shift_ns=s.shift_ns + more.get(s.camera, 0)) for s in plan.streams)
    shifts = {name: plan.shifts.get(name, 0) + more.get(name, 0) for name in (*plan.shifts, *more)}
    notices = (*plan.notices, *told)
    rig = with_line_delays(plan.rig, saved)
    return replace(plan, rig=rig, configs=configs, streams=streams, shifts=shifts, notices=notices)


def _contains_reference(plan: Plan, saved: Mapping[str, SavedClock]) -> tuple[int, bool]:
    """Return the first timestamp (ns) of a recording, and whether drifts of saved clocks count in it.

    They count if they were estimated in this recording, so that it contains their reference. Elsewhere the
    reference is too far away.
    """
    if plan.live or plan.instants is None or not any(clock.drift for clock in saved.values()):
        return 0, False
    stamps = list(begins(plan))
    if not stamps:
        return 0, False
    last = max(stamps) + round(SECOND * plan.instants / plan.frame_rate)
    references = {clock.reference_ns for clock in saved.values()}
    drifting = any(at is None or min(stamps) - NEAR_NS <= at <= last + NEAR_NS for at in references)
    return min(stamps), drifting


def _with_upright_images(plan: Plan) -> Plan:
    """Return the plan with the rig's up direction as a parameter, as /rig does not contain it."""
    config = config_of(plan.configs, DetectionConfig)
    if not config.up and plan.rig.up != Z_UP:
        config = replace(config, up=plan.rig.up or NOT_KNOWN)
    notice = rolls_of(plan.rig, config.up).notice
    told = () if notice is None else (notice.text,)
    configs = {**plan.configs, "detection": config}
    return replace(plan, configs=configs, notices=(*plan.notices, *told))
