"""When a camera looks, and whether at all of its image.

Looks are spread over the rig by stamps: camera i of N looks when its stamps pass (m - i / N) / looks_per_s, m
being whole numbers. So the cameras of one trigger look in turn. Small whole images go round the rig for
newcomers; somebody whom nobody explains makes all cameras look at whole images.
Live, an `Allowance` bounds how much is looked at with every instant.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from panoptic_ros.detection.allowance import Allowance

Array = np.ndarray
SECOND = 10**9
LONGEST_GAP_NS = 150_000_000  # between two images, over which nobody is carried
SCANS_PER_S = 12  # small whole images, of all cameras together
WHOLE_IMAGES = 2  # of every camera after an alarm
WHOLE_IMAGES_LIVE = 1  # the same where looks are not allowed without end
QUIET_LIVE_NS = SECOND  # there, after an alarm: its whole images come first
FIRST_WAIT_NS = SECOND // 2  # until the same stranger raises another alarm; doubles each time
LONGEST_WAIT_NS = 32 * SECOND
MOST_VAIN = 4  # closer looks after which the wait, 2, 4, ... 16 looks, grows no more
SAME_PLACE = 0.3  # intersection over union of the boxes of a stranger who has not moved


class Look(Enum):
    """What is done with an image."""

    WHOLE = "whole"
    REGIONS = "regions"
    CARRY = "carry"


@dataclass
class CameraLooks:
    """What is known of one camera's looks.

    Args:
        last_ns: stamp of its newest image. answered_ns: of the alarm that it answers; left: whole images
            that it still looks at for it. whole_ns: stamp of the newest of these.
        vain: closer looks one after the other that showed nobody else. wait: looks until the next closer one.
    """

    last_ns: int
    answered_ns: int = -1
    left: int = 0
    whole_ns: int = -1
    vain: int = 0
    wait: int = 0

    def closer(self) -> bool:
        """Whether it may look more closely now; call it once where it should."""
        self.wait = max(self.wait - 1, 0)
        return self.wait == 0

    def looked_closer(self, others: bool) -> None:
        """A closer look showed others, or nobody else: then the next one waits, longer each time."""
        self.vain = 0 if others else min(self.vain + 1, MOST_VAIN)
        self.wait = 0 if others else 2**self.vain


@dataclass
class Ignored:
    """A stranger who raised an alarm: box (4,) px of a camera, until when nobody minds, and for how long."""

    camera: str
    box: Array
    until_ns: int
    wait_ns: int


@dataclass
class Lookout:
    """Decides for every image of every camera, by stamps alone.

    Args:
        names: of the cameras, in the order of the rig.
        looks_per_s: of each camera; 0 = at every image.
        guided: whether regions are looked at, where anybody is known.
        allowance: of looks; None: as many as are due.
    """

    names: tuple[str, ...]
    looks_per_s: float
    guided: bool
    allowance: Allowance | None = None
    cameras: dict[str, CameraLooks] = field(default_factory=dict)
    alarm_ns: int = -1
    ignored: list[Ignored] = field(default_factory=list)
    _raising: threading.Lock = field(default_factory=threading.Lock, repr=False, compare=False)

    def reset(self) -> None:
        """Forget all cameras and strangers."""
        self.cameras.clear()
        self.alarm_ns, self.ignored = -1, []

    def look(self, camera: str, stamp_ns: int, nobody: bool, door: bool = False) -> tuple[Look, bool]:
        """What to do with an image, and whether to scan it for newcomers besides; call it once for each.

        Args:
            nobody: whether nobody is known. door: whether newcomers are likely; it is scanned twice as often,
                unless looks are few.
        """
        known = self.cameras.get(camera)
        step = stamp_ns - known.last_ns if known is not None else -1
        if known is None or not 0 < step <= LONGEST_GAP_NS:
            self.cameras[camera] = known = CameraLooks(stamp_ns, self.alarm_ns)
            return (Look.REGIONS if self.guided and not nobody else Look.WHOLE), False
        before, known.last_ns = known.last_ns, stamp_ns
        if self.alarm_ns > known.answered_ns and stamp_ns > self.alarm_ns:
            known.answered_ns, known.left = self.alarm_ns, self._whole_images
        if known.left:
            known.left, known.whole_ns = known.left - 1, stamp_ns
            return Look.WHOLE, False
        place = self.names.index(camera)
        due = not self.looks_per_s or self._phase(place, stamp_ns) != self._phase(place, before)
        if self.guided and not nobody:
            return (Look.REGIONS if due else Look.CARRY), self._scans(place, before, stamp_ns, door)
        return (Look.WHOLE if due else Look.CARRY), False

    def allowed(self, camera: str, stamp_ns: int, number: int, wish: Look) -> Look:
        """What may be done with an image, where `wish` should be: what is put off is made up for later.

        Args:
            number: of the frame.
        """
        if self.allowance is None:
            return wish
        if self.allowance.takes(camera, stamp_ns, number, self.looks_per_s, wish is not Look.CARRY):
            return Look.REGIONS if wish is Look.CARRY else wish
        known = self.cameras[camera]
        if wish is Look.WHOLE and known.whole_ns == stamp_ns:
            known.left += 1
        return Look.CARRY

    def raise_alarm(self, camera: str, boxes: Array, stamp_ns: int) -> bool:
        """All cameras shall look at whole images, for strangers with boxes (N, 4) px in one of them. May be
        called for several cameras at a time.

        Returns:
            whether anybody is heard: the same stranger at the same place is not, for longer each time; nor is
            somebody in an image that answers an alarm.
        """
        with self._raising:
            return self._raise_alarm(camera, boxes, stamp_ns)

    @property
    def _whole_images(self) -> int:
        return WHOLE_IMAGES if self.allowance is None else WHOLE_IMAGES_LIVE

    def _raise_alarm(self, camera: str, boxes: Array, stamp_ns: int) -> bool:
        if self.allowance is not None and 0 <= self.alarm_ns and stamp_ns < self.alarm_ns + QUIET_LIVE_NS:
            return False
        self.ignored = [entry for entry in self.ignored if entry.until_ns + entry.wait_ns > stamp_ns]
        heard = False
        for box in boxes:
            before = next(
                (
                    entry
                    for entry in self.ignored
                    if entry.camera == camera and _overlap(entry.box, box) > SAME_PLACE
                ),
                None,
            )
            if before is None:
                self.ignored.append(Ignored(camera, np.array(box), stamp_ns + FIRST_WAIT_NS, FIRST_WAIT_NS))
                heard = True
            elif before.until_ns <= stamp_ns:
                before.wait_ns = min(2 * before.wait_ns, LONGEST_WAIT_NS)
                before.until_ns, before.box = stamp_ns + before.wait_ns, np.array(box)
                heard = True
        known = self.cameras.get(camera)
        heard = heard and not (known is not None and known.whole_ns == stamp_ns)
        if heard:
            self.alarm_ns = max(self.alarm_ns, stamp_ns)
        return heard

    def _phase(self, place: int, stamp_ns: int) -> int:
        """How many looks a camera has had since stamp 0; whole numbers, so that nothing is rounded."""
        rate, count = round(1000 * self.looks_per_s), len(self.names)
        return (stamp_ns * rate * count + place * 1000 * SECOND) // (1000 * SECOND * count)

    def _scans(self, place: int, before_ns: int, stamp_ns: int, door: bool) -> bool:
        """Whether this camera's turn to scan came between two of its images."""
        times = 1 + (door and self.allowance is None)
        first, last = (stamp * times * SCANS_PER_S // SECOND for stamp in (before_ns, stamp_ns))
        count = len(self.names)
        scans = (last - place) // count > (first - place) // count
        if scans and self.allowance is not None:
            self.allowance.scanned()
        return scans


def _overlap(one: Array, other: Array) -> float:
    """Intersection over union of two boxes."""
    low, high = np.maximum(one[:2], other[:2]), np.minimum(one[2:], other[2:])
    shared = float(np.prod(np.maximum(high - low, 0.0)))
    total = float(np.prod(one[2:] - one[:2]) + np.prod(other[2:] - other[:2])) - shared
    return shared / max(total, 1e-9)
