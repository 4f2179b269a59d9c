"""Reads the parameters and occluders that a user gives."""

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

ROS = "ros__parameters"  # key of ROS files above the parameters of a node
Parameters = dict[str, dict[str, Any]]  # {stage: {parameter: value}}


def read_parameters(
    file: Path | None, settings: Sequence[str], preset: Parameters | None = None
) -> Parameters:
    """Return the parameters that the user gave.

    Settings take precedence over the file, and the file over the preset.

    Args:
        file: YAML file with {stage: {parameter: value}}, or a ROS parameter file.
        settings: texts of the form stage.name=value.
        preset: parameters of a preset, see `running.plans.presets`.

    Raises:
        ConfigError: on unknown parameters and invalid values.
    """
    values = merged(preset or {}, {} if file is None else parameters_of(read_yaml(file), file))
    for text in settings:
        stage, name, value = parse_setting(text)
        values.setdefault(stage, {})[name] = value
    configure(values)  # reports mistakes before anything starts
    return values


def parameters_of(document: Any, file: Path, others: Sequence[str] = ()) -> Parameters:
    """Return the parameters in the document of a file.

    Args:
        file: path, for messages.
        others: valid keys other than stages, for messages.

    Raises:
        ConfigError: if the document has another form.
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
    """Return the parameters of a stage.

    In a ROS parameter file, such as config/*.yaml, they are one level deeper.
    """
    if ROS not in entries:
        return entries
    beside = [key for key in entries if key != ROS]
    if beside or not isinstance(entries[ROS], dict):
        odd = f"{shown(beside[0])} stands beside it" if beside else f"it is {shown(entries[ROS])}"
        raise ConfigError(f"{where}: all parameters belong below {ROS}, as names and values; {odd}")
    inner: dict[str, Any] = entries[ROS]
    return inner


def with_defaults(given: Parameters, defaults: Parameters) -> dict[str, Config]:
    """Return configurations that use `defaults` only for parameters that the user did not give."""
    return configure(merged(defaults, given))


def live_parameters(rate: float = 30.0, cameras: int = 1) -> Parameters:
    """Return default parameters for a live run.

    Args:
        rate: frame rate of the cameras, Hz.
        cameras: number of cameras.
    """
    return {
        # three frame periods: detection processes the cameras in turn, some of them in parallel
        "sync": {"deadline_s": max(LIVE_DEFAULTS["sync"]["deadline_s"], 3.0 / rate)},
        "detection": {"threads": max(1, free_threads(1) // max(cameras, 1))},
        "refinement": {"lag": min(LIVE_DEFAULTS["refinement"]["lag"], 0.9 / rate)},
    }


def with_occluders(rig: Rig, path: Path | None) -> Rig:
    """Return the rig with the occluders of a file, if a file is given."""
    return rig if path is None else replace(rig, occluders=read_occluders(path))
