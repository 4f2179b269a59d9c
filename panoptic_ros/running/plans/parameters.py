"""Parameters and fixed things that a user gives, for all that solves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from panoptic_ros.domain import Rig
from panoptic_ros.errors import ConfigError, nearest, shown
from panoptic_ros.graph.build import configure, merged, parse_setting
from panoptic_ros.graph.flow import LIVE_DEFAULTS
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.io.documents import read_yaml
from panoptic_ros.io.occluders import read_occluders
from panoptic_ros.params import Config
from panoptic_ros.running.plans.free_threads import free_threads

ROS = "ros__parameters"  # the key of ROS above the parameters of a node
Parameters = dict[str, dict[str, Any]]  # {stage: {parameter: value}}


def read_parameters(
    file: Path | None, settings: Sequence[str], preset: Parameters | None = None
) -> Parameters:
    """The parameters that the user gave: the preset's, before them the file's, and the settings first of all.

    Args:
        file: YAML with {stage: {parameter: value}}, or a ROS parameter file.
        settings: texts of the form stage.name=value.
        preset: see `running.presets`.

    Raises:
        ConfigError: on unknown ones and bad values.
    """
    values = merged(preset or {}, {} if file is None else parameters_of(read_yaml(file), file))
    for text in settings:
        stage, name, value = parse_setting(text)
        values.setdefault(stage, {})[name] = value
    configure(values)  # so that mistakes are told before anything starts
    return values


def parameters_of(document: Any, file: Path, others: Sequence[str] = ()) -> Parameters:
    """The parameters in the document of a file.

    Args:
        others: keys besides stages that such a file may have, for messages.

    Raises:
        ConfigError: if it is of another form.
    """
    if document is None:
        return {}
    wanted = f"{file} must hold {{stage: {{parameter: value}}}}"
    if not isinstance(document, dict):
        raise ConfigError(f"{wanted}, found {shown(document)}")
    for stage, entries in document.items():
        if not isinstance(entries, dict):
            raise ConfigError(
                f"{wanted}, found {shown(stage)}: {shown(entries)}; {nearest(stage, [*NODES, *others])}"
            )
    return {
        str(stage): {str(name): value for name, value in _plain(entries, f"{file}: {stage}").items()}
        for stage, entries in document.items()
    }


def _plain(entries: dict[str, Any], where: str) -> dict[str, Any]:
    """Entries of a ROS parameter file, as config/*.yaml are, stand one level deeper."""
    if ROS not in entries:
        return entries
    beside = [key for key in entries if key != ROS]
    if beside or not isinstance(entries[ROS], dict):
        odd = f"{shown(beside[0])} stands beside it" if beside else f"it is {shown(entries[ROS])}"
        raise ConfigError(f"{where}: all parameters belong below {ROS}, as names and values; {odd}")
    inner: dict[str, Any] = entries[ROS]
    return inner


def with_defaults(given: Parameters, defaults: Parameters) -> dict[str, Config]:
    """Configurations where `defaults` count only where the user gave nothing."""
    return configure(merged(defaults, given))


def live_parameters(rate: float = 30.0, cameras: int = 1) -> Parameters:
    """What holds for so many live cameras of this rate, Hz, unless the user says something else."""
    return {
        # detection works through the cameras in turn, some side by side
        "sync": {"deadline_s": max(LIVE_DEFAULTS["sync"]["deadline_s"], 3.0 / rate)},
        "detection": {"threads": max(1, free_threads(1) // max(cameras, 1))},
        "refinement": {"lag": min(LIVE_DEFAULTS["refinement"]["lag"], 0.9 / rate)},
    }


def with_occluders(rig: Rig, path: Path | None) -> Rig:
    """The rig among the things of a file, if one is given."""
    return rig if path is None else replace(rig, occluders=read_occluders(path))
