"""Constant biases of a detector against a reference, and the benefit of removing them.

After Malleson et al. 2020, 3.3.2, the offset of a joint is the per-axis median over all frames. Here it is
expressed in the frame of the estimated torso, scaled by the torso length, and mirrored between the sides. The
offset depends on the detector AND on the joint definition of the reference. So it is measured on some people
and evaluated on others.
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

PCK_DISTANCE = 0.05  # m; error threshold of PCK
PAIRED = 0.6  # share of the running time for pairing people


@dataclass(frozen=True, slots=True, eq=False)
class MatchedPeople:
    """M estimated people matched with their ground truth.

    Args:
        ids: Truth ids (M,).
        truth: True joints (M, J, 3) m.
        result: Estimated joints (M, J, 3) m.
    """

    ids: Array
    truth: Array
    result: Array

    def rows(self, which: Array) -> MatchedPeople:
        """Return the rows selected by an index or mask."""
        return MatchedPeople(self.ids[which], self.truth[which], self.result[which])


@dataclass(frozen=True, slots=True)
class Benefit:
    """Joint errors of one person before and after removing the biases.

    Args:
        person: Truth id.
        median_before, median_after: Median error in mm.
        pck_before, pck_after: Share (0..1) of true joints with an error below 5 cm.
    """

    person: int
    median_before: float
    median_after: float
    pck_before: float
    pck_after: float


@dataclass(frozen=True, slots=True)
class BiasConfig:
    """Configuration of `BiasPass`.

    Args:
        joint_names: Joint names of truth and result.
        torso: Joint indices, see `torso_frames`.
        mirror: Index of each joint's opposite joint, see `measure_offsets`.
        leave_out: Truth ids of people who are excluded from the measurement.
    """

    joint_names: tuple[str, ...]
    torso: tuple[int, int, int, int]
    mirror: tuple[int, ...]
    leave_out: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredBiases:
    """Measured biases of J joints.

    Args:
        offsets: Offsets (J, 3), see `measure_offsets`.
        found: Truth ids of the people who are found in the result.
        measured: Truth ids of the people who were measured.
        skeletons: Number of measured skeletons.
        benefits: Benefit for each person of the offsets measured on all others; empty with only one person.
    """

    offsets: Array
    found: tuple[int, ...]
    measured: tuple[int, ...]
    skeletons: int
    benefits: tuple[Benefit, ...]


class BiasPass:
    """Pass (`stage.Pass`) that measures a detector's biases.

    It reads the topics "truth" and "skeletons" (`SkeletonFrame`s) of a recording.
    """

    def __init__(self, config: BiasConfig, context: StageContext | None = None):
        self._config = config

    def run(self, recording: Recording, progress: Progress) -> MeasuredBiases:
        """Return the biases; offsets are NaN where no person is found."""
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
    """Return all matches of all frames."""
    joints = pairs[0].truth.shape[1] if pairs else 0
    empty = np.empty((0, joints, 3))
    return MatchedPeople(
        np.concatenate([np.empty(0, np.int64), *(pair.truth_ids[pair.matches[:, 0]] for pair in pairs)]),
        np.concatenate([empty, *(pair.truth[pair.matches[:, 0]] for pair in pairs)]),
        np.concatenate([empty, *(pair.result[pair.matches[:, 1]] for pair in pairs)]),
    )


def measure_offsets(people: MatchedPeople, torso: tuple[int, int, int, int], mirror: Array) -> Array:
    """Return offsets (J, 3) from result to truth: forward, left, up, in torso lengths; NaN = never observed.

    Args:
        mirror: Index (J,) of the joint on the other side, or of the joint itself on the midline.
    """
    axes, lengths = torso_frames(people.result[:, list(torso)])
    local = np.einsum("mik,mji->mjk", axes, people.truth - people.result) / lengths[:, None, None]
    flipped = local[:, mirror] * (1.0, -1.0, 1.0)  # measurements of the opposite joint, mirrored
    both = np.concatenate([local, flipped])
    seen = np.isfinite(both).all(axis=2).any(axis=0)
    offsets = np.full((people.truth.shape[1], 3), np.nan)
    if seen.any():
        offsets[seen] = np.nanmedian(both[:, seen], axis=0)
    return offsets


def leave_one_out(
    people: MatchedPeople, torso: tuple[int, int, int, int], mirror: Array, progress: Progress = untold
) -> list[Benefit]:
    """Return each person's benefit from the offsets measured on all others.

    The list is empty with only one person.
    """
    persons = np.unique(people.ids).tolist()
    benefits = []
    for person in each(persons if len(persons) > 1 else (), len(persons), progress, "judging the biases"):
        own = people.ids == person
        offsets = measure_offsets(people.rows(~own), torso, mirror)
        benefits.append(benefit(people.rows(own), offsets, torso))
    return benefits


def benefit(people: MatchedPeople, offsets: Array, torso: tuple[int, int, int, int]) -> Benefit:
    """Return the benefit of offsets (J, 3) for people who all have the same id."""
    table = BiasTable("measured", np.nan_to_num(offsets), torso)
    person = int(people.ids[0])
    return Benefit(person, *scores_of(people.truth, people.result, table.corrected(people.result)))


def scores_of(truth: Array, before: Array, after: Array) -> tuple[float, float, float, float]:
    """Return scores of joints (M, J, 3) m before and after a correction.

    Returns:
        Median error (mm) before, median error after, PCK at 5 cm before, PCK at 5 cm after.
    """
    errors = [np.linalg.norm(truth - result, axis=-1) for result in (before, after)]
    known = int(np.isfinite(truth[..., 0]).sum())
    medians = [1e3 * float(np.nanmedian(e)) if np.isfinite(e).any() else NAN for e in errors]
    shares = [float((e < PCK_DISTANCE).sum()) / known if known else NAN for e in errors]
    return medians[0], medians[1], shares[0], shares[1]
