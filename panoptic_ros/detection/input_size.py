"""Which size to give the network's input, from the size of the people that it is to find.

MoveNet finds people best who are 100 to 200 px tall in its input, is imprecise below 70 px, and
does not find people above about 250 px at all: a larger input is worse then, not better. So the
size follows the people of each camera, with hysteresis, and other sizes are tried on single
frames while nobody is found, or while the maps show joints of people whom the list lacks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

START_SIDES = (256, 384, 512, 768)  # tried on the first frame where no side is given
SURE = 0.2  # people above this score count
PROBE_FACTORS = (0.7, 0.45, 1.5, 2.2)  # of the present side, in turn
PROBE_AFTER, PROBE_AFTER_MOST = 3, 64  # frames; doubles with every probe in vain
UNCLAIMED_JOINTS = 6  # so many joints of nobody are a person that is missing
SETTLED = 3  # frames at one side before it may follow the people
GAIN = 0.15  # summed person scores by which another size must be better
# What a view tells about a person, by the person's height over the seen joints in net px: the inverse
# square of the joints' error, times the share of people who are found or whom the maps still show.
# Measured with MoveNet MultiPose on rendered people, with the loss above 250 px as on real ones.
QUALITY_PX = (0.0, 40.0, 70.0, 100.0, 130.0, 160.0, 200.0, 220.0, 240.0, 260.0, 300.0, 350.0, 400.0)
QUALITY = (0.0, 0.12, 0.30, 0.53, 0.80, 1.00, 1.10, 1.09, 1.05, 0.98, 0.80, 0.52, 0.30)
SHRINK_GAIN, ENLARGE_GAIN = 1.03, 1.2  # ratio of expected quality; enlarging costs time


@dataclass(frozen=True)
class Answer:
    """What one run of the network tells about its input's size.

    Args:
        side: longer side of the input, net px.
        scores, heights: (P,) person scores; heights in image px, over the joints that are seen.
        unclaimed: joints with peaks in the maps that belong to nobody.
    """

    side: int
    scores: np.ndarray
    heights: np.ndarray
    unclaimed: int = 0

    @property
    def sure(self) -> np.ndarray:
        """Which people count (P,)."""
        return self.scores >= SURE

    @property
    def value(self) -> float:
        """Sum of the scores of those who count."""
        return float(self.scores[self.sure].sum())


@dataclass
class SideChooser:
    """The longer side of the network's input for one camera.

    Args:
        start: 0 = try several on the first frame.
        least, most: limits of the side.
        multiple: sides are multiples of this.
        window: frames whose people count.
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
        """The present side; before the first frame the one that is tried first."""
        return self.side or self.plan()[0]

    def plan(self) -> tuple[int, ...]:
        """Sides to run the next frame with; the first is the present one."""
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

    def learn(self, answers: Sequence[Answer], image_side: int) -> int:
        """Take the answers for the planned sides; gives the index of the best of them."""
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

    def saw(self, answer: Answer, image_side: int) -> None:
        """Take an answer for another side than the present one: it tells how tall people are."""
        if self.adaptive:
            self._follow(answer, image_side)

    def _follow(self, answer: Answer, image_side: int) -> None:
        """Count what is missing, and move to the side that suits the people of the last frames."""
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
    """Summed quality (S,) of people with heights (P,), as shares of the image's side, for sides (S,)."""
    quality: np.ndarray = np.interp(sides[:, None] * heights[None, :], QUALITY_PX, QUALITY).sum(axis=1)
    return quality


def input_size(side: int, image_size: tuple[int, int], multiple: int) -> tuple[int, int]:
    """(height, width) of the input that holds an image (width, height) with that longer side."""
    width, height = image_size
    scale = side / max(width, height)
    rows, columns = (max(math.ceil(round(extent * scale) / multiple), 1) for extent in (height, width))
    return rows * multiple, columns * multiple
