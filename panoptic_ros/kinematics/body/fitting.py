"""Fit of the skeleton of segments to moving 3D joints: first the lengths, then a pose for every frame.

`with_trunk` adds the proximal joints of pelvis and neck. It derives them from hips, shoulders and the
proportions of the skeleton.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.segments import SHORTEST, TALLEST, SegmentModel
from panoptic_ros.errors import DataError
from panoptic_ros.geometry.chain import Pose, place_all
from panoptic_ros.geometry.rotations import turn_about_z, vectors_of
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kinematics.pose.solve import solve_pose
from panoptic_ros.kinematics.pose.targets import (
    NO_FLOOR,
    NO_HINGES,
    NO_TURNS,
    NO_VIEWS,
    PointTargets,
    PoseEvidence,
    PosePrior,
    no_anchor,
)

Array = np.ndarray

HIPS, SHOULDERS = ("lThigh", "rThigh"), ("lUpperArm", "rUpperArm")
BETWEEN = {"hips": HIPS, "neck": SHOULDERS}
# standard deviations: m, joints; rad, from the T posture; rad, beyond limits
JOINT_SD, REST_SD, LIMIT_SD = 0.01, 0.7, math.radians(5.0)
FIRST_ITERATIONS, ITERATIONS = 100, 30
FEWEST = 10  # minimum number of joints of a motion that the skeleton has
NEEDED = ("hips", "neck", "lThigh", "rThigh")


def with_trunk(
    model: SegmentModel, sites: Mapping[str, Site], names: Sequence[str], joints: Array
) -> tuple[tuple[str, ...], Array]:
    """Return names and joints (T, J, 3) m, with the proximal joints of hips and neck added where missing.

    Each added joint lies on the trunk axis through the middle of the hips or shoulders. Its distance from
    that middle is that of the T posture, scaled by the distance between the two hips or shoulders.

    Args:
        sites: Locations of joints, by name.
    """
    begins = {name: model.names[site.segment] for name, site in sites.items() if not np.any(site.share)}
    begun = {begins[name]: k for k, name in enumerate(names) if name in begins}
    if any(segment not in begun for segment in (*HIPS, *SHOULDERS)):
        return tuple(names), joints
    middles = [sum(joints[:, begun[segment]] for segment in pair) / 2.0 for pair in (HIPS, SHOULDERS)]
    up = middles[1] - middles[0]
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    heights, found, added = _t_posture(model), list(names), [joints]
    for (segment, pair), middle in zip(BETWEEN.items(), middles):
        if segment in begun:
            continue
        one, other = (heights[model.index(end)] for end in pair)
        above = heights[model.index(segment), 2] - (one + other)[2] / 2.0
        apart = np.linalg.norm(joints[:, begun[pair[0]]] - joints[:, begun[pair[1]]], axis=-1)
        length = above / np.linalg.norm(one - other) * np.nanmedian(apart)
        found.append(next(name for name, owner in begins.items() if owner == segment))
        added.append((middle + length * up)[:, None])
    return tuple(found), np.concatenate(added, axis=1)


def _t_posture(model: SegmentModel) -> Array:
    """Return the positions (S, 3) of the joints in a T, as fractions of the stature."""
    places = model.body(1.0).offsets.copy()
    for s, parent in enumerate(model.parents):
        if parent >= 0:
            places[s] += places[parent]
    return places


class Site(NamedTuple):
    """Location of a joint: segment, and position (3,) in its frame as fractions of the stature."""

    segment: int
    share: Array


class FittedMotion(NamedTuple):
    """Motion of the fitted skeleton.

    Attributes:
        roots, vectors: (T, 3) m and (T, S, 3) rad, positions of the root and rotation vectors.
        offsets, stature: (S, 3) m, joints in the frames of their parents, and m.
        residual: m, root mean square distance of the joints.
    """

    roots: Array
    vectors: Array
    offsets: Array
    stature: float
    residual: float


def fit_motion(
    model: SegmentModel, sites: Mapping[str, Site], names: Sequence[str], joints: Array
) -> FittedMotion:
    """Return the poses of the skeleton for joints (T, J, 3) m, z up; NaN = missing.

    Lengths are median distances between joints, with left and right equal.

    Args:
        sites: Locations of joints, by name.

    Raises:
        DataError: If too few joints are on the skeleton.
    """
    used = [k for k, name in enumerate(names) if name in sites]
    begun = {sites[names[k]].segment: k for k in used if not np.any(sites[names[k]].share)}
    lacking = [name for name in NEEDED if model.index(name) not in begun]
    if len(used) < FEWEST or lacking:
        raise DataError(
            f"{len(used)} joints are known by their names ({', '.join(names[k] for k in used) or 'none'}), "
            f"lacking {', '.join(lacking) or 'others'}; see config/bodies/motion_joints.yaml"
        )
    stature, offsets = _lengths(model, begun, joints)
    segments = np.array([sites[names[k]].segment for k in used], np.int64)
    places = stature * np.array([sites[names[k]].share for k in used])
    poses, residual = _follow(
        model,
        Chain(model.parents, offsets),
        _first(model, begun, joints[0]),
        (segments, places, joints[:, used]),
    )
    roots, vectors = np.array([p.root for p in poses]), np.array([vectors_of(p.turns) for p in poses])
    return FittedMotion(roots, vectors, offsets, stature, residual)


def _follow(
    model: SegmentModel, chain: Chain, first: Pose, seen: tuple[Array, Array, Array]
) -> tuple[list[Pose], float]:
    """Return the pose of every frame, and the root mean square distance of the joints, m.

    The optimisation of each pose starts from the pose of the previous frame.

    Args:
        seen: Segments (J,), positions (J, 3) m on the segments, and joints (T, J, 3) m.
    """
    segments, places, joints = seen
    prior, count, pose = _rest(model), len(chain.parents), first.copy()
    poses, square, number = [], 0.0, 0
    hessian = np.empty((3 + 3 * count, 3 + 3 * count))
    for t, frame in enumerate(joints):
        there = np.flatnonzero(np.isfinite(frame).all(-1))
        goals = np.ascontiguousarray(frame[there])
        information = np.tile(np.eye(3) / JOINT_SD**2, (len(there), 1, 1))
        targets = PointTargets(segments[there], places[there], goals, information, 0.0)
        evidence = PoseEvidence(NO_VIEWS, targets, NO_TURNS, NO_FLOOR, prior, 1.0)
        rounds = ITERATIONS if t else FIRST_ITERATIONS
        solve_pose(chain, pose, evidence, no_anchor(count), rounds, hessian)
        poses.append(pose.copy())
        sites, frames = place_all(chain, pose.root[None], pose.turns[None])
        found = sites[0, segments] + (frames[0, segments] @ places[..., None])[..., 0]
        square += float(((found[there] - goals) ** 2).sum())
        number += len(there)
    return poses, math.sqrt(square / max(number, 1))


def _lengths(model: SegmentModel, begun: Mapping[int, int], joints: Array) -> tuple[float, Array]:
    """Return the stature, m, and the offsets (S, 3) m of the joints.

    Limbs, head and widths are median distances between joints, with left and right equal. The trunk has the
    largest distance from hips to neck.
    """
    shares, factors = model.shares, {}
    for s, k in begun.items():
        parent = int(model.parents[s])
        if parent in begun and model.names[s][0] in "lr" and model.names[parent][0] in "lr":
            apart = np.linalg.norm(joints[:, k] - joints[:, begun[parent]], axis=-1)
            factors[s] = float(np.nanmedian(apart)) / float(np.linalg.norm(shares[s]))
    stature = float(np.clip(np.median(list(factors.values())), SHORTEST, TALLEST))
    offsets = stature * shares
    for s in factors:
        other = model.names.index({"l": "r", "r": "l"}[model.names[s][0]] + model.names[s][1:])
        offsets[s] = 0.5 * (factors[s] + factors.get(other, factors[s])) * shares[s]
    hips, neck = model.index("hips"), model.index("neck")
    above, s = [neck], int(model.parents[neck])
    while s != hips:
        above.append(s)
        s = int(model.parents[s])
    back = np.nanmax(np.linalg.norm(joints[:, begun[neck]] - joints[:, begun[hips]], axis=-1))
    offsets[above] *= float(back) / float(np.linalg.norm(offsets[above].sum(0)))
    if model.index("head") in begun:
        head = model.index("head")
        apart = np.nanmedian(np.linalg.norm(joints[:, begun[head]] - joints[:, begun[neck]], axis=-1))
        offsets[head] *= float(apart) / float(np.linalg.norm(offsets[head]))
    for left, right in (("lThigh", "rThigh"), ("lUpperArm", "rUpperArm")):
        pair = [model.index(left), model.index(right)]
        if all(p in begun for p in pair):
            wide = np.nanmedian(
                np.linalg.norm(joints[:, begun[pair[0]]] - joints[:, begun[pair[1]]], axis=-1)
            )
            offsets[pair, 1] = np.array([0.5, -0.5]) * float(wide)
    return stature, offsets


def _rest(model: SegmentModel) -> PosePrior:
    """Return a weak prior, which keeps undetermined angles near the T posture and within their limits."""
    n = 3 * len(model.names) - 3
    lower, upper = (np.ascontiguousarray(limit[1:].ravel()) for limit in (model.lower, model.upper))
    return PosePrior(
        np.zeros(n),
        np.zeros((n, n)),
        np.eye(n),
        lower,
        upper,
        0.0,
        0.0,
        REST_SD**-2,
        0.0,
        LIMIT_SD**-2,
        NO_HINGES,
    )


def _first(model: SegmentModel, begun: Mapping[int, int], joints: Array) -> Pose:
    """Return the initial pose: upright, with the heading of the hips."""
    turns = np.tile(np.eye(3), (len(model.names), 1, 1))
    left = joints[begun[model.index("lThigh")]] - joints[begun[model.index("rThigh")]]
    if np.isfinite(left).all():
        turns[0] = turn_about_z(math.atan2(-left[0], left[1]))
    root = joints[begun[model.index("hips")]]
    return Pose(np.where(np.isfinite(root), root, np.nanmean(joints, axis=0)), turns)
