"""Faults of measured joints, added to true joints: noise, outliers, and gaps in the wrists."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

Array = np.ndarray
NOISE = 0.02  # m; root mean square of a joint's 3D error
OUTLIERS, AWAY = 0.05, 0.15  # share of outlier joints, and their displacement in m
LENGTHS = (5, 15)  # (shortest, longest) gap in instants
GAPS = 2  # number of gaps per wrist, one in each half of the recording


class FaultyJoints(NamedTuple):
    """Faulty joints (J, 3) m by instant and person, NaN = missing, and the set of joints missing in gaps."""

    joints: list[dict[int, Array]]
    gaps: set[tuple[int, int, int]]  # (instant, person, joint)
    covariance: Array  # covariance (3, 3) m^2 of the noise


def with_faults(truth: Sequence[Mapping[int, Array]], joint_names: Sequence[str], seed: int) -> FaultyJoints:
    """Return the true joints (J, 3) m, by instant and person, with random faults drawn from the seed."""
    rng, sigma = np.random.default_rng(seed), NOISE / np.sqrt(3.0)
    gaps: set[tuple[int, int, int]] = set()
    people = sorted({person for instant in truth for person in instant})
    wrists = [joint for joint, name in enumerate(joint_names) if "wrist" in name.lower()]
    bounds = np.linspace(2, len(truth) - 2, GAPS + 1).astype(int)
    for person in people:
        for wrist in wrists:
            for first, last in pairwise(bounds.tolist()):
                length = min(int(rng.integers(LENGTHS[0], LENGTHS[1] + 1)), last - first - 2)
                begin = int(rng.integers(first + 1, last - length))
                gaps |= {(instant, person, wrist) for instant in range(begin, begin + length)}
    joints = []
    for number, instant in enumerate(truth):
        own = {}
        for person, places in instant.items():
            found = places + rng.normal(0.0, sigma, places.shape)
            aside = rng.standard_normal(places.shape)
            outliers = rng.random(len(places)) < OUTLIERS
            found[outliers] += AWAY * (aside / np.linalg.norm(aside, axis=1, keepdims=True))[outliers]
            found[[wrist for wrist in wrists if (number, person, wrist) in gaps]] = np.nan
            own[person] = found
        joints.append(own)
    return FaultyJoints(joints, gaps, sigma**2 * np.eye(3))
