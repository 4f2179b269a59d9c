"""Options of the rig readers, and the selection of a file's cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.domain.rig import lines_of
from panoptic_ros.errors import CalibrationError, UsageError, shown
from panoptic_ros.io.rigs.fields import METRES, UncalibratedCamera, listing

FAR_APART = 200.0  # m between cameras of one rig; a larger span means that the unit is another one


@dataclass(frozen=True)
class ReadOptions:
    """Options of a rig reader, see `read_rig`.

    Raises:
        UsageError: for an unknown unit.
    """

    unit: str | None = None
    types: tuple[str, ...] = ()
    panels: tuple[int, ...] = ()
    cameras: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if self.unit is not None and self.unit not in METRES:
            raise UsageError(f"unknown unit of length {shown(self.unit)}; units are {', '.join(METRES)}")

    def given(self) -> set[str]:
        """Return the given options among those that only some formats support."""
        return {name for name in ("unit", "types", "panels") if getattr(self, name)}

    def wants(self, item: Any) -> bool:
        """Return whether a camera of a JSON list has a selected type and panel.

        The result is also True for an entry that is not a mapping, and if no type or panel is selected.
        """
        if not isinstance(item, Mapping):
            return True
        right_type = not self.types or item.get("type") in self.types
        return right_type and (not self.panels or str(item.get("panel")) in map(str, self.panels))


class ReadCameras:
    """Cameras read from a file: only those that are selected and usable."""

    def __init__(self, options: ReadOptions):
        self._chosen = options.cameras
        self._cameras: list[Camera] = []
        self._left_out: dict[str, str] = {}
        self._told: list[tuple[str, str]] = []

    def take(self, name: str, make: Callable[[], Camera]) -> None:
        """Add a camera, unless it is not selected or `make` raises `UncalibratedCamera`."""
        if self._chosen is not None and name not in self._chosen:
            self._left_out[name] = ""
            return
        try:
            self._cameras.append(make())
        except UncalibratedCamera as error:
            self._left_out[name] = str(error)

    def tell(self, name: str, text: str) -> None:
        """Add a notice about a camera."""
        self._told.append((name, text))

    def rig(self, frame_id: str = "world") -> Rig:
        """Return the rig.

        Raises:
            CalibrationError: if no camera is usable, or a selected camera is unusable or missing.
        """
        self._check_chosen()
        if not self._cameras:
            raise CalibrationError("; ".join(["no camera can be used", *lines_of(self._left_out.items())]))
        left_out = [(name, f"left out: {why}") for name, why in self._left_out.items() if why]
        return Rig(
            tuple(self._cameras),
            frame_id,
            left_out=self._left_out,
            notices=lines_of([*left_out, *self._told]),
        )

    def _check_chosen(self) -> None:
        names = [camera.name for camera in self._cameras]
        for name in self._chosen or ():
            if self._left_out.get(name):
                raise CalibrationError(f"camera {name} cannot be used: {self._left_out[name]}")
            if name not in names:
                there = ", ".join([*names, *self._left_out])
                raise CalibrationError(f"the rig has no camera {name!r}; it has {there}")


def chosen_cameras(document: Any, options: ReadOptions) -> list[tuple[int, Any]]:
    """Return the cameras of a JSON document with a selected type and panel, with their indices.

    Raises:
        CalibrationError: if it has no list of cameras.
        UsageError: if the selection leaves no camera; it names the existing types.
    """
    items = listing(document, "cameras", "the file")
    chosen = [(k, item) for k, item in enumerate(items) if options.wants(item)]
    if chosen:
        return chosen
    types = sorted({str(item.get("type")) for item in items if isinstance(item, Mapping)})
    raise UsageError(f"no camera is of types {options.types} and panels {options.panels}; there are {types}")


def check_unit(rig: Rig, options: ReadOptions) -> Rig:
    """Check that a rig without a stated unit can be in metres, and return it.

    Raises:
        CalibrationError: if its cameras are more than FAR_APART apart.
    """
    centres = np.stack([camera.centre for camera in rig.cameras])
    span = float(np.ptp(centres, axis=0).max())
    if options.unit is None and span > FAR_APART:
        raise CalibrationError(
            f"the cameras lie {span:.0f} m apart; the file does not state its unit of length and is "
            "probably in mm: `panoptic rig convert --unit mm IN OUT` makes a rig in metres"
        )
    return rig
