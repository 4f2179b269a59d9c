"""Fault model of a simulated detector of 2D poses."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Degradation:
    """Fault parameters of a simulated detector.

    Values without a unit are probabilities per frame and view.
    """

    noise_px: float = 1.0  # standard deviation per axis of a visible joint of average quality
    size_px: float | None = None  # if set, noise scales with the diagonal of the person's box / size_px
    memory: float = 0.0  # correlation of the noise with that of the previous frame
    memory_share: float = 1.0  # share of the noise variance with this correlation; the rest is white
    joint_miss: float = 0.0  # a visible joint is missing
    outlier: float = 0.0  # a joint is displaced by about `outlier_px`
    outlier_px: float = 40.0  # mean displacement of an outlier
    hidden_miss: float = 0.5  # a hidden joint is missing; otherwise its position is guessed
    hidden_noise: float = 4.0  # noise of guessed joints, as a multiple of noise_px
    person_miss: float = 0.0  # a person is missing
    fewest_joints: int = 4  # people with fewer visible joints are missing
    limb_swap: float = 0.0  # left and right arms, or legs, are exchanged
    back_swap: float = 0.0  # all left and right joints are exchanged, for people seen from behind
    duplicate: float = 0.0  # a person is reported twice
    merge: float = 0.0  # two people who overlap in the image exchange or share joints
    ghosts: float = 0.0  # mean number of false people per view
    hold: int = 1  # number of consecutive frames with the same person misses and swaps


CLEAN = Degradation()
MILD = Degradation(
    noise_px=1.5,
    joint_miss=0.05,
    outlier=0.01,
    person_miss=0.02,
    limb_swap=0.01,
    back_swap=0.01,
    merge=0.02,
    ghosts=0.05,
)
NOISY = Degradation(
    noise_px=2.0,
    joint_miss=0.10,
    outlier=0.03,
    person_miss=0.05,
    limb_swap=0.02,
    back_swap=0.02,
    duplicate=0.02,
    merge=0.05,
    ghosts=0.2,
)
