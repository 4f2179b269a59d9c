"""Averaging of joints over neighbouring instants, after Joo et al. 2017, 6.3.

Each rigid part becomes the mean of up to three proposals. One is its measured position. The others are its
positions at the previous and the next instant (n = 1), propagated to this instant by the motion of the
surface. This method is the reference for the smoother, which also uses covariances.

The paper leaves two points open. Here each bone is a part of its own. A bone that belongs to no rigid part,
such as the neck, is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from panoptic_ros.domain import PartMotions, SkeletonModel
from panoptic_ros.domain.parts import rigid_parts
from panoptic_ros.geometry.rotations import rotation_of

Array = np.ndarray
Joints = dict[int, Array]  # joints (J, 3) m of each person by id, NaN = missing
Bones = list[tuple[tuple[int, int], int]]  # joints at both ends, index of the rigid part
Motions = Sequence[PartMotions | None]  # per instant, since the previous one; None = not measured
MOST = 30  # maximum number of rounds


def averaged(
    joints: Sequence[Joints], motions_on: Callable[[Sequence[Joints]], Motions], skeleton: SkeletonModel
) -> tuple[list[Joints], int]:
    """Return the averaged joints of each instant, and the number of rounds.

    Rounds are repeated until a round fills no further joint, at most `MOST` times.

    Args:
        joints: Measured joints of each instant.
        motions_on: Callback that associates patches with the given joints, and returns the motions of parts.
    """
    found, rounds, missing = list(joints), 0, _missing(joints)
    bones = _carried_bones(skeleton)
    while rounds < MOST:
        found = _round(found, motions_on(found), bones)
        rounds, before, missing = rounds + 1, missing, _missing(found)
        if missing == before:
            break
    return found, rounds


def _missing(joints: Sequence[Joints]) -> int:
    return sum(int(np.isnan(own[:, 0]).sum()) for instant in joints for own in instant.values())


def _carried_bones(skeleton: SkeletonModel) -> Bones:
    parts = rigid_parts(skeleton)
    return [
        ((a, b), number)
        for a, b in skeleton.bones
        for number, part in enumerate(parts)
        if a in part.joints and b in part.joints
    ]


def _round(joints: Sequence[Joints], motions: Motions, bones: Bones) -> list[Joints]:
    """Average each bone over its proposals, then each joint over its bones."""
    turns = [_by_part(own) for own in motions]
    found = []
    for t, instant in enumerate(joints):
        new = {}
        for person, own in instant.items():
            sums, counts = np.zeros_like(own), np.zeros(len(own))
            for ends, part in bones:
                proposals = [own[list(ends)]]
                if t > 0 and person in joints[t - 1] and (person, part) in turns[t]:
                    proposals.append(_moved(joints[t - 1][person][list(ends)], *turns[t][person, part]))
                if t + 1 < len(joints) and person in joints[t + 1] and (person, part) in turns[t + 1]:
                    proposals.append(_back(joints[t + 1][person][list(ends)], *turns[t + 1][person, part]))
                whole = [places for places in proposals if np.isfinite(places).all()]
                if whole:
                    sums[list(ends)] += np.mean(whole, axis=0)
                    counts[list(ends)] += 1.0
            there = counts > 0
            new[person] = np.where(there[:, None], sums / np.maximum(counts, 1.0)[:, None], own)
        found.append(new)
    return found


def _by_part(motions: PartMotions | None) -> dict[tuple[int, int], tuple[Array, Array, Array]]:
    """Return the rotation (3, 3), centre (3,) m and translation (3,) m of each (person, part)."""
    found = {}
    if motions is not None:
        for k, key in enumerate(zip(motions.people.tolist(), motions.parts.tolist())):
            rotation = np.empty((3, 3))
            rotation_of(motions.rotations[k], rotation)
            found[key] = rotation, motions.centres[k], motions.translations[k]
    return found


def _moved(places: Array, rotation: Array, centre: Array, translation: Array) -> Array:
    moved: Array = (places - centre) @ rotation.T + centre + translation
    return moved


def _back(places: Array, rotation: Array, centre: Array, translation: Array) -> Array:
    back: Array = (places - centre - translation) @ rotation + centre
    return back
