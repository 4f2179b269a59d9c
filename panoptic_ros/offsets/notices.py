"""Notices about clocks while they are found, each once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.offsets.clocks import CameraClocks
from panoptic_ros.stage import Notice

Array = np.ndarray
PATIENCE_S = 10.0  # after which clocks that are still not known are reported


class ClockNotices:
    """Says which cameras are corrected and by how much, which clocks have jumped, and which stay unknown."""

    def __init__(self, cameras: Sequence[str]):
        self._cameras = tuple(cameras)
        self._told: set[str] = set()  # cameras whose correction was reported
        self._passed = 0.0  # s
        self._missed = False  # whether the unknown ones were reported

    def of(self, clocks: CameraClocks, jumps: Array, seconds: float) -> tuple[Notice, ...]:
        """The notices of one block.

        Args:
            jumps: (C,) s, how far clocks jumped in it. seconds: how long it was.
        """
        self._passed += seconds
        jumped = [_jump(name, float(jump)) for name, jump in zip(self._cameras, jumps) if jump]
        self._told -= {str(notice.values["camera"]) for notice in jumped}
        settled = clocks.applied & clocks.known & (jumps == 0.0)
        return (*jumped, *self._corrected(clocks, settled), *self._unknown(clocks))

    def _corrected(self, clocks: CameraClocks, settled: Array) -> tuple[Notice, ...]:
        new = [c for c in np.flatnonzero(settled) if self._cameras[c] not in self._told]
        if not new:
            return ()
        self._told |= {self._cameras[c] for c in new}
        text = ", ".join(
            f"{self._cameras[c]} {1e3 * clocks.offsets[c]:+.1f} ms +- {1e3 * clocks.deviations[c]:.1f}"
            for c in new
        )
        return (Notice("offsets.corrected", "info", f"stamps are corrected from motion: {text}"),)

    def _unknown(self, clocks: CameraClocks) -> tuple[Notice, ...]:
        if self._missed or self._passed < PATIENCE_S:
            return ()
        self._missed = True
        if clocks.known.all():
            return ()
        names = ", ".join(name for name, known in zip(self._cameras, clocks.known) if not known)
        text = (
            f"after {self._passed:.0f} s the clocks of {names} are not known: too little moves in their "
            "views. Their stamps are kept; let somebody walk about there"
        )
        return (Notice("offsets.unknown", "warning", text, {"cameras": names}),)


def _jump(name: str, jump: float) -> Notice:
    text = (
        f"the clock of camera {name} has jumped by about {-1e3 * jump:+.0f} ms against the others; it is "
        "found anew from motion"
    )
    return Notice("offsets.jump", "warning", text, {"camera": name, "jump_s": -jump})
