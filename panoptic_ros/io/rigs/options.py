"""What a reader may be told besides the file."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.errors import CalibrationError, UsageError, shown
from panoptic_ros.io.rigs.fields import METRES

FAR_APART = 200.0  # m between cameras of one rig; beyond, the unit is surely another


@dataclass(frozen=True)
class ReadOptions:
    """See `read_rig`.

    Raises:
        UsageError: for an unknown unit.
    """

    unit: str | None = None
    types: tuple[str, ...] = ()
    panels: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if self.unit is not None and self.unit not in METRES:
            raise UsageError(f"unknown unit of length {shown(self.unit)}; units are {', '.join(METRES)}")

    def given(self) -> set[str]:
        """The options that differ from their defaults."""
        return {name for name in ("unit", "types", "panels") if getattr(self, name)}

    def wants(self, item: Any) -> bool:
        """Whether a camera of a JSON list is of a wanted type and panel."""
        if not isinstance(item, Mapping):
            return True
        right_type = not self.types or item.get("type") in self.types
        return right_type and (not self.panels or str(item.get("panel")) in map(str, self.panels))


def check_selection(items: list[Any], kept: list[Any], options: ReadOptions) -> None:
    """A selection that leaves nothing is a mistake.

    Raises:
        UsageError: naming the types that there are.
    """
    if kept:
        return
    types = sorted({str(item.get("type")) for item in items if isinstance(item, Mapping)})
    raise UsageError(f"no camera is of types {options.types} and panels {options.panels}; there are {types}")


def check_unit(rig: Rig, options: ReadOptions) -> Rig:
    """The rig, if the metres of a file that states no unit can be metres.

    Raises:
        CalibrationError: if its cameras lie too far apart.
    """
    centres = np.stack([camera.centre for camera in rig.cameras])
    span = float(np.ptp(centres, axis=0).max())
    if options.unit is None and span > FAR_APART:
        raise CalibrationError(
            f"the cameras lie {span:.0f} m apart; the file does not say its unit of length and is "
            "probably in mm: `panoptic rig convert --unit mm IN OUT` makes a rig in metres"
        )
    return rig
