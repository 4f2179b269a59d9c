"""Joints of people whom one or two views show, placed by their bodies.

With many views, a joint on which no two of them agree is better left out. With two, each error of one of
them would lose the joint, and with a shoulder the torso. So joints that these two dispute, or that one of
them shows, are estimated together with those on which they agree (`solving.bodies`), with the bones of the
other side.

Of somebody who is followed more is known: where every joint should be now and how exactly, and, learnt while
many views saw the person, how long the bones are. Then the rays of one view are enough. Depth that nothing
but the prediction tells becomes less and less certain, until the joint is given up.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.assembly.judgement import FEW_VIEWS, Joints
from panoptic_ros.domain import Prediction
from panoptic_ros.domain.of_all import joined, selected
from panoptic_ros.geometry.symmetric import invert_symmetric, largest_eigenvalue, solve_symmetric
from panoptic_ros.kernels import njit
from panoptic_ros.solving.bodies import Body, Known, Rays, begin, estimate
from panoptic_ros.solving.joint_records import Candidates
from panoptic_ros.solving.scene import SEEN, Observations, Scene, look_at

Array = np.ndarray

FEW_SEEING = 3  # people whom more views should see may be false
FEWEST_JOINTS = 4  # of the 2D people, below which nobody is held
PLACE = 0.01  # m, added to the standard deviation of predictions
UNSEEN = 10.0  # m/s, by which the predictions of joints that no view shows are less certain
TURNING = 0.9  # m/s, standard deviation by which vectors along bones change that are seen
STRAYING, SWINGING = 0.5, 4.0  # m/s, and of others: of a body that stands, and more per m/s of a moving one
RISING = 0.15  # m/s, standard deviation of the motion of the trunk up and down
BONE, BONE_MEMORY = 0.015, 0.5  # m, by which bones differ from their learnt length, alike for so many s
SIDES = 0.1  # m, by which bones differ from those of the other side
GROWTH = 5.0  # of covariances: learnt bones and 2D joints err much the same from frame to frame
WORST_FIT = 4.0  # standard deviations, median of the rays of somebody who is where the prediction says
LEVEL = 10.0  # weight of the right axes of cameras against their upper edges
SAME_PLACE = 0.5  # m, median distance of the joints of one person


class Shown(NamedTuple):
    """What the 2D people of P candidates show, and who these are: see `Candidates` and its guides.

    member (P, V), source (P, V, J), who (P,), expected (P, J, 3) m, shifts (P, J, 3) m/s; scores and tails
    (D, J) of the 2D joints, see `judge_joints`.
    """

    member: Array
    source: Array
    who: Array
    expected: Array
    shifts: Array
    scores: Array
    tails: Array
    seen: Observations

    @classmethod
    def of(cls, scene: Scene, found: Candidates, tails: Array) -> Shown:
        """In a scene; tails: (D, J) of the 2D joints."""
        guide, scores = found.guide, scene.evidence.scores
        return cls(
            found.member,
            found.source,
            found.who,
            guide.positions,
            guide.shifts,
            scores,
            tails,
            scene.observations,
        )


class Followed(NamedTuple):
    """Everybody who is followed, see `Prediction`, and which way (3,) is up."""

    positions: Array
    velocities: Array
    ages: Array
    variances: Array
    lengths: Array
    up: Array


def hold_people(
    people: tuple[Array, Array, Joints],
    scene: Scene,
    shown: Shown,
    prediction: Prediction,
    body: Body,
    worst: float,
) -> tuple[Array, Joints, Array]:
    """The people that were kept and those who can be held besides, with joints that are placed.

    Args:
        people: rows of the candidates who are followed and of few views; of those that were kept; the joints
            of these. shown: what 2D people show of the candidates.
        worst: m, standard deviation beyond which a joint is given up.

    Returns:
        rows of the candidates, joints, and which joints (P, J) were placed.
    """
    few, kept, joints = people
    held = np.setdiff1d(few, kept)
    p, up = prediction, upwards(scene.cams.rotations[np.unique(scene.evidence.view)])  # others look anywhere
    followed = Followed(p.positions, p.velocities, p.ages, p.variances, p.lengths, up)
    rows, nothing = np.concatenate([kept, held]), Joints.nothing(len(held), joints.views.shape[1])
    joints = joined(joints, nothing)
    there, placed = hold_joints(rows, len(kept), shown, followed, joints, body, worst)
    return rows[there], selected(joints, there), placed[there]


@njit(cache=True, error_model="numpy")
def place_joints(rows, shown, joints, body, sight):
    """Place missing joints of people `rows` (K,) of few views, in place, that these views show.

    Whom more views should see may be false.

    Args:
        joints: of all candidates. sight: of the scene.
    """
    for k in rows:
        found = look_at(joints.positions[k], shown.seen.cams, sight)
        if np.sum(found == SEEN) > FEW_SEEING or not np.isnan(joints.positions[k, :, 0]).any():
            continue
        rays, scores, number = _rays_of(shown, k)
        known = _of_solved(joints, k, body)
        begin(known, rays, body, shown.expected[k])
        places, covariances, _ = estimate(known, rays, body)
        for j in range(len(number)):
            if np.isnan(joints.positions[k, j, 0]) and np.isfinite(places[j, 0]):
                joints.positions[k, j], joints.covariances[k, j] = places[j], covariances[j]
                joints.scores[k, j], joints.views[k, j] = scores[j], number[j]


@njit(cache=True, error_model="numpy")
def hold_joints(rows, kept, shown, followed, joints, body, worst):
    """The loop of `hold_people` over candidates `rows` (K,), of whom the first `kept` are people already.

    Returns:
        who are people (K,), and which joints (K, J) were placed.
    """
    there, placed = np.arange(len(rows)) < kept, np.zeros(joints.views.shape, np.bool_)
    fresh = joints.positions[:kept][shown.who[rows[:kept]] < 0]
    for row in range(len(rows)):
        k, who = rows[row], shown.who[rows[row]]
        few = 1 <= np.sum(shown.member[k] >= 0) <= FEW_VIEWS
        if who < 0 or not few or not np.isnan(joints.positions[row, :, 0]).any():
            continue
        rays, scores, number = _rays_of(shown, k)
        if np.sum(number > 0) < FEWEST_JOINTS:
            continue
        known = _expected(followed, who, number > 0, body)
        _take_solved(known, joints, row)
        places, covariances, residuals = estimate(known, rays, body)
        fits = residuals.ravel()[np.isfinite(residuals.ravel())]
        if not len(fits) or np.median(fits) > WORST_FIT:
            continue
        for j in range(len(number)):
            sure = GROWTH * largest_eigenvalue(covariances[j]) <= worst**2  # False for NaN
            placed[row, j] = sure and np.isnan(joints.positions[row, j, 0])
            if not placed[row, j]:
                places[j] = np.nan
        there[row] |= placed[row].any() and not _is_there(places, fresh)
        placed[row] &= there[row]
        for j in np.flatnonzero(placed[row]):
            joints.positions[row, j], joints.covariances[row, j] = places[j], GROWTH * covariances[j]
            joints.scores[row, j], joints.views[row, j] = 0.5 * scores[j], number[j]
    return there, placed


@njit(cache=True, error_model="numpy")
def _is_there(person, others):
    """Whether a person (J, 3) m stands where one of others (P, J, 3) m, who are new, was found."""
    gaps = np.empty(len(person))
    for other in others:
        count = 0
        for j in range(len(person)):
            gap = np.sqrt(np.sum((person[j] - other[j]) ** 2))
            if np.isfinite(gap):
                gaps[count] = gap
                count += 1
        if count and np.median(gaps[:count]) < SAME_PLACE:
            return True
    return False


@njit(cache=True, error_model="numpy")
def upwards(rotations):
    """Which way (3,) is up, for cameras (V, 3, 3) that are hardly rolled: across all of their right axes.

    Where these leave a choice, it is the one nearest to the upper edges of the images.
    """
    across, edge, up = np.eye(3), np.zeros(3), np.zeros(3)
    for v in range(len(rotations)):
        for i in range(3):
            edge[i] -= rotations[v, 1, i]
            for k in range(3):
                across[i, k] += LEVEL * rotations[v, 0, i] * rotations[v, 0, k]
    lower = (across[0, 0], across[1, 0], across[1, 1], across[2, 0], across[2, 1], across[2, 2])
    _, up[0], up[1], up[2] = solve_symmetric(lower, (edge[0], edge[1], edge[2]))
    return up / max(np.sqrt(np.sum(up**2)), 1e-9)


@njit(cache=True, error_model="numpy")
def _rays_of(shown, k):
    """What the 2D people of candidate k show; mean scores (J,) and numbers (J,) of its rays."""
    views, joints = shown.source.shape[1:]
    scores, growth, number = np.zeros(joints), np.zeros(joints), np.zeros(joints, np.int64)
    for v in range(views):
        d = shown.member[k, v]
        for j in range(joints if d >= 0 else 0):
            s = shown.source[k, v, j]
            if shown.seen.precision[d, s] > 0.0:
                number[j] += 1
                scores[j] += shown.scores[d, s]
                growth[j] += shown.tails[d, s] ** 2
    rays = Rays(
        shown.member[k], shown.source[k], shown.shifts[k], np.sqrt(growth / np.maximum(number, 1)), shown.seen
    )
    return rays, scores / np.maximum(number, 1), number


@njit(cache=True, error_model="numpy")
def _of_solved(joints, row, body):
    """The joints of a person that are solved, and nothing else."""
    count, bones = joints.positions.shape[1], len(body.bones)
    known = Known(
        np.full((count, 3), np.nan),
        np.zeros((count, 3, 3)),
        np.zeros((bones, 3)),
        np.full(bones, np.inf),
        np.full(bones, np.nan),
        np.full(bones, SIDES),
        np.zeros((count, 3)),
        np.zeros(3),
        np.inf,
    )
    _take_solved(known, joints, row)
    return known


@njit(cache=True, error_model="numpy")
def _take_solved(known, joints, row):
    """Enter the joints of a person that are solved into what is known, in place."""
    for j in range(len(known.places)):
        if np.isfinite(joints.positions[row, j, 0]):
            known.places[j] = joints.positions[row, j]
            invert_symmetric(joints.covariances[row, j], 1.0, known.information[j])


@njit(cache=True, error_model="numpy")
def _expected(followed, who, shown, body):
    """What is known of a person who is followed, of whom some joints are shown (J,).

    Joints that no view shows do not go on as they moved: they keep their place in the body.
    """
    places, speeds, bones = followed.positions[who].copy(), followed.velocities[who], body.bones
    passed = max(followed.ages[who].min(), 1e-3)
    still, information = places - passed * speeds, np.zeros((len(places), 3, 3))
    pace, count = np.empty(len(places)), 0
    for j in range(len(places)):
        variance = followed.variances[who, j, 0] + PLACE**2
        if shown[j]:
            pace[count] = np.sqrt(np.sum(speeds[j] ** 2))
            count += 1
        else:
            variance += (UNSEEN * passed) ** 2
        if np.isfinite(places[j, 0]):
            for i in range(3):
                information[j, i, i] = 1.0 / variance
    straying = STRAYING + SWINGING * np.median(pace[:count])
    vectors, slack = np.zeros((len(bones), 3)), np.full(len(bones), np.inf)
    for b in range(len(bones)):
        start, end = bones[b]
        both = shown[start] and shown[end]
        vector = places[end] - places[start] if both else still[end] - still[start]
        if np.isfinite(vector[0]):
            vectors[b] = vector
            slack[b] = (TURNING if both else straying) * passed + 0.5 * PLACE
    bone = BONE * np.sqrt(max(1.0, BONE_MEMORY / passed))
    return Known(
        places,
        information,
        vectors,
        slack,
        followed.lengths[who].copy(),
        np.full(len(bones), bone),
        still,
        followed.up,
        RISING * passed,
    )
