"""Read segment skeletons and body shapes (segment radii), installed or from files."""

from __future__ import annotations

from pathlib import Path

from panoptic_ros.domain.body_shape import BodyShape, read_shape
from panoptic_ros.domain.segments import SegmentModel, read_model
from panoptic_ros.errors import DataError
from panoptic_ros.io.documents import read_yaml
from panoptic_ros.io.known_keys import EACH, keys, tell_unknown
from panoptic_ros.io.loading import parsing
from panoptic_ros.io.resources import share_folder

DEFAULT_MODEL = "segments21"
DEFAULT_SHAPE = "shape21"
MODEL_KEYS = keys(
    "name ground",
    segments={EACH: keys("parent joint offset limits_deg order hinge")},
    keypoints={EACH: keys("segment offset")},
)
SHAPE_KEYS = {EACH: [keys("from to radii wide")]}


def read_body_model(name: str = DEFAULT_MODEL) -> SegmentModel:
    """Read a segment skeleton by the name of an installed one or the path of a YAML file.

    Raises:
        DataError: if the file does not exist or does not follow the format.
    """
    path = Path(name)
    if path.suffix not in (".yaml", ".yml"):
        path = share_folder() / "config" / "bodies" / f"{name}.yaml"
    document = read_yaml(path)
    if not isinstance(document, dict):
        raise DataError(f"{path} is not a skeleton of segments")
    tell_unknown(document, MODEL_KEYS, path)
    with parsing(path):
        try:
            return read_model(document)
        except DataError as error:
            raise DataError(f"{path}: {error}") from None


def read_body_shape(model: SegmentModel, name: str = DEFAULT_SHAPE) -> BodyShape:
    """Read an installed body shape: the radii of the segments.

    Raises:
        DataError: if it cannot be read.
    """
    path = share_folder() / "config" / "bodies" / f"{name}.yaml"
    document = read_yaml(path)
    if not isinstance(document, dict):
        raise DataError(f"{path} is not a shape of a body")
    tell_unknown(document, SHAPE_KEYS, path)
    with parsing(path):
        return read_shape(document, model)
