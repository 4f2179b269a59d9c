"""Choice of the network's input size from the size of the people in the image.

MoveNet works best for people of 100 to 200 px in its input. It is imprecise below 70 px and misses people
above about 250 px, so that a larger input can be worse. The size therefore follows the people of each camera,
with hysteresis. Single frames try other sizes while the network detects no person, or while the maps show
joints of people it did not detect.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

# px of the network input, tried on the first frame if no side is configured
START_SIDES = (256, 384, 512, 768)
SURE = 0.2  # people with higher scores count
PROBE_FACTORS = (0.7, 0.45, 1.5, 2.2)  # factors on the present side, tried in turn
PROBE_AFTER, PROBE_AFTER_MOST = 3, 64  # frames with missed people before a probe; doubles after vain probes
UNCLAIMED_JOINTS = 6  # this number of joints without a person indicates a missed person
SETTLED = 3  # frames at one side before it may follow the people
GAIN = 0.15  # summed person scores by which another side must be better
# Information that one view gives about a person, as a function of the height over the seen joints in px.
# It is the inverse squared joint error times the share of people who are detected or visible in the maps.
# Measured with MoveNet MultiPose on rendered people; the loss above 250 px is that of real people.
QUALITY_PX = (0.0, 40.0, 70.0, 100.0, 130.0, 160.0, 200.0, 220.0, 240.0, 260.0, 300.0, 350.0, 400.0)
QUALITY = (0.0, 0.12, 0.30, 0.53, 0.80, 1.00, 1.10, 1.09, 1.05, 0.98, 0.80, 0.52, 0.30)
SHRINK_GAIN, ENLARGE_GAIN = 1.03, 1.2  # ratio of expected quality; enlarging costs time


@dataclass(frozen=True)
class InputSizeResult:
    """Result of one run of the network, as far as it concerns the input size.

    Args:
        side: Longer side of the input, px.
        scores: (P,) person scores.
        heights: (P,) image px, over the seen joints.
        unclaimed: Number of joints with a peak in the maps that belongs to no person.
    """

    side: int
    scores: np.ndarray
    heights: np.ndarray
    unclaimed: int = 0

    @property
    def sure(self) -> np.ndarray:
        """Return which people count (P,)."""
        return self.scores >= SURE

    @property
    def value(self) -> float:
        """Return the sum of the scores of the people who count."""
        return float(self.scores[self.sure].sum())


@dataclass
class InputSizeChooser:
    """Chooser of the longer side of the network input for one camera.

    Args:
        start: Side at the start, px; 0 = try several on the first frame.
        least, most: Limits of the side, px.
        multiple: Sides are multiples of this.
        window: Number of frames whose people count.
        adaptive: False = `start` stays.
    """

    start: int
    least: int
    most: int
    multiple: int = 32
    window: int = 10
    adaptive: bool = True
    side: int = field(init=False, default=0)
    _recent: list[np.ndarray] = field(init=False, default_factory=list)
    _missing: int = field(init=False, default=0)
    _patience: int = field(init=False, default=PROBE_AFTER)
    _probes: int = field(init=False, default=0)

    @property
    def now(self) -> int:
        """Return the present side; before the first frame, the side that is tried first."""
        return self.side or self.plan()[0]

    def plan(self) -> tuple[int, ...]:
        """Return the sides to run the next frame with; the first is the present one."""
        if not self.side:
            sides: Sequence[float] = START_SIDES
            if self.start:
                sides = (self.start, 0.7 * self.start) if self.adaptive else (self.start,)
            return tuple(dict.fromkeys(self._allowed(side) for side in sides))
        if self.adaptive and self._missing >= self._patience:
            factors = [PROBE_FACTORS[(self._probes + k) % len(PROBE_FACTORS)] for k in range(4)]
            others = [self._allowed(self.side * factor) for factor in factors]
            other = next((side for side in others if side != self.side), self.side)
            return (self.side, other) if other != self.side else (self.side,)
        return (self.side,)

    def learn(self, answers: Sequence[InputSizeResult], image_side: int) -> int:
        """Update with the results for the planned sides; return the index of the best."""
        best = 0
        for index, answer in enumerate(answers):
            if answer.value > answers[best].value + GAIN:
                best = index
        if len(answers) > 1 and self.side:  # this was a probe
            self._probes += 1
            self._patience = PROBE_AFTER if best else min(2 * self._patience, PROBE_AFTER_MOST)
            self._missing = 0
        chosen = answers[best]
        if chosen.side != self.side:
            self.side = chosen.side
            self._recent.clear()
        if self.adaptive:
            self._follow(chosen, image_side)
        return best

    def saw(self, answer: InputSizeResult, image_side: int) -> None:
        """Update with the result for another side than the present one: it gives the height of people."""
        if self.adaptive:
            self._follow(answer, image_side)

    def _follow(self, answer: InputSizeResult, image_side: int) -> None:
        """Count frames with missed people, and change to the side that suits the people of recent frames."""
        lost = not answer.sure.any() or answer.unclaimed >= UNCLAIMED_JOINTS
        self._missing = self._missing + 1 if lost else 0
        if not lost:
            self._patience = PROBE_AFTER
        if not answer.sure.any():
            return
        self._recent = [*self._recent[1 - self.window :], answer.heights[answer.sure] / image_side]
        if len(self._recent) < SETTLED:
            return
        heights = np.concatenate(self._recent)
        sides = np.arange(self.least, self.most + 1, self.multiple)
        quality = expected_quality(heights, sides)
        now = float(expected_quality(heights, np.array([self.side]))[0])
        best = int(quality.argmax())
        wanted = int(sides[best])
        if quality[best] > now * (SHRINK_GAIN if wanted < self.side else ENLARGE_GAIN):
            self.side = wanted
            self._recent.clear()

    def _allowed(self, side: float) -> int:
        steps = max(round(side / self.multiple), 1) * self.multiple
        return int(min(max(steps, self.least), self.most))


def expected_quality(heights: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Return the summed quality (S,) of people for input sides (S,).

    Args:
        heights: (P,) heights of people, as shares of the image's longer side.
        sides: (S,) longer sides of the input, px.
    """
    quality: np.ndarray = np.interp(sides[:, None] * heights[None, :], QUALITY_PX, QUALITY).sum(axis=1)
    return quality


def input_size(side: int, image_size: tuple[int, int], multiple: int) -> tuple[int, int]:
    """Return the (height, width) of the input for an image (width, height), with longer side `side`."""
    width, height = image_size
    scale = side / max(width, height)
    rows, columns = (max(math.ceil(round(extent * scale) / multiple), 1) for extent in (height, width))
    return rows * multiple, columns * multiple
