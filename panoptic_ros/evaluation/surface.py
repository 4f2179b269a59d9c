"""Scores of patch association against known surface points.

The scores state whether patches lie on the assigned person and body part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from panoptic_ros.domain import PatchTrajectories, SkeletonModel
from panoptic_ros.domain.parts import Part, rigid_parts
from panoptic_ros.evaluation.pairing import FramePair

Array = np.ndarray
NEAR = 0.1  # m; beyond this distance from all surface points there is no body


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceTruth:
    """Surface points of P people, the same S points of each at every instant.

    Args:
        stamps_ns: Timestamps (F,).
        points: Points (F, P, S, 3) m.
        parts: Part (P, S) of each point as text, see `part_word`; "" where two parts meet.
    """

    stamps_ns: Array
    points: Array
    parts: Array


def part_word(part: Part, joint_names: Sequence[str]) -> str:
    """Return `torso`, `head`, or side and lower joint of a limb, as "l wrist"."""
    if not part.is_limb:
        return part.name
    name = joint_names[part.joints[1]].lower()
    return f"{name[0]} {next(word for word in ('elbow', 'wrist', 'knee', 'ankle') if word in name)}"


def association_scores(
    patches: Sequence[PatchTrajectories],
    pairs: Sequence[FramePair],
    truth: SurfaceTruth,
    skeleton: SkeletonModel,
) -> dict[str, float]:
    """Return shares of patches on people of the truth, at instants of the truth.

    on_part: Share on the right person and part, among patches whose nearest point belongs to a part. This is
    the precision of association of Joo et al. 2017, 6.2. wrong_person: Share whose nearest point belongs to
    another person. off_body: Share farther than `NEAR` from every point; these patches count in neither of
    the others. Values are NaN without patches.
    """
    words = np.array([part_word(part, skeleton.joint_names) for part in rigid_parts(skeleton)])
    owners = {pair.stamp_ns: _owners(pair, truth) for pair in pairs}
    rows = dict(zip(truth.stamps_ns.tolist(), range(len(truth.stamps_ns))))
    right, others, off = [np.zeros(0, bool)], [np.zeros(0, bool)], [np.zeros(0, bool)]
    per_person = truth.points.shape[2]
    for item in patches:
        own = owners.get(item.stamp_ns, {})
        known = np.isin(item.people, list(own))
        if item.stamp_ns not in rows or not known.any():
            continue
        people = np.array([own[number] for number in item.people[known].tolist()])
        points = truth.points[rows[item.stamp_ns]].reshape(-1, 3)
        far, nearest = cKDTree(points).query(item.positions[known])
        person, point = np.divmod(nearest, per_person)
        there, parts = np.less(far, NEAR), truth.parts[person, point]
        off.append(~there)
        others.append(np.not_equal(person, people)[there])
        same = np.equal(person, people) & np.equal(parts, words[item.parts[known]])
        right.append(same[there & np.not_equal(parts, "")])
    shares = {"on_part": right, "wrong_person": others, "off_body": off}
    return {name: _share(np.concatenate(values)) for name, values in shares.items()}


def _owners(pair: FramePair, truth: SurfaceTruth) -> Mapping[int, int]:
    """Return the surface person of every result id: the one nearest to the joints of its matched truth."""
    rows = np.flatnonzero(truth.stamps_ns == pair.stamp_ns)
    if not len(rows):
        return {}
    centres = truth.points[rows[0]].mean(axis=1)
    found = {}
    for (_, own), row in zip(pair.match_ids, pair.matches[:, 0]):
        away = np.linalg.norm(centres - np.nanmean(pair.truth[row], axis=0), axis=1)
        found[own] = int(np.argmin(away))
    return found


def _share(values: Array) -> float:
    return float(values.mean()) if len(values) else float("nan")
