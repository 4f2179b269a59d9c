"""When exactly a word began: least squares of its known edge train on the raw samples.

If the bits are known, the signal is known up to start, cell length, level and its slow change, and a baseline
(DC, hum), which is projected out. For white noise this is the maximum-likelihood estimate, whose variance is
the Cramer-Rao bound for these edges. Besides the variance by white noise there is one from the scatter of
batches of edges, which shows jitter and echoes. Errors that all edges share, by clipping and wrong shapes, do
not show there: `unseen` says how large they may be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from panoptic_ros.timecode.signal.baseline import baseline_of
from panoptic_ros.timecode.signal.edge_shape import EdgeShape
from panoptic_ros.timecode.signal.grid import Grid
from panoptic_ros.timecode.signal.wave import Edges, Samples, edge_places
from panoptic_ros.timecode.word.edge_kernels import fit_edges, line_through, waver
from panoptic_ros.timecode.word.fit_kernels import FitLimits, fit_train
from panoptic_ros.timecode.word.smoothing import Motion
from panoptic_ros.timecode.word.unseen_kernels import jumps, widest_gap

Array = np.ndarray
MARGIN = 0.25  # cells before the first and after the last edge
STEPS = 8  # of Gauss and Newton
SETTLED = 0.04  # standard deviations of an edge; the next step would be the square of that
LOST = 0.05  # cells
OUTLIER = 4.0  # standard deviations
GROSS = 0.25  # times the level: more than a slightly misplaced edge
SHAKEN_SECONDS = 40e-6  # by which single edges may be misplaced
SWINGS = 6  # polynomials that a swing about a line is told by
EDGE_SECONDS, EDGE_SAMPLES = 15.6e-6, 0.4  # standard deviation of an edge, at least


@dataclass(frozen=True, slots=True)
class FreeEdges:
    """Edges of a word that were fitted one by one.

    Args:
        cells: (N,) from the middle of the word.
        measured, noise: (N,) samples by the word alone, and their variances by white noise.
        places: (N,) samples, by the motion of the tape as well.
        before: the motion that they were smoothed with.
    """

    cells: Array
    measured: Array
    noise: Array
    places: Array
    before: Motion


class Before(NamedTuple):
    """What is known of the tape before a word.

    Args:
        motion: of the tape. bandwidth: of that, see `smoothing`.
        cells, places: (M,) of the last edges of the word before.
    """

    motion: Motion
    bandwidth: float
    cells: Array
    places: Array


@dataclass(frozen=True, slots=True)
class WordFit:
    """The start of a word, by its grid.

    Args:
        grid: in recorded samples.
        covariance: (2, 2) of middle and cell, for white noise.
        observed: (2, 2) the same, from the scatter of edges.
        level: signed, that before the first edge is -level.
        clean: the samples without clicks.
        clicked: whether there were any.
        places: edges in cells from the middle.
        unseen: samples, standard deviation of an error that all edges share, by a wrong shape or clipping.
        gap: the widest part between two samples, of 1, in which no edge lies.
        sudden: share of the edges that jump from plateau to plateau between two samples.
        waver: variance ratio of what edges swing about a line, and of their scatter.
        swing: that, squared samples.
        free: the edges, if each was fitted by itself.
    """

    grid: Grid
    covariance: Array
    observed: Array
    level: float
    clean: Samples
    clicked: bool
    places: Array
    unseen: float
    gap: float
    sudden: float
    waver: float
    swing: float
    free: FreeEdges | None = None

    @property
    def middle(self) -> float:
        """Of the word, samples."""
        return self.grid.middle

    @property
    def cell(self) -> float:
        """Length of a cell, samples."""
        return self.grid.cell

    def teach(self, shape: EdgeShape, sample_rate: int) -> None:
        """Let the shape of a step learn from the word."""
        baseline = baseline_of(len(self.clean.values), sample_rate)
        excess = self.observed[0, 0] / max(self.covariance[0, 0], 1e-12)
        shape.learn(self.clean, Edges(self.grid, self.places), self.level, baseline, excess, self.sudden)


def fit_word(
    recorded: Samples, bits: Array, grid: Grid, sample_rate: int, shape: EdgeShape
) -> WordFit | None:
    """Fit a word; None if it is not wholly inside of the samples or the fit does not settle.

    Args:
        bits: (80,) in the order of the file.
        grid: a guess, good to a tenth of a cell over the word.
        shape: of a step.
    """
    half = 0.5 * len(bits)
    half, (middle, cell) = 0.5 * len(bits), grid
    part = _part(recorded, middle - half * cell, middle + half * cell, cell)
    if part is None:
        return None
    straight = shape.straighten(part.values)
    baseline, limits = baseline_of(len(straight), sample_rate), _limits(sample_rate)
    edges = Edges(grid, edge_places(bits))
    fit = fit_train(Samples(part.first, straight), edges, shape.table, baseline, limits)
    if not fit.settled:
        return None
    edges = Edges(fit.grid, edges.places)
    clean = fit.clean if straight is part.values else part.values - (straight - fit.clean)
    waves = waver(edges.places, fit.away, fit.noise, SWINGS)
    gap = widest_gap(fit.grid.middle + fit.grid.cell * edges.places, 1.0)
    sudden = jumps(clean, abs(fit.level))
    return WordFit(
        grid=fit.grid,
        covariance=fit.white,
        observed=fit.observed,
        level=fit.level,
        clean=Samples(part.first, clean),
        clicked=fit.clicked,
        places=edges.places,
        unseen=_unseen(shape, gap, sudden, fit.misfit),
        gap=gap,
        sudden=sudden,
        waver=waves[0],
        swing=waves[1],
    )


def fit_free_edges(
    recorded: Samples, bits: Array, ticks: Array, sample_rate: int, shape: EdgeShape, before: Before
) -> WordFit | None:
    """Fit a word whose speed changes within it, edge by edge; see `fit_word`.

    Args:
        ticks: (161,) samples, where its half cells begin and end, good to a tenth of a cell.
    """
    cell = (ticks[-1] - ticks[0]) / len(bits)
    part = _part(recorded, ticks[0], ticks[-1], cell)
    if part is None:
        return None
    straight = shape.straighten(part.values)
    own, others = edge_places(bits), len(before.cells)
    cells = np.append(before.cells, own)
    guess = np.append(before.places, ticks[np.rint(2.0 * own + len(bits)).astype(np.int64)])
    baseline, limits = baseline_of(len(straight), sample_rate), _limits(sample_rate)
    known = before.motion, before.bandwidth, others
    fit = fit_edges(Samples(part.first, straight), cells, guess, shape.table, baseline, limits, known)
    if not fit.settled:
        return None
    clean = fit.clean if straight is part.values else part.values - (straight - fit.clean)
    (middle, cell), covariance = line_through(own, fit.smoothed.places, fit.noise)
    waves = waver(own, fit.measured - middle - cell * own, fit.noise, SWINGS)
    gap, sudden = widest_gap(fit.smoothed.places, 1.0), jumps(clean, abs(fit.level))
    return WordFit(
        grid=Grid(middle, cell),
        covariance=covariance,
        observed=covariance * fit.smoothed.scale,
        level=-fit.level if others % 2 else fit.level,
        clean=Samples(part.first, clean),
        clicked=fit.clicked,
        places=(fit.smoothed.places - middle) / cell,
        unseen=_unseen(shape, gap, sudden, fit.misfit),
        gap=gap,
        sudden=sudden,
        waver=waves[0],
        swing=waves[1],
        free=FreeEdges(own, fit.measured, fit.noise, fit.smoothed.places, before.motion),
    )


def _unseen(shape: EdgeShape, gap: float, sudden: float, misfit: float) -> float:
    """Samples, standard deviation of an error that all edges of a word share."""
    between = sudden * gap * shape.sudden / math.sqrt(12.0)
    return math.sqrt(between**2 + misfit + shape.doubt**2)


def _part(recorded: Samples, begin: float, end: float, cell: float) -> Samples | None:
    """The samples of a word and a little beside it; None if they are not all there."""
    first, raw = recorded
    low = int(np.ceil(begin - MARGIN * cell))
    high = int(np.floor(end + MARGIN * cell)) + 1
    if low < first and begin > first - cell:
        low = first  # the stream began with this word
    if low < first or high > first + len(raw):
        return None
    return Samples(low, raw[low - first : high - first])


@lru_cache(maxsize=8)
def _limits(sample_rate: int) -> FitLimits:
    """For `fit_train`."""
    sigma = max(EDGE_SECONDS * sample_rate, EDGE_SAMPLES)
    return FitLimits(STEPS, SETTLED, LOST, OUTLIER, GROSS, sigma, SHAKEN_SECONDS * sample_rate)
