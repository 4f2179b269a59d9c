"""Re-identification score: log-odds that two tracks are one person, from the colours of their clothes.

A *look* at a person is the median colour over the views of one instant. Looks at one person differ by the
light, which no averaging removes. Looks at strangers also differ by the clothes, but some strangers wear the
same. So the evidence of equal colours is limited by the share of strangers who wear them. Different colours
are nearly conclusive.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import ViewAppearance, ViewSources
from panoptic_ros.domain.appearance import CHANNELS, REGIONS
from panoptic_ros.identity.likeness import log_normal

Array = np.ndarray
MEMORY = 200.0  # looks, over which colours are averaged
# standard deviation per channel of means at different times: by the light, which no averaging removes
LASTING = np.array([0.12, 0.03, 0.03])
# prior standard deviation of one look; weight of this prior in looks
LOOK, LOOKS = np.array([0.1, 0.04, 0.04]), 5.0
CORRELATED = 10.0  # number of successive looks with the same error
# standard deviation of clothing colours over people, per channel: torso, legs
PEOPLE = np.array([[0.4, 0.4, 0.4], [0.3, 0.15, 0.15]])
ALIKE = np.array([0.1, 0.25])  # share of strangers who wear the same colour: torso, legs
MISTAKEN = 0.03  # share of colours that belong to another person, or that have changed
OUTLIER, KNOWN = 3.0, 10.0  # standard deviations at which a look is clipped; looks after which this begins


class ClothingColours(NamedTuple):
    """Clothing colours of P people, in the channels of `domain.ViewAppearance`.

    Args:
        means: (P, 2, 3) mean colours of torso and legs, NaN = not seen.
        counts: (P, 2) number of looks behind each mean.
        squares: (P, 2, 3) mean squared deviation of single looks from the mean.
    """

    means: Array
    counts: Array
    squares: Array

    @classmethod
    def of_new(cls, people: int) -> ClothingColours:
        """Return the record of people who were not seen yet."""
        shape = people, len(REGIONS), CHANNELS
        return cls(np.full(shape, np.nan), np.zeros(shape[:2]), np.zeros(shape))

    @classmethod
    def of_looks(cls, looks: Array) -> ClothingColours:
        """Return the record of people with one look (P, 2, 3) each."""
        return cls(looks, np.isfinite(looks[..., 0]).astype(float), np.zeros_like(looks))

    def noises(self) -> Array:
        """Return the variances (P, 2, 3) of the means."""
        counts = self.counts[..., None]
        look = (LOOKS * LOOK**2 + counts * self.squares) / (LOOKS + counts)
        variances: Array = LASTING**2 + look * np.minimum(CORRELATED / np.maximum(counts, 1.0), 1.0)
        return variances

    def learn(self, rows: Array, looks: Array) -> None:
        """Update the people of the given rows (R,) with one look each, in place.

        Args:
            looks: (R, 2, 3), NaN = none.
        """
        person, region = np.nonzero(np.isfinite(looks[..., 0]))
        rows, seen = rows[person], looks[person, region]
        counts = self.counts[rows, region] = np.minimum(self.counts[rows, region] + 1.0, MEMORY)
        means, squares = self.means[rows, region], self.squares[rows, region]
        first = np.isnan(means[:, :1])
        gaps = np.where(first, 0.0, seen - means)
        limits = np.where(counts[:, None] > KNOWN, OUTLIER * np.sqrt(squares) + LASTING, np.inf)
        gaps = np.clip(gaps, -limits, limits)
        self.means[rows, region] = np.where(first, seen, means + gaps / counts[:, None])
        self.squares[rows, region] += (gaps**2 - squares) / np.maximum(counts - 1.0, 1.0)[:, None]

    def take_over(self, lost: int, fresh: int) -> None:
        """Merge the colours of a lost track into a new track of the same person, in place.

        Args:
            lost, fresh: rows of the two tracks.
        """
        counts = self.counts[lost] + self.counts[fresh]
        shares = (self.counts[lost] / np.maximum(counts, 1.0))[:, None]
        means = shares * np.nan_to_num(self.means[lost]) + (1.0 - shares) * np.nan_to_num(self.means[fresh])
        self.means[fresh] = np.where(counts[:, None] > 0.0, means, np.nan)
        self.squares[fresh] = shares * self.squares[lost] + (1.0 - shares) * self.squares[fresh]
        self.counts[fresh] = np.minimum(counts, MEMORY)


def looks_at(sources: ViewSources | None, views: dict[str, ViewAppearance], people: int) -> Array:
    """Return the looks (P, 2, 3) at the people of an instant, medians over its views, NaN = not seen.

    Args:
        sources: 2D pose of each person in each view; None = unknown.
        views: by camera, of the frames of the sources.
        people: number of people.
    """
    nothing = np.full((people, len(REGIONS), CHANNELS), np.nan)
    if sources is None or not views:
        return nothing
    seen = []
    for k, camera in enumerate(sources.cameras):
        if camera in views:
            colours, persons = views[camera].colours, sources.persons[:, k]
            known = (persons >= 0) & (persons < len(colours))
            seen.append(nothing.copy())
            seen[-1][known] = colours[persons[known]]
    stacked = np.stack(seen) if seen else nothing[None]
    there = np.isfinite(stacked[..., 0]).any(axis=0)
    nothing[there] = np.nanmedian(stacked[:, there], axis=0)
    return nothing


def colour_evidence(people: ClothingColours, others: ClothingColours) -> Array:
    """Return the log-odds (T, P) that T people and P others are the same, by clothes; 0 = colours unknown."""
    gaps = people.means[:, None] - others.means[None]  # (T, P, 2, 3)
    known = np.isfinite(gaps[..., 0])
    gaps, noise = np.nan_to_num(gaps), people.noises()[:, None] + others.noises()[None]
    same, other = (log_normal(gaps, n).sum(axis=-1) for n in (noise, noise + 2.0 * PEOPLE**2))
    one = np.logaddexp(np.log1p(-MISTAKEN) + same, np.log(MISTAKEN) + other)
    two = np.logaddexp(np.log1p(-ALIKE) + other, np.log(ALIKE) + same)
    odds: Array = np.where(known, one - two, 0.0).sum(axis=-1)
    return odds
