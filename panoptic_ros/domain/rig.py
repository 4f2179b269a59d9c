"""Cameras and depth sensors of a capture."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from panoptic_ros.domain.camera import Camera
from panoptic_ros.domain.depth_sensor import DepthSensor
from panoptic_ros.domain.occluders import Occluders
from panoptic_ros.domain.upright import Z_UP, Direction, direction
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import ProjectionStack


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """Cameras with distinct names, in a fixed order, in the world frame `frame_id` (z up, metres).

    Readers of rig files require cameras. A rig without cameras (`NO_CAMERAS`) is for bodies solved from IMUs
    alone.

    Args:
        occluders: Fixed objects that hide people from cameras, None = none are known.
        depth_sensors: Sensors with maps of their own, in a fixed order. A camera whose depth is registered to
            its images needs no entry.
        left_out: Reason why each camera of the file is not in the rig, by its name; "" = it was not chosen.
        notices: One line each about missing entries of the file and assumed values.
        up: Direction of the world that points up, of any length; None: no file states it. Detection rotates
            images by it. Everything else assumes that +z is up.

    Raises:
        CalibrationError: if two cameras or sensors share a name, a sensor's colour camera is missing, or the
            up direction is invalid.
    """

    cameras: tuple[Camera, ...]
    frame_id: str = "world"
    occluders: Occluders | None = None
    depth_sensors: tuple[DepthSensor, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)
    notices: tuple[str, ...] = ()
    up: Direction | None = Z_UP

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(self.cameras))
        object.__setattr__(self, "depth_sensors", tuple(self.depth_sensors))
        if self.up is not None:
            object.__setattr__(self, "up", direction(self.up))
        self._check_names()
        for sensor in self.depth_sensors:
            if sensor.colour_camera and sensor.colour_camera not in self.names:
                raise CalibrationError(
                    f"depth sensor {sensor.name}: the rig has no colour camera {sensor.colour_camera!r}; "
                    f"it has {', '.join(self.names)}"
                )

    def _check_names(self) -> None:
        """Check that all names of cameras and sensors differ: both name topics and folders.

        Raises:
            CalibrationError: if a name repeats.
        """
        counts = Counter(self.names)
        for name, count in counts.items():
            if count > 1:
                raise CalibrationError(f"{count} cameras of the rig are called {name!r}; names must differ")
        counts.update(sensor.name for sensor in self.depth_sensors)
        for name, count in counts.items():
            if count > 1:
                raise CalibrationError(
                    f"{count} cameras and depth sensors of the rig are called {name!r}; names must differ"
                )

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the cameras, in order."""
        return tuple(camera.name for camera in self.cameras)

    def __len__(self) -> int:
        return len(self.cameras)

    def index(self, name: str) -> int:
        """Return the index of a camera.

        Raises:
            CalibrationError: if the rig has no camera of that name.
        """
        for i, camera in enumerate(self.cameras):
            if camera.name == name:
                return i
        if reason := self.left_out.get(name):
            raise CalibrationError(f"camera {name} of the rig cannot be used: {reason}")
        raise CalibrationError(f"the rig has no camera {name!r}; it has {', '.join(self.names)}")

    def camera(self, name: str) -> Camera:
        """Return the camera of that name; see `index`."""
        return self.cameras[self.index(name)]

    def depth_sensor(self, name: str) -> DepthSensor:
        """Return the depth sensor of that name.

        Raises:
            CalibrationError: if the rig has no sensor of that name.
        """
        for sensor in self.depth_sensors:
            if sensor.name == name:
                return sensor
        there = ", ".join(sensor.name for sensor in self.depth_sensors) or "none"
        raise CalibrationError(f"the rig has no depth sensor {name!r}; it has {there}")

    def clock_of(self, owner: str) -> str:
        """Return the name of the clock that stamps the data of a camera or depth sensor, "" = the common one.

        For any other device it returns `owner`: such a device has its own clock.
        """
        for camera in (*self.cameras, *(sensor.camera for sensor in self.depth_sensors)):
            if camera.name == owner:
                return camera.clock
        return owner

    def subset(self, names: Iterable[str]) -> Rig:
        """Return a rig of some of the cameras, in the order of this rig.

        Depth sensors stay, because they measure without any camera. A sensor whose colour camera is left out
        then has none.

        Raises:
            CalibrationError: if `names` is empty or holds an unknown name.
        """
        wanted = {self.index(name) for name in names}
        if not wanted:
            raise CalibrationError("a rig without cameras")
        cameras = tuple(self.cameras[i] for i in sorted(wanted))
        kept = {camera.name for camera in cameras}
        sensors = tuple(
            sensor if sensor.colour_camera in kept else replace(sensor, colour_camera="")
            for sensor in self.depth_sensors
        )
        return replace(self, cameras=cameras, depth_sensors=sensors)

    def stack(self) -> ProjectionStack:
        """Return the rotations, translations and focal lengths of all cameras as arrays."""
        return ProjectionStack(
            np.stack([c.cam_from_world.rotation for c in self.cameras]),
            np.stack([c.cam_from_world.translation for c in self.cameras]),
            np.array([0.5 * np.trace(c.intrinsics.matrix[:2, :2]) for c in self.cameras]),
        )


def lines_of(told: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """Return lines about cameras, one for all cameras with the same text.

    Args:
        told: Pairs of a camera name and a text. Empty texts are left out.
    """
    names: dict[str, list[str]] = {}
    for name, text in told:
        names.setdefault(text, []).append(name)
    return tuple(
        f"{'camera' if len(own) == 1 else 'cameras'} {', '.join(own)}: {text}"
        for text, own in names.items()
        if text
    )


NO_CAMERAS = Rig(())
