"""Generates the repository files that are derived from the parameters of the stages."""

from __future__ import annotations

from panoptic_ros.graph.build import config_class
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.io.parameter_files import parameter_page, parameter_yaml

STAGES = tuple(NODES)


def generated_files() -> dict[str, str]:
    """Return the content of every generated file by its path in the repository."""
    classes = {name: config_class(name) for name in STAGES}
    files = {f"config/{name}.yaml": parameter_yaml(name, cls) for name, cls in classes.items()}
    files["docs/parameters.md"] = parameter_page(classes)
    return files
