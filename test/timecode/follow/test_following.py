"""Where the next word of a signal is expected, and when its speed counts as changing."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from panoptic_ros.timecode.follow.following import CALM_WORDS, SignalTracker
from panoptic_ros.timecode.follow.wander import Wander
from panoptic_ros.timecode.label.expected import ExpectedLabels
from panoptic_ros.timecode.signal.half_cells import CellGrid
from panoptic_ros.timecode.word.edges import EdgeFit
from panoptic_ros.timecode.word.layout import WORD_CELLS
from panoptic_ros.timecode.word.tracking import BEFORE, TICKS

CELL = 20.0


class _Labels:
    first = 0


def fit_of(waver: float = 1.0) -> EdgeFit:
    ticks = np.zeros(TICKS + 1)
    return EdgeFit(True, ticks, CellGrid(0.0, CELL), 0.04, np.full(2, 1e-3), waver, 0.1)


def following(wander: Wander | None = None) -> SignalTracker:
    return SignalTracker(CellGrid(0.0, CELL), 0, cast(ExpectedLabels, _Labels()), False, wander)


def test_the_next_word_lies_on_the_line_through_the_last_ones() -> None:
    follow, rng = following(), np.random.default_rng(1)
    for number in range(12):
        middle = number * WORD_CELLS * CELL + rng.normal(0.0, 0.1)
        follow.hit(fit_of(), CellGrid(middle, CELL + rng.normal(0.0, 0.01)), True, None)
    assert follow.number == follow.read == 12
    assert follow.grid.cell == pytest.approx(CELL, abs=1e-3)
    assert follow.grid.middle == pytest.approx(12 * WORD_CELLS * CELL, abs=0.4)
    follow.miss(None)
    assert follow.grid.middle == pytest.approx(13 * WORD_CELLS * CELL, abs=0.6) and follow.misses == 1


def test_a_word_that_is_off_the_line_begins_another() -> None:
    follow = following()
    middles = [number * WORD_CELLS * CELL for number in range(10)]
    middles += [middles[-1] + number * WORD_CELLS * (CELL + 0.1) for number in range(1, 5)]
    for number, middle in enumerate(middles):
        follow.hit(fit_of(), CellGrid(middle, CELL if number < 10 else CELL + 0.1), True, None)
    assert follow.grid.cell == pytest.approx(CELL + 0.1, abs=0.01)


def test_swings_are_told_by_one_clear_word_or_by_many() -> None:
    follow = following()
    assert follow.swings(fit_of(40.0)) and not follow.swings(fit_of(20.0))
    assert not follow.swings(fit_of(40.0)._replace(swing=1e-4))
    for _ in range(7):
        follow.hit(fit_of(4.0), CellGrid(follow.grid.middle, CELL), True, None)
    assert follow.swings(fit_of(4.0))


def test_a_speed_that_is_calm_for_long_counts_as_constant() -> None:
    follow = following(Wander(False, 0.0, CELL))
    for number in range(CALM_WORDS):
        assert follow.wander is not None
        ticks = number * WORD_CELLS * CELL + 0.5 * CELL * np.arange(-BEFORE, TICKS + 1)
        follow.hit(fit_of(), CellGrid(ticks[BEFORE + WORD_CELLS], CELL), True, ticks)
    assert follow.wander is None
