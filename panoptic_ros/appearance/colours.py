"""Measurement of clothing colours in images.

The colour is sampled at a fixed pattern of points inside torso and legs, away from the outlines, placed by
the joints. Points inside the box of another 2D pose may belong to that person and are ignored. The colour is
the median over the points, per channel. So an arm in front of the body, a belt or a print has little effect.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import SkeletonModel
from panoptic_ros.domain.appearance import CHANNELS, REGIONS

Array = np.ndarray
# fractions of the torso's height and width
DOWN, ACROSS = (0.12, 0.29, 0.46, 0.63, 0.8), (0.2, 0.4, 0.6, 0.8)
THIGH, SHIN = (0.2, 0.4, 0.6, 0.8), (0.15, 0.35, 0.55)  # fractions of the thigh's and shin's length
DARK = 8.0  # grey levels, added to every channel, so that noise does not determine the colour of dark clothes
FORELEGS = ("hip", "knee", "ankle")


class ColourSamples:
    """Sample points inside torso and legs for a skeleton model, as weighted means of joints."""

    def __init__(self, skeleton: SkeletonModel):
        names = [name.lower() for name in skeleton.joint_names]
        rows: list[Array] = []
        self.regions = np.zeros(0, np.int64)  # (N,) index into `REGIONS` of each point
        sides = [[_joint(names, side, word) for word in ("shoulder", *FORELEGS)] for side in "lr"]
        (left, left_hip, *_), (right, right_hip, *_) = sides
        if None not in (left, right, left_hip, right_hip):
            for down in DOWN:
                for across in ACROSS:
                    rows.append(
                        _weights(
                            len(names),
                            {
                                left: (1 - down) * (1 - across),
                                right: (1 - down) * across,
                                left_hip: down * (1 - across),
                                right_hip: down * across,
                            },
                        )
                    )
        torso = len(rows)
        for _, hip, knee, ankle in sides:
            for first, last, shares in ((hip, knee, THIGH), (knee, ankle, SHIN)):
                if first is not None and last is not None:
                    rows += [_weights(len(names), {first: 1 - share, last: share}) for share in shares]
        self.weights = np.array(rows).reshape(-1, len(names))  # (N, J), each row sums to 1
        self.regions = np.repeat([0, 1], [torso, len(rows) - torso])

    def lay(self, points: Array) -> Array:
        """Return the sample points (P, N, 2) px of people with joints (P, J, 2) px.

        A point is NaN if one of its joints is missing (NaN).
        """
        gone = np.isnan(points[..., 0])
        laid: Array = np.einsum("nj,pji->pni", self.weights, np.where(gone[..., None], 0.0, points))
        needs = (gone.astype(float) @ (self.weights > 0.0).T) > 0.0
        laid[needs] = np.nan
        return laid


def _joint(names: list[str], side: str, word: str) -> int | None:
    """Return the only joint of a side ("l", "r") whose name contains a word; None if it is not unique."""
    found = [j for j, name in enumerate(names) if word in name and name.startswith(side)]
    return found[0] if len(found) == 1 else None


def _weights(joints: int, shares: dict[int | None, float]) -> Array:
    row = np.zeros(joints)
    for joint, share in shares.items():
        assert joint is not None
        row[joint] = share
    return row


def colours_of(image: Array, points: Array, pattern: ColourSamples, fewest: int) -> Array:
    """Return colours (P, 2, 3) of people with joints (P, J, 2) px, NaN = missing, as in `ViewAppearance`.

    Args:
        image: (H, W, 3) uint8 BGR.
        points: (P, J, 2) joints, px.
        pattern: Sample points of the skeleton model.
        fewest: Visible sample points that a colour needs.
    """
    laid = pattern.lay(points)
    with np.errstate(invalid="ignore"):
        cells = np.where(np.isnan(laid), -1.0, np.rint(laid)).astype(np.int64)
    height, width = image.shape[:2]
    seen = ((cells >= 0) & (cells < (width, height))).all(axis=-1) & ~_within_others(laid, points)
    cells[~seen] = 0
    grey = image[cells[..., 1], cells[..., 0]].astype(np.float64)
    blue, green, red = np.log(grey + DARK).transpose(2, 0, 1)
    values = np.where(seen[..., None], np.stack([green, red - green, blue - green], axis=-1), np.nan)
    found = np.full((len(points), len(REGIONS), CHANNELS), np.nan)
    for region in range(len(REGIONS)):
        own = values[:, pattern.regions == region]
        known = (~np.isnan(own[..., 0])).sum(axis=1) >= fewest
        if known.any():
            found[known, region] = np.nanmedian(own[known], axis=1)
    return found


def _within_others(laid: Array, points: Array) -> Array:
    """Return a mask (P, N) of the points (P, N, 2) inside the box of another person's joints (P, J, 2)."""
    known = ~np.isnan(points)
    low = np.where(known, points, np.inf).min(axis=1)
    high = np.where(known, points, -np.inf).max(axis=1)
    with np.errstate(invalid="ignore"):
        within = ((laid[:, :, None] >= low) & (laid[:, :, None] <= high)).all(axis=-1)  # (P, N, P)
    people = np.arange(len(points))
    within[people, :, people] = False
    found: Array = within.any(axis=-1)
    return found
