"""Schedule of the network: on which images it runs, and whether on the whole image or on regions.

A look is one image that the network runs on. Timestamps spread the looks over the rig: camera i of N looks
when its timestamps pass (m - i / N) / looks_per_s, for whole numbers m. So the cameras of one trigger look in
turn. Scans for new people run on small whole images and rotate over the rig. A detection that no track
explains raises an alarm: all cameras then look at whole images. In live runs an `Allowance` limits the looks
per instant.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from panoptic_ros.detection.allowance import Allowance

Array = np.ndarray
SECOND = 10**9
LONGEST_GAP_NS = 150_000_000  # longest gap between two images over which people are propagated
SCANS_PER_S = 12  # scans (small whole images) of all cameras together
WHOLE_IMAGES = 2  # whole images of every camera after an alarm
WHOLE_IMAGES_LIVE = 1  # as WHOLE_IMAGES, if an allowance limits the looks
QUIET_LIVE_NS = SECOND  # pause between alarms with an allowance: whole images of the last alarm come first
FIRST_WAIT_NS = SECOND // 2  # wait until the same unexplained person may raise an alarm; doubles each time
LONGEST_WAIT_NS = 32 * SECOND
MOST_VAIN = 4  # unsuccessful closer looks up to which the wait grows: 2, 4, ... 16 looks
SAME_PLACE = 0.3  # least intersection over union of two boxes of the same unexplained person


class DetectionMode(Enum):
    """Processing of one image: network on the whole image, network on regions, or optical flow only."""

    WHOLE = "whole"
    REGIONS = "regions"
    CARRY = "carry"


@dataclass
class CameraSchedule:
    """Schedule state of one camera.

    Args:
        last_ns: Timestamp of its newest image.
        answered_ns: Timestamp of the alarm that it answers.
        left: Number of whole images still to process for this alarm.
        whole_ns: Timestamp of the newest whole image processed for it.
        vain: Number of consecutive closer looks that found no further person.
        wait: Number of looks until the next closer one.
    """

    last_ns: int
    answered_ns: int = -1
    left: int = 0
    whole_ns: int = -1
    vain: int = 0
    wait: int = 0

    def closer(self) -> bool:
        """Return whether a closer look may run now; call it once for each closer look that is due."""
        self.wait = max(self.wait - 1, 0)
        return self.wait == 0

    def looked_closer(self, others: bool) -> None:
        """Update the wait for the next closer look: none after a new detection, else longer each time."""
        self.vain = 0 if others else min(self.vain + 1, MOST_VAIN)
        self.wait = 0 if others else 2**self.vain


@dataclass
class IgnoredAlarm:
    """Unexplained person who raised an alarm.

    Args:
        box: (4,) px in the image of the camera.
        until_ns: Timestamp until which the person raises no further alarm.
        wait_ns: Length of this pause.
    """

    camera: str
    box: Array
    until_ns: int
    wait_ns: int


@dataclass
class DetectionScheduler:
    """Scheduler that decides for every image of every camera, from timestamps alone.

    Args:
        names: Names of the cameras, in the order of the rig.
        looks_per_s: Rate of each camera; 0 = every image.
        guided: Whether the network runs on regions where tracks exist.
        allowance: Limit of looks; None: no limit.
    """

    names: tuple[str, ...]
    looks_per_s: float
    guided: bool
    allowance: Allowance | None = None
    cameras: dict[str, CameraSchedule] = field(default_factory=dict)
    alarm_ns: int = -1
    ignored: list[IgnoredAlarm] = field(default_factory=list)
    _raising: threading.Lock = field(default_factory=threading.Lock, repr=False, compare=False)

    def reset(self) -> None:
        """Forget all cameras and unexplained people."""
        self.cameras.clear()
        self.alarm_ns, self.ignored = -1, []

    def look(
        self, camera: str, stamp_ns: int, nobody: bool, door: bool = False
    ) -> tuple[DetectionMode, bool]:
        """Return how to process an image, and whether to scan it for new people; call it once per image.

        Args:
            nobody: True if there are no tracks.
            door: Whether new people are likely here. Such a camera scans twice as often, unless looks are
                limited.
        """
        known = self.cameras.get(camera)
        step = stamp_ns - known.last_ns if known is not None else -1
        if known is None or not 0 < step <= LONGEST_GAP_NS:
            self.cameras[camera] = known = CameraSchedule(stamp_ns, self.alarm_ns)
            return (DetectionMode.REGIONS if self.guided and not nobody else DetectionMode.WHOLE), False
        before, known.last_ns = known.last_ns, stamp_ns
        if self.alarm_ns > known.answered_ns and stamp_ns > self.alarm_ns:
            known.answered_ns, known.left = self.alarm_ns, self._whole_images
        if known.left:
            known.left, known.whole_ns = known.left - 1, stamp_ns
            return DetectionMode.WHOLE, False
        place = self.names.index(camera)
        due = not self.looks_per_s or self._phase(place, stamp_ns) != self._phase(place, before)
        if self.guided and not nobody:
            return (DetectionMode.REGIONS if due else DetectionMode.CARRY), self._scans(
                place, before, stamp_ns, door
            )
        return (DetectionMode.WHOLE if due else DetectionMode.CARRY), False

    def allowed(self, camera: str, stamp_ns: int, number: int, wish: DetectionMode) -> DetectionMode:
        """Return what the allowance permits for an image, where `wish` is due.

        A later image makes up for a postponed whole image of an alarm.

        Args:
            number: Number of the frame.
        """
        if self.allowance is None:
            return wish
        if self.allowance.takes(camera, stamp_ns, number, self.looks_per_s, wish is not DetectionMode.CARRY):
            return DetectionMode.REGIONS if wish is DetectionMode.CARRY else wish
        known = self.cameras[camera]
        if wish is DetectionMode.WHOLE and known.whole_ns == stamp_ns:
            known.left += 1
        return DetectionMode.CARRY

    def raise_alarm(self, camera: str, boxes: Array, stamp_ns: int) -> bool:
        """Raise an alarm for unexplained people with boxes (N, 4) px: all cameras look at whole images.

        May be called for several cameras concurrently.

        Returns:
            whether an alarm was raised. The same person at the same place raises none for some time, longer
                each time. People in an image that answers an alarm raise none either.
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
                self.ignored.append(
                    IgnoredAlarm(camera, np.array(box), stamp_ns + FIRST_WAIT_NS, FIRST_WAIT_NS)
                )
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
        """Return the number of looks of a camera since timestamp 0; integer arithmetic avoids rounding."""
        rate, count = round(1000 * self.looks_per_s), len(self.names)
        return (stamp_ns * rate * count + place * 1000 * SECOND) // (1000 * SECOND * count)

    def _scans(self, place: int, before_ns: int, stamp_ns: int, door: bool) -> bool:
        """Return whether this camera's turn to scan came between two of its images."""
        times = 1 + (door and self.allowance is None)
        first, last = (stamp * times * SCANS_PER_S // SECOND for stamp in (before_ns, stamp_ns))
        count = len(self.names)
        scans = (last - place) // count > (first - place) // count
        if scans and self.allowance is not None:
            self.allowance.scanned()
        return scans


def _overlap(one: Array, other: Array) -> float:
    """Return the intersection over union of two boxes."""
    low, high = np.maximum(one[:2], other[:2]), np.minimum(one[2:], other[2:])
    shared = float(np.prod(np.maximum(high - low, 0.0)))
    total = float(np.prod(one[2:] - one[:2]) + np.prod(other[2:] - other[:2])) - shared
    return shared / max(total, 1e-9)
