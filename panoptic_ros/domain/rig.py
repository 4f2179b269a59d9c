"""The cameras of a capture."""
from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain.camera import Camera
from panoptic_ros.domain.occluders import Occluders
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import ProjectionStack


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """Cameras with different names, in a fixed order, in the world frame `frame_id` (z up, metres).

    Args:
        occluders: fixed things between which the cameras look, None = none are known.

    Raises:
        CalibrationError: without cameras, or with two of one name.
    """

    cameras: tuple[Camera, ...]
    frame_id: str = "world"
    occluders: Occluders | None = None

    def __post_init__(self) -> None:
        cameras = tuple(self.cameras)
        if not cameras:
            raise CalibrationError("a rig without cameras")
        names = [camera.name for camera in cameras]
        for name in names:
            if names.count(name) > 1:
                raise CalibrationError(
                    f"{names.count(name)} cameras of the rig are called {name!r}; names must differ"
                )
        object.__setattr__(self, "cameras", cameras)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the cameras, in order."""
        return tuple(camera.name for camera in self.cameras)

    def __len__(self) -> int:
        return len(self.cameras)

    def index(self, name: str) -> int:
        """Index of a camera.

        Raises:
            CalibrationError: if the rig has none of that name.
        """
        for i, camera in enumerate(self.cameras):
            if camera.name == name:
                return i
        raise CalibrationError(f"the rig has no camera {name!r}; it has {', '.join(self.names)}")

    def camera(self, name: str) -> Camera:
        """The camera of that name; see `index`."""
        return self.cameras[self.index(name)]

    def subset(self, names: Iterable[str]) -> Rig:
        """A rig of some of the cameras, in the order of this rig."""
        wanted = {self.index(name) for name in names}
        return replace(self, cameras=tuple(self.cameras[i] for i in sorted(wanted)))

    def stack(self) -> ProjectionStack:
        """All cameras as arrays."""
        return ProjectionStack(
            np.stack([c.cam_from_world.rotation for c in self.cameras]),
            np.stack([c.cam_from_world.translation for c in self.cameras]),
            np.array([0.5 * np.trace(c.intrinsics.matrix[:2, :2]) for c in self.cameras]),
        )
