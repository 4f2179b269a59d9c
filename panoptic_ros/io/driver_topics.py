"""Read the YAML file of `panoptic run --topics`: the topics of running camera drivers, by camera.

left:
  image: /zed/left/image_raw               # or .../compressed
  camera_info: /zed/left/camera_info       # optional; default if rectified: the topic beside the image
  depth: /zed/depth/image_raw              # optional, registered to the image; or .../compressedDepth
  encoding: bayer_rggb8                    # optional: overrides the encoding in the driver's images
kinect3:                                   # a depth sensor without images, on its own clock
  depth: /kinect3/depth/image_raw
  camera_info: /kinect3/depth/camera_info
fixed_frame: map                           # optional, without --rig: the TF frame that is the world frame
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

from panoptic_ros.errors import DataError, nearest, shown
from panoptic_ros.io.documents import read_yaml


@dataclass(frozen=True)
class DriverTopics:
    """Topics of one camera, or of a depth sensor without images; "" = none."""

    image: str = ""
    camera_info: str = ""
    depth: str = ""
    encoding: str = ""

    @property
    def named(self) -> Mapping[str, str]:
        """Return the topics that are given, by key."""
        keys = ("image", "camera_info", "depth")
        return {key: getattr(self, key) for key in keys if getattr(self, key)}


@dataclass(frozen=True)
class DriverFile:
    """Content of a driver topics file, in the order of the file.

    Args:
        cameras: topics by camera name.
        sensors: topics of depth sensors without images, by name.
        fixed_frame: TF frame; "" = not given.
    """

    cameras: Mapping[str, DriverTopics]
    sensors: Mapping[str, DriverTopics]
    fixed_frame: str = ""

    @property
    def everything(self) -> Mapping[str, DriverTopics]:
        """Return the cameras, followed by the sensors."""
        return {**self.cameras, **self.sensors}


def read_driver_topics(path: Path) -> DriverFile:
    """Read the topics of every camera and depth sensor.

    Raises:
        DataError: naming the file, the camera and the key.
    """
    document = read_yaml(path)
    if not isinstance(document, Mapping) or not document:
        raise DataError(f"{path}: expected a table of cameras, e.g. left: {{image: /left/image_raw}}")
    document = dict(document)
    fixed = document.pop("fixed_frame", "")
    if not isinstance(fixed, str):
        raise DataError(f"{path}: fixed_frame is {shown(fixed)}, expected the name of a frame")
    found = {str(camera): _topics(path, str(camera), entry) for camera, entry in document.items()}
    cameras = {name: topics for name, topics in found.items() if topics.image}
    sensors = {name: topics for name, topics in found.items() if not topics.image}
    for key, group in (("image", cameras), ("depth", sensors)):
        owners: dict[str, str] = {}
        for name, topics in group.items():
            topic = topics.named[key]
            other = owners.setdefault(topic, name)
            if other != name:
                raise DataError(f"{path}: {other} and {name} have the same {key} {topic}")
    return DriverFile(cameras, sensors, fixed)


def _topics(path: Path, camera: str, entry: object) -> DriverTopics:
    known = [field.name for field in fields(DriverTopics)]
    if not isinstance(entry, Mapping) or not {"image", "depth"} & set(entry):
        raise DataError(
            f"{path}: camera {camera} has no 'image', the topic of its images (a depth sensor alone: 'depth' "
            "and 'camera_info')"
        )
    for key, value in entry.items():
        if key not in known:
            raise DataError(f"{path}: camera {camera} has an unknown key {shown(key)}; {nearest(key, known)}")
        if not isinstance(value, str) or not value:
            raise DataError(f"{path}: camera {camera}: {key} is {shown(value)}, expected a name")
        if key != "encoding" and not value.startswith("/"):
            said = f"{key} is {shown(value)}"
            raise DataError(f"{path}: camera {camera}: {said}; write the whole name, /{value[:40]}")
    if "image" not in entry and "encoding" in entry:
        raise DataError(f"{path}: depth sensor {camera} has an encoding, which is one of images")
    return DriverTopics(**{str(key): str(value) for key, value in entry.items()})
