"""Reads presets: files of parameters that belong together, in config/presets or elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from panoptic_ros.errors import ConfigError, shown
from panoptic_ros.graph.build import configure
from panoptic_ros.io.documents import read_yaml
from panoptic_ros.io.resources import share_folder
from panoptic_ros.io.skeletons import load_skeleton
from panoptic_ros.running.plans.parameters import Parameters, parameters_of

SUFFIXES = (".yaml", ".yml")


@dataclass(frozen=True)
class Preset:
    """Content of a preset.

    Args:
        name: stem of its file.
        skeleton: working skeleton; "" = not given.
        parameters: {stage: {parameter: value}}.
    """

    name: str = ""
    skeleton: str = ""
    parameters: Parameters = field(default_factory=dict)


NO_PRESET = Preset()


def preset_names() -> tuple[str, ...]:
    """Return the names of the installed presets."""
    return tuple(sorted(path.stem for path in _folder().glob("*.yaml")))


def read_preset(name_or_path: str | None) -> Preset:
    """Return a preset by its name, or from a YAML file of the user; None or "" gives `NO_PRESET`.

    Raises:
        ConfigError: if there is no such preset, or it contains anything except parameters and a skeleton.
    """
    if not name_or_path:
        return NO_PRESET
    if name_or_path.endswith(SUFFIXES):
        path = Path(name_or_path)
    elif name_or_path in preset_names():
        path = _folder() / f"{name_or_path}.yaml"
    else:
        raise ConfigError(
            f"there is no preset {shown(name_or_path)}; there are {', '.join(preset_names())}, "
            "or name a YAML file"
        )
    document = read_yaml(path)
    skeleton = document.pop("skeleton", "") if isinstance(document, dict) else ""
    preset = Preset(path.stem, str(skeleton), parameters_of(document, path, ("skeleton",)))
    configure(preset.parameters)  # reports mistakes before anything starts
    if preset.skeleton:
        load_skeleton(preset.skeleton)
    return preset


def _folder() -> Path:
    return share_folder() / "config" / "presets"
