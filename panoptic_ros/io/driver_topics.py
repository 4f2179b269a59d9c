"""Which topics of running drivers are whose: a YAML file for `panoptic run --topics`.

    left:
      image: /zed/left/image_raw               # or .../compressed
      camera_info: /zed/left/camera_info       # optional; of rectified images beside the image unless named
      depth: /zed/depth/image_raw              # optional, registered to the image; or .../compressedDepth
      encoding: bayer_rggb8                    # optional: in place of what the driver's images say
"""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

from panoptic_ros.errors import DataError
from panoptic_ros.io.files import read_yaml


@dataclass(frozen=True)
class DriverTopics:
    """The topics of one camera; "" = none."""

    image: str
    camera_info: str = ""
    depth: str = ""
    encoding: str = ""

    @property
    def named(self) -> Mapping[str, str]:
        """The topics that are named, by key."""
        keys = ("image", "camera_info", "depth")
        return {key: getattr(self, key) for key in keys if getattr(self, key)}


def read_driver_topics(path: Path) -> Mapping[str, DriverTopics]:
    """The topics by camera, in the order of the file.

    Raises:
        DataError: naming the file, the camera and the key.
    """
    document = read_yaml(path)
    if not isinstance(document, Mapping) or not document:
        raise DataError(f"{path}: expected a table of cameras, e.g. left: {{image: /left/image_raw}}")
    found = {str(camera): _topics(path, str(camera), entry) for camera, entry in document.items()}
    owners: dict[str, str] = {}
    for camera, topics in found.items():
        other = owners.setdefault(topics.image, camera)
        if other != camera:
            raise DataError(f"{path}: cameras {other} and {camera} have the same image {topics.image}")
    return found


def _topics(path: Path, camera: str, entry: object) -> DriverTopics:
    known = [field.name for field in fields(DriverTopics)]
    if not isinstance(entry, Mapping) or "image" not in entry:
        raise DataError(f"{path}: camera {camera} has no 'image', the topic of its images")
    for key, value in entry.items():
        if key not in known:
            raise DataError(f"{path}: camera {camera} has an unknown key {key!r}; known: {', '.join(known)}")
        if not isinstance(value, str) or not value:
            raise DataError(f"{path}: camera {camera}: {key} is {value!r}, expected a name")
        if key != "encoding" and not value.startswith("/"):
            raise DataError(f"{path}: camera {camera}: {key} is {value!r}; write the whole name, /{value}")
    return DriverTopics(**{str(key): str(value) for key, value in entry.items()})
