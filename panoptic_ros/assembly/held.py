"""People whom one or two views show, held by the lengths of their bones.

A joint needs two views to be solved. Of somebody who is followed more is known: where every joint should be
now and how exactly, and, learnt while many views saw the person, how long the bones are. With these a
single ray places a joint. All joints of the person are estimated together, as the maximum a posteriori
under

* the prediction of each joint, with the variance of its filter;
* the predicted vector along each bone, which changes slowly: parts that no view shows move with the rest;
* the learnt lengths of bones;
* people move on the ground, and their trunk as a whole hardly up or down: with the rays that tells depth;
* the rays of the joints that are seen, with Cauchy weights;
* the joints that two views have solved, with their covariances.

Gauss-Newton from the prediction; covariances are blocks of the inverse of the normal matrix, so depth that
nothing but the prediction tells becomes less and less certain, until the joint is given up.
"""
from __future__ import annotations

import numpy as np

from panoptic_ros.assembly.body_estimate import Body, Known, Rays, estimate
from panoptic_ros.assembly.judgement import Joints
from panoptic_ros.domain import Prediction
from panoptic_ros.solving.joint_records import Candidates
from panoptic_ros.solving.scene import Scene

Array = np.ndarray

FEW_VIEWS = 2  # people whom more views show need no help
FEWEST_JOINTS = 4  # of the 2D people, below which nobody is held
PLACE = 0.01  # m, added to the standard deviation of predictions
UNSEEN = 10.0  # m/s, by which the predictions of joints that no view shows are less certain
TURNING = 0.9  # m/s, standard deviation by which vectors along bones change that are seen
STRAYING, SWINGING = 0.5, 4.0  # m/s, and of others: of a body that stands, and more per m/s of a moving one
RISING = 0.15  # m/s, standard deviation of the motion of the trunk up and down
BONE, BONE_MEMORY = 0.015, 0.5  # m, by which bones differ from their learnt length, alike for so many s
WORST_FIT = 4.0  # standard deviations, median of the rays of somebody who is where the prediction says
LEVEL = 10.0  # weight of the right axes of cameras against their upper edges


def hold_people(
    scene: Scene, found: Candidates, prediction: Prediction, kept: Array, joints: Joints, body: Body,
    worst: float,
) -> tuple[Array, Joints, Array]:  # fmt: skip
    """The people that were kept and those who can be held besides, with joints that bones place.

    Args:
        kept: (P,) rows of the candidates, whose joints are `joints`.
        worst: m, standard deviation beyond which a joint is given up.

    Returns:
        rows of the candidates, joints, and which joints (P, J) bones have placed.
    """
    views = (found.grouping.member >= 0).sum(axis=1)
    wanted = (found.who >= 0) & (views >= 1) & (views <= FEW_VIEWS)
    if not wanted.any() or prediction.lengths.shape[1] != len(body.bones):
        return kept, joints, np.zeros(joints.views.shape, bool)
    row_of = {int(k): row for row, k in enumerate(kept)}
    fresh = joints.positions[found.who[kept] < 0]
    count, nodes = len(kept), joints.views.shape[1]
    rows, more, placed = [], [], np.zeros((count, nodes), bool)
    for k in np.flatnonzero(wanted).tolist():
        row = row_of.get(k)
        if row is not None and np.isfinite(joints.positions[row, :, 0]).all():
            continue
        own = None if row is None else joints.rows(np.array([row]))
        held = _hold(scene, found, prediction, k, own, body, worst)
        if held is None or (row is None and _is_there(held.positions[0], fresh)):
            continue
        there = np.isfinite(held.positions[0, :, 0])
        if row is None:
            rows.append(k)
            more.append(held)
            placed = np.concatenate([placed, there[None]])
            continue
        there &= np.isnan(joints.positions[row, :, 0])
        placed[row] = there
        for name in ("positions", "covariances", "scores", "views"):
            getattr(joints, name)[row, there] = getattr(held, name)[0, there]
    if rows:
        joints = Joints(*(
            np.concatenate([getattr(part, name) for part in (joints, *more)])
            for name in ("positions", "covariances", "scores", "views", "doubts")
        ))  # fmt: skip
    return np.concatenate([kept, np.array(rows, kept.dtype)]), joints, placed


def _is_there(person: Array, others: Array) -> bool:
    """Whether a person (J, 3) stands where one of others (P, J, 3), who are new, was found."""
    for other in others:
        gaps = np.linalg.norm(person - other, axis=-1)
        known = np.isfinite(gaps)
        if known.any() and np.median(gaps[known]) < 0.5:
            return True
    return False


