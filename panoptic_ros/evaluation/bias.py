"""A detector's constant biases against a reference, and what taking them out is worth.

Malleson et al. 2020, 3.3.2: the offset of a joint is the per-axis median over all frames, here in the frame
of the estimated torso, scaled by its length, and the same on both sides. It is a property of the detector
AND of what the reference calls a joint; so it is measured on some people and judged on others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import BiasTable
from panoptic_ros.evaluation.joint_scores import NAN
from panoptic_ros.evaluation.pairing import FramePair, pairs_in_turn
from panoptic_ros.evaluation.sequences import SkeletonSequence
from panoptic_ros.geometry.torso import torso_frames
from panoptic_ros.stage import Progress, Recording, StageContext, each, part_of, untold

Array = np.ndarray

PCK_DISTANCE = 0.05  # m
PAIRED = 0.6  # share of the time that pairing people takes


@dataclass(frozen=True, slots=True, eq=False)
class MatchedPeople:
    """M estimated people with their truth: ids (M,) of the truth, truth and result (M, J, 3) m."""

    ids: Array
    truth: Array
    result: Array

    def rows(self, which: Array) -> MatchedPeople:
        """Some of them."""
        return MatchedPeople(self.ids[which], self.truth[which], self.result[which])


@dataclass(frozen=True, slots=True)
class Benefit:
    """Joint errors of one person before and after: medians in mm, PCK at 5 cm in 0..1 of true joints."""

    person: int
    median_before: float
    median_after: float
    pck_before: float
    pck_after: float


@dataclass(frozen=True, slots=True)
class BiasConfig:
    """What `BiasPass` needs to know.

    Args:
        joint_names: of truth and result. torso: see `torso_frames`. mirror: see `measure_offsets`.
        leave_out: people of the truth on whom nothing is measured.
    """

    joint_names: tuple[str, ...]
    torso: tuple[int, int, int, int]
    mirror: tuple[int, ...]
    leave_out: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredBiases:
    """The biases of J joints.

    Args:
        offsets: (J, 3), see `measure_offsets`.
        found: ids of the people of the truth who are in the result. measured: of those who were measured.
        skeletons: how many of theirs were measured.
        benefits: what offsets measured on all others are worth for each person; none for one person alone.
    """

    offsets: Array
    found: tuple[int, ...]
    measured: tuple[int, ...]
    skeletons: int
    benefits: tuple[Benefit, ...]


class BiasPass:
    """A detector's biases from a recording of "truth" and "skeletons" (`SkeletonFrame`s): a `stage.Pass`."""

    def __init__(self, config: BiasConfig, context: StageContext | None = None):
        self._config = config

    def run(self, recording: Recording, progress: Progress) -> MeasuredBiases:
        """The biases; NaN where nobody is found."""
        config, mirror = self._config, np.array(self._config.mirror)
        truth, result = (
            SkeletonSequence(config.joint_names, tuple(recording.records(topic)))
            for topic in ("truth", "skeletons")
        )
        told = part_of(progress, 0.0, PAIRED)
        people = matched_people(
            list(each(pairs_in_turn(truth, result), len(truth.frames), told, "pairing people"))
        )
        kept = people.rows(~np.isin(people.ids, config.leave_out))
        offsets = measure_offsets(kept, config.torso, mirror)
        told = part_of(progress, PAIRED, 1.0)
        return MeasuredBiases(
            offsets,
            tuple(np.unique(people.ids).tolist()),
            tuple(np.unique(kept.ids).tolist()),
            len(kept.ids),
            tuple(leave_one_out(people, config.torso, mirror, told)),
        )


def matched_people(pairs: Sequence[FramePair]) -> MatchedPeople:
    """All matches of all frames."""
    joints = pairs[0].truth.shape[1] if pairs else 0
    empty = np.empty((0, joints, 3))
    return MatchedPeople(
        np.concatenate([np.empty(0, np.int64), *(pair.truth_ids[pair.matches[:, 0]] for pair in pairs)]),
        np.concatenate([empty, *(pair.truth[pair.matches[:, 0]] for pair in pairs)]),
        np.concatenate([empty, *(pair.result[pair.matches[:, 1]] for pair in pairs)]),
    )


def measure_offsets(people: MatchedPeople, torso: tuple[int, int, int, int], mirror: Array) -> Array:
    """Offsets (J, 3) from result to truth: forward, left, up, in torso lengths; NaN = never seen.

    Args:
        mirror: (J,) the joint on the other side, itself in the middle.
    """
    axes, lengths = torso_frames(people.result[:, list(torso)])
    local = np.einsum("mik,mji->mjk", axes, people.truth - people.result) / lengths[:, None, None]
    flipped = local[:, mirror] * (1.0, -1.0, 1.0)  # what the other side says
    both = np.concatenate([local, flipped])
    seen = np.isfinite(both).all(axis=2).any(axis=0)
    offsets = np.full((people.truth.shape[1], 3), np.nan)
    if seen.any():
        offsets[seen] = np.nanmedian(both[:, seen], axis=0)
    return offsets


def leave_one_out(
    people: MatchedPeople, torso: tuple[int, int, int, int], mirror: Array, progress: Progress = untold
) -> list[Benefit]:
    """For every person, what the offsets measured on all others are worth; nothing for one person alone."""
    persons = np.unique(people.ids).tolist()
    benefits = []
    for person in each(persons if len(persons) > 1 else (), len(persons), progress, "judging the biases"):
        own = people.ids == person
        offsets = measure_offsets(people.rows(~own), torso, mirror)
        benefits.append(benefit(people.rows(own), offsets, torso))
    return benefits


def benefit(people: MatchedPeople, offsets: Array, torso: tuple[int, int, int, int]) -> Benefit:
    """What offsets (J, 3) are worth for people, all of one id."""
    table = BiasTable("measured", np.nan_to_num(offsets), torso)
    person = int(people.ids[0])
    return Benefit(person, *scores_of(people.truth, people.result, table.corrected(people.result)))


def scores_of(truth: Array, before: Array, after: Array) -> tuple[float, float, float, float]:
    """Median errors, mm, and PCK at 5 cm of joints (M, J, 3) m before and after, in this order."""
    errors = [np.linalg.norm(truth - result, axis=-1) for result in (before, after)]
    known = int(np.isfinite(truth[..., 0]).sum())
    medians = [1e3 * float(np.nanmedian(e)) if np.isfinite(e).any() else NAN for e in errors]
    shares = [float((e < PCK_DISTANCE).sum()) / known if known else NAN for e in errors]
    return medians[0], medians[1], shares[0], shares[1]
