"""Who wears which device, and what everybody's devices measured at an instant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from panoptic_ros.domain.subjects import Subject
from panoptic_ros.kinematics.imus.measured import Measured
from panoptic_ros.kinematics.imus.streams import ImuStreams

Array = np.ndarray
NO_ROWS = np.zeros(0, np.int64)


class Wearers:
    """Of the designated people."""

    def __init__(self, subjects: Sequence[Subject]):
        self.devices = tuple(dict.fromkeys(d.name for s in subjects for d in s.devices))
        self._who = {d.name: s.id for s in reversed(subjects) for d in s.devices}
        rows = {name: d for d, name in enumerate(self.devices)}
        self._rows = {s.id: np.array([rows[d.name] for d in s.devices], np.int64) for s in subjects}

    def of(self, device: str) -> int | None:
        """The id of who wears a device."""
        return self._who.get(device)

    def measured(self, streams: ImuStreams, stamp_ns: int, offsets: Mapping[int, int]) -> dict[int, Measured]:
        """What everybody's devices measured at an instant, in the order of the subject.

        Args:
            streams: of `devices`. offsets: of the clock of everybody's devices, ns, by id.
        """
        found = {offset: streams.at(stamp_ns - offset) for offset in set(offsets.values())}
        return {
            number: found[offset].rows(self._rows.get(number, NO_ROWS)) for number, offset in offsets.items()
        }
