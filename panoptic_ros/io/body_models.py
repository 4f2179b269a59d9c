"""Skeletons of segments that are installed, or in files, and how thick bodies are."""

from __future__ import annotations

from pathlib import Path

from panoptic_ros.domain.body_shape import BodyShape, read_shape
from panoptic_ros.domain.segments import SegmentModel, read_model
from panoptic_ros.errors import DataError
from panoptic_ros.io.files import read_yaml
from panoptic_ros.io.resources import share_folder

DEFAULT_MODEL = "segments21"
DEFAULT_SHAPE = "shape21"


def read_body_model(name: str = DEFAULT_MODEL) -> SegmentModel:
    """A skeleton of segments by the name of an installed one or the path of a YAML file.

    Raises:
        DataError: if there is none, or it is not as it must be.
    """
    path = Path(name)
    if path.suffix not in (".yaml", ".yml"):
        path = share_folder() / "config" / "bodies" / f"{name}.yaml"
    document = read_yaml(path)
    if not isinstance(document, dict):
        raise DataError(f"{path} is no skeleton of segments")
    return read_model(document)


def read_body_shape(model: SegmentModel, name: str = DEFAULT_SHAPE) -> BodyShape:
    """How thick bodies are, as installed.

    Raises:
        DataError: if it cannot be read.
    """
    path = share_folder() / "config" / "bodies" / f"{name}.yaml"
    document = read_yaml(path)
    if not isinstance(document, dict):
        raise DataError(f"{path} is no shape of a body")
    return read_shape(document, model)
