"""Rate of looks and height of people that keep detection within its share of the processor cores.

A look is one image that the network runs on. This is for live runs only: the cost of looks is measured, so
the choice depends on the machine. All cameras get the same rate and height.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

SECOND = 10**9
DECIDED_EVERY_NS = SECOND // 2
LEARNT = 0.05  # weight of a new cost in the running mean
FEW = 6.0  # looks per s and camera, below which people are scaled down before the rate drops further
# px of the network input, least height of people; below it, accuracy falls faster than the cost
LEAST_HEIGHT = 160
FEWEST = 2.0  # looks per s and camera, lower limit of the rate
STEP = 0.1  # a choice stays until another differs by more than this share


@dataclass(frozen=True)
class Processor:
    """Processor cores of a live stage.

    Args:
        cores: Number of cores.
        thread_s: Returns the processor time of the calling thread, s.
    """

    cores: int
    thread_s: Callable[[], float]


class DetectionPace(NamedTuple):
    """Chosen pace of the detector.

    Attributes:
        looks_per_s: Looks per second of each camera, 0 = every image.
        region_height: Height of people in image regions, in pixels of the network input.
    """

    looks_per_s: float
    region_height: int


@dataclass
class _CameraRate:
    stamp_ns: int
    number: int
    rate_hz: float = 0.0


class Budget:
    """Budget of processor time: measures the cost of images and chooses the pace.

    Images of several cameras may be reported concurrently.

    Args:
        share: Share of the cores that may be used.
        cores: Number of cores.
        tallest: Height of people in regions, px of the network input, unless looks become rare.
        begin: Pace until costs are measured.
    """

    def __init__(self, share: float, cores: int, tallest: int, begin: DetectionPace):
        self._allowed, self._tallest = share * cores, tallest
        self.pace = begin
        self._cameras: dict[str, _CameraRate] = {}
        self._look_s: float | None = None  # s, cost of a look at people of height `tallest`
        self._rest_s = 0.0  # s, cost of an image without a look
        self._decided_ns: int | None = None
        self._lock = threading.Lock()

    def took(
        self, camera: str, stamp_ns: int, number: int, looked: bool, seconds: float
    ) -> DetectionPace | None:
        """Report the processor time of an image in s; return the new pace if it changes.

        Args:
            number: Number of the frame. Skipped frames count as well.
            looked: Whether the network ran on the image.
        """
        with self._lock:
            self._learn(camera, stamp_ns, number)
            if looked:
                seconds *= (self._tallest / self.pace.region_height) ** 2
                before = self._look_s
                self._look_s = seconds if before is None else before + LEARNT * (seconds - before)
            else:
                self._rest_s += LEARNT * (seconds - self._rest_s)
            if self._decided_ns is None:
                self._decided_ns = stamp_ns
            if self._look_s is None or stamp_ns - self._decided_ns < DECIDED_EVERY_NS:
                return None
            self._decided_ns = stamp_ns
            chosen = self._choice(self._look_s)
            if not self._differs(chosen):
                return None
            self.pace = chosen
            return chosen

    def used(self) -> float:
        """Return the number of cores that the chosen pace keeps busy."""
        with self._lock:
            return self._use(self.pace, self._look_s or 0.0)

    def _learn(self, camera: str, stamp_ns: int, number: int) -> None:
        known = self._cameras.get(camera)
        if known is None or stamp_ns <= known.stamp_ns or number <= known.number:
            self._cameras[camera] = _CameraRate(stamp_ns, number)
            return
        rate = SECOND * (number - known.number) / (stamp_ns - known.stamp_ns)
        known.rate_hz += (LEARNT if known.rate_hz else 1.0) * (rate - known.rate_hz)
        known.stamp_ns, known.number = stamp_ns, number

    def _choice(self, look_s: float) -> DetectionPace:
        fastest = max(known.rate_hz for known in self._cameras.values())
        looks = self._looks(look_s)
        if looks >= fastest:
            return DetectionPace(0.0, self._tallest)
        height = self._tallest
        if looks < FEW:
            least = min(LEAST_HEIGHT, self._tallest)
            height = int(min(max(self._tallest * (looks / FEW) ** 0.5, least), self._tallest))
            looks = min(self._looks(look_s * (height / self._tallest) ** 2), FEW)
        return DetectionPace(max(looks, min(FEWEST, fastest)), height)

    def _looks(self, look_s: float) -> float:
        """Return the affordable looks per s and camera, if one look costs `look_s` s."""
        images = sum(known.rate_hz for known in self._cameras.values())
        left = max(self._allowed - images * self._rest_s, 0.0)
        return left / (len(self._cameras) * max(look_s - self._rest_s, 1e-6))

    def _use(self, pace: DetectionPace, look_s: float) -> float:
        images = sum(known.rate_hz for known in self._cameras.values())
        cost = look_s * (pace.region_height / self._tallest) ** 2
        looks = len(self._cameras) * pace.looks_per_s if pace.looks_per_s else images
        return min(looks, images) * cost + max(images - looks, 0.0) * self._rest_s

    def _differs(self, chosen: DetectionPace) -> bool:
        pairs = zip(chosen, self.pace)
        return any(abs(new - old) > STEP * max(new, old) for new, old in pairs)