def _hold(
    scene: Scene, found: Candidates, prediction: Prediction, k: int, own: Joints | None, body: Body,
    worst: float,
) -> Joints | None:  # fmt: skip
    """The joints of candidate k, or None if what is seen is not this person."""
    rays = _rays_of(scene, found, k)
    if len(set(rays.joints.tolist())) < FEWEST_JOINTS:
        return None
    up = upwards(scene.cams.rotations[np.unique(scene.evidence.view)])  # others may look anywhere
    known = _known(prediction, int(found.who[k]), own, np.unique(rays.joints), body, up)
    active = np.flatnonzero(np.isfinite(known.places[:, 0]))
    rays = Rays(*(part[np.isin(rays.joints, active)] for part in rays))
    places, covariances, residuals = estimate(known, rays, body)
    if not len(residuals) or np.median(residuals) > WORST_FIT:
        return None
    largest = np.linalg.eigvalsh(np.where(np.isfinite(covariances), covariances, 1e6 * np.eye(3)))[:, -1]
    good = np.isfinite(places[:, 0]) & (largest <= worst**2)
    seen = np.bincount(rays.joints, minlength=len(places))
    scores = np.zeros(len(places))
    member = found.grouping.member[k]
    for v in np.flatnonzero(member >= 0):
        scores = np.maximum(scores, scene.evidence.scores[member[v], found.source[k, v]])
    covariances = np.where(good[:, None, None], covariances, np.nan)
    places, scores = np.where(good[:, None], places, np.nan), np.where(good, 0.5 * scores, 0.0)
    views, doubts = np.where(good, seen, 0), np.zeros(len(places))
    return Joints(places[None], covariances[None], scores[None], views[None], doubts[None])


def upwards(rotations: Array) -> Array:
    """Which way (3,) is up, for cameras (V, 3, 3) that are hardly rolled: across all of their right axes.

    Where these leave a choice, it is the one nearest to the upper edges of the images.
    """
    across = LEVEL * np.einsum("vi,vj->ij", rotations[:, 0], rotations[:, 0])
    found: Array = np.linalg.solve(across + np.eye(3), -rotations[:, 1].sum(axis=0))
    return found / max(float(np.linalg.norm(found)), 1e-9)


def _rays_of(scene: Scene, found: Candidates, k: int) -> Rays:
    """What the 2D people of candidate k show; moving joints were elsewhere when a view looked."""
    parts = []
    for v in np.flatnonzero(found.grouping.member[k] >= 0):
        row, source = found.grouping.member[k, v], found.source[k, v]
        joints = np.flatnonzero(scene.precision[row, source] > 0.0)
        rotation, origin = scene.cams.rotations[v], scene.cams.translations[v]
        shifts = scene.cams.delays[v] * found.guide.shifts[k, joints]
        parts.append(Rays(
            joints, scene.evidence.plane[row, source[joints]], scene.precision[row, source[joints]],
            np.tile(rotation, (len(joints), 1, 1)), origin + shifts @ rotation.T,
        ))  # fmt: skip
    return Rays(*(np.concatenate(columns) for columns in zip(*parts)))


def _known(prediction: Prediction, who: int, own: Joints | None, seen: Array, body: Body, up: Array) -> Known:
    """What is known of a person who is followed: the prediction, or what two views have solved.

    Joints that no view shows do not go on as they moved: they keep their place in the body.
    """
    bones = body.bones
    places, ages = prediction.positions[who].copy(), prediction.ages[who]
    passed = float(ages.min())
    variances = prediction.variances[who, :, 0] + PLACE**2
    shown = np.zeros(len(places), bool)
    shown[seen] = True
    variances[~shown] += (UNSEEN * passed) ** 2
    information = np.eye(3) / variances[:, None, None]
    still = places - passed * prediction.velocities[who]
    both = shown[bones].all(axis=1)[:, None]
    vectors = np.where(
        both, places[bones[:, 1]] - places[bones[:, 0]], still[bones[:, 1]] - still[bones[:, 0]]
    )
    if own is not None:
        solved = np.isfinite(own.positions[0, :, 0])
        places[solved] = own.positions[0, solved]
        information[solved] = np.linalg.inv(own.covariances[0, solved])
    speed = float(np.median(np.linalg.norm(prediction.velocities[who, seen], axis=-1)))
    slack = np.where(both[:, 0], TURNING, STRAYING + SWINGING * speed) * passed + 0.5 * PLACE
    bone = BONE * np.sqrt(max(1.0, BONE_MEMORY / max(passed, 1e-3)))
    rise = RISING * max(passed, 1e-3)
    return Known(places, information, vectors, slack, prediction.lengths[who], bone, still, up, rise)
