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

import numpy as np

from panoptic_ros.timecode.signal.baseline import baseline_of
from panoptic_ros.timecode.signal.edge_shape import EdgeShape
from panoptic_ros.timecode.signal.grid import Grid
from panoptic_ros.timecode.signal.wave import Edges, Samples, edge_places
from panoptic_ros.timecode.word.fit_kernels import FitLimits, fit_train, jumps, widest_gap

Array = np.ndarray
MARGIN = 0.25  # cells before the first and after the last edge
STEPS = 8  # of Gauss and Newton
SETTLED = 0.04  # standard deviations of an edge; the next step would be the square of that
LOST = 0.05  # cells
OUTLIER = 4.0  # standard deviations
GROSS = 0.25  # times the level: more than a slightly misplaced edge
SHAKEN_SECONDS = 40e-6  # by which single edges may be misplaced
EDGE_SECONDS, EDGE_SAMPLES = 15.6e-6, 0.4  # standard deviation of an edge, at least


@dataclass(frozen=True, slots=True)
class WordFit:
    """The start of a word, by its grid.

    Args:
        grid: in recorded samples.
        covariance: (3, 3) of middle, cell and bend, for white noise.
        observed: (3, 3) the same, from the scatter of edges.
        level: signed, that before the first edge is -level.
        clean: the samples without clicks.
        clicked: whether there were any.
        places: edges in cells from the middle.
        unseen: samples, standard deviation of an error that all edges share, by a wrong shape or clipping.
        gap: the widest part between two samples, of 1, in which no edge lies.
        sudden: share of the edges that jump from plateau to plateau between two samples.
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

    @property
    def middle(self) -> float:
        """Of the word, samples."""
        return self.grid.middle

    @property
    def cell(self) -> float:
        """Length of a cell, samples."""
        return self.grid.cell

    @property
    def bend(self) -> float:
        """See `Grid`."""
        return self.grid.bend

    @property
    def cell_std(self) -> float:
        """Samples."""
        return float(np.sqrt(self.observed[1, 1]))

    def teach(self, shape: EdgeShape, sample_rate: int) -> None:
        """Let the shape of a step learn from the word."""
        baseline = baseline_of(len(self.clean.values), sample_rate)
        excess = self.observed[0, 0] / max(self.covariance[0, 0], 1e-12)
        shape.learn(self.clean, Edges(self.grid, self.places), self.level, baseline, excess, self.sudden)


def fit_word(
    recorded: Samples, bits: Array, grid: Grid, sample_rate: int, shape: EdgeShape, bending: bool = False
) -> WordFit | None:
    """Fit a word; None if it is not wholly inside of the samples or the fit does not settle.

    Args:
        bits: (80,) in the order of the file.
        grid: a guess, good to a tenth of a cell over the word.
        shape: of a step.
        bending: whether the speed may change within the word.
    """
    half = 0.5 * len(bits)
    first, raw = recorded
    middle, cell, bend = grid
    begin, end = middle + cell * (bend * half**2 - half), middle + cell * (bend * half**2 + half)
    low = int(np.ceil(begin - MARGIN * cell))
    high = int(np.floor(end + MARGIN * cell)) + 1
    if low < first and begin > first - cell:
        low = first  # the stream began with this word
    if low < first or high > first + len(raw):
        return None
    values = raw[low - first : high - first]
    places = edge_places(bits)
    straight = shape.straighten(values)
    baseline, limits = baseline_of(len(values), sample_rate), _limits(sample_rate)
    fit = fit_train(Samples(low, straight), Edges(grid, places), shape.table, baseline, limits, bending)
    if not fit.settled:
        return None
    clean = fit.clean if straight is values else values - (straight - fit.clean)
    middle, cell, bend = fit.grid
    gap = widest_gap(middle + cell * (places + bend * places**2), 1.0)
    sudden = jumps(clean, abs(fit.level))
    between = sudden * gap * shape.sudden / math.sqrt(12.0)
    unseen = math.sqrt(between**2 + fit.misfit + shape.doubt**2)
    return WordFit(
        grid=fit.grid,
        covariance=fit.white,
        observed=fit.observed,
        level=fit.level,
        clean=Samples(low, clean),
        clicked=fit.clicked,
        places=places,
        unseen=unseen,
        gap=gap,
        sudden=sudden,
    )


@lru_cache(maxsize=8)
def _limits(sample_rate: int) -> FitLimits:
    """For `fit_train`."""
    sigma = max(EDGE_SECONDS * sample_rate, EDGE_SAMPLES)
    return FitLimits(STEPS, SETTLED, LOST, OUTLIER, GROSS, sigma, SHAKEN_SECONDS * sample_rate)
