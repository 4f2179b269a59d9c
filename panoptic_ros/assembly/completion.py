"""Missing joints of tracked people and of people whom one or two views show, estimated for the whole body.

With many views, a joint of a new person on which no two views agree is better left out. With two views, each
error of one view would lose the joint, and the loss of a shoulder would lose the torso. So joints that the
two views dispute, or that one view shows, are estimated together with the joints on which they agree
(`solving.bodies`). Unknown bone lengths are those of the other side.

For a tracked person more is known: a predicted position with its uncertainty for every joint, and learnt
bone lengths. Then the rays of one view are sufficient, and every missing joint is estimated, whatever the
number of views. Depth that only the prediction determines becomes less and less certain, until the joint is
dropped.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.assembly.judgement import JointEstimates
from panoptic_ros.domain import Prediction
from panoptic_ros.domain.of_all import joined, selected
from panoptic_ros.geometry.symmetric import invert_symmetric, largest_eigenvalue, solve_symmetric
from panoptic_ros.kernels import njit
from panoptic_ros.solving.bodies import PersonPrior, PersonRays, SkeletonArrays, begin, estimate
from panoptic_ros.solving.joint_records import PersonCandidates
from panoptic_ros.solving.scene import SEEN, Scene, SceneObservations, look_at

Array = np.ndarray

# maximum number of views that should see a person of few views; a person whom more views should see may be
# false
FEW_SEEING = 3
FEWEST_JOINTS = 4  # minimum number of joints that views show of a held person
PLACE = 0.01  # m, added to the standard deviation of predictions in quadrature
UNSEEN = 10.0  # m/s, growth of the standard deviation of predicted joints that no view shows
TURNING = 0.9  # m/s, standard deviation of the change of bone vectors with both ends shown
# standard deviation of the change of other bone vectors: m/s for a standing body, and m/s per m/s of body
# speed
STRAYING, SWINGING = 0.5, 4.0
RISING = 0.15  # m/s, standard deviation of the vertical motion of the trunk
# m, standard deviation of bones from their learnt lengths; s, time for which a deviation persists
BONE, BONE_MEMORY = 0.015, 0.5
SIDES = 0.1  # m, standard deviation of bone lengths from those of the other side
GROWTH = 5.0  # factor on covariances: errors of learnt bones and 2D joints persist from frame to frame
WORST_FIT = 4.0  # standard deviations, largest median residual of a person's rays
LEVEL = 10.0  # weight of the right axes of cameras relative to the upper edges of their images
SAME_PLACE = 0.5  # m, median joint distance below which two skeletons are one person


class CandidateObservations(NamedTuple):
    """Observations of P candidates, with their predictions; see `PersonCandidates` and `JointPredictions`.

    Args:
        member: (P, V) row of the person's 2D pose in each view, -1 = none.
        source: (P, V, J) joint of that 2D pose that stands for joint j.
        who: (P,) row of the person in the `Prediction`, -1 = new.
        expected: (P, J, 3) m, world, predicted joints, NaN = none.
        shifts: (P, J, 3) m/s, velocities of the joints.
        scores: (D, J) of the 2D joints.
        tails: (D, J) of the 2D joints, see `judge_joints`.
        seen: All 2D joints of the instant.
    """

    member: Array
    source: Array
    who: Array
    expected: Array
    shifts: Array
    scores: Array
    tails: Array
    seen: SceneObservations

    @classmethod
    def of(cls, scene: Scene, found: PersonCandidates, tails: Array) -> CandidateObservations:
        """Return the observations of candidates in a scene.

        Args:
            tails: (D, J) of the 2D joints, see `judge_joints`.
        """
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


class TrackPredictions(NamedTuple):
    """Predictions of all tracked people, see `Prediction`.

    Args:
        up: (3,) upward unit vector, world.
    """

    positions: Array
    velocities: Array
    ages: Array
    variances: Array
    lengths: Array
    up: Array


def hold_people(
    people: tuple[Array, Array, JointEstimates],
    scene: Scene,
    shown: CandidateObservations,
    prediction: Prediction,
    body: SkeletonArrays,
    worst: float,
) -> tuple[Array, JointEstimates, Array]:
    """Return the kept people and the people that can be held in addition, with the joints placed here.

    Args:
        people: Tuple of three: rows of tracked candidates that a view shows; rows of the candidates that
            were kept; joints of the latter.
        shown: Observations of the candidates.
        worst: Standard deviation beyond which a joint is dropped, m.

    Returns:
        rows: (P,) rows of the candidates.
        joints: Joints of these people.
        placed: (P, J) whether a joint was placed here.
    """
    tracked, kept, joints = people
    beside = np.ones(len(shown.who), bool)
    beside[kept] = False
    held = tracked[beside[tracked]]
    p, up = prediction, upwards(scene.cams.rotations[np.unique(scene.evidence.view)])  # others point anywhere
    followed = TrackPredictions(p.positions, p.velocities, p.ages, p.variances, p.lengths, up)
    rows, nothing = np.concatenate([kept, held]), JointEstimates.nothing(len(held), joints.views.shape[1])
    joints = joined(joints, nothing)
    there, placed = hold_joints(rows, len(kept), shown, followed, joints, body, worst)
    return rows[there], selected(joints, there), placed[there]


@njit(cache=True, error_model="numpy")
def place_joints(rows, shown, joints, body, sight):
    """Write positions of missing joints that one or two views show to `joints`.

    People whom more than `FEW_SEEING` views should see are left out, because such people may be false.

    Args:
        rows: (K,) rows of candidates with few views.
        shown: Observations of the candidates.
        joints: Joints of all candidates, updated.
        sight: Fields of view of the scene.
    """
    for k in rows:
        found = look_at(joints.positions[k], shown.seen.cams, sight)
        if np.sum(found == SEEN) > FEW_SEEING or not np.isnan(joints.positions[k, :, 0]).any():
            continue
        rays, scores, number = _rays_of(shown, k)
        known = _of_solved(joints, k, body)
        begin(known, rays, body, shown.expected[k])
        missing = np.isnan(joints.positions[k, :, 0])
        places, covariances, _ = estimate(known, rays, body, missing)
        for j in range(len(number)):
            if missing[j] and np.isfinite(places[j, 0]):
                joints.positions[k, j], joints.covariances[k, j] = places[j], covariances[j]
                joints.scores[k, j], joints.views[k, j] = scores[j], number[j]


@njit(cache=True, error_model="numpy")
def hold_joints(rows, kept, shown, followed, joints, body, worst):
    """Place missing joints of tracked people, and decide who is a person: the loop of `hold_people`.

    Args:
        rows: (K,) rows of candidates; the first `kept` of them are people already.
        joints: Joints of these candidates, updated.

    Returns:
        there: (K,) whether the candidate is a person.
        placed: (K, J) whether a joint was placed here.
    """
    there, placed = np.arange(len(rows)) < kept, np.zeros(joints.views.shape, np.bool_)
    fresh = joints.positions[:kept][shown.who[rows[:kept]] < 0]
    for row in range(len(rows)):
        k, who = rows[row], shown.who[rows[row]]
        if who < 0 or not np.isnan(joints.positions[row, :, 0]).any():
            continue
        rays, scores, number = _rays_of(shown, k)
        if np.sum(number > 0) < FEWEST_JOINTS:
            continue
        known = _expected(followed, who, number > 0, body)
        _take_solved(known, joints, row)
        missing = np.isnan(joints.positions[row, :, 0])
        places, covariances, residuals = estimate(known, rays, body, missing)
        fits = residuals.ravel()[np.isfinite(residuals.ravel())]
        if not len(fits) or np.median(fits) > WORST_FIT:
            continue
        for j in range(len(number)):
            sure = GROWTH * largest_eigenvalue(covariances[j]) <= worst**2  # False for NaN
            placed[row, j] = sure and missing[j]
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
    """Return whether a person (J, 3) m stands at the position of one of several new people (P, J, 3) m."""
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
    """Return the upward unit vector (3,) in the world, from cameras (V, 3, 3) that are hardly rolled.

    It is perpendicular to the right axes of all cameras, in the sense of least squares. Where these axes
    leave a choice, it is the direction nearest to the upper edges of the images.
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
    """Return the rays of candidate k, their mean scores (J,) and their numbers (J,)."""
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
    rays = PersonRays(
        shown.member[k], shown.source[k], shown.shifts[k], np.sqrt(growth / np.maximum(number, 1)), shown.seen
    )
    return rays, scores / np.maximum(number, 1), number


@njit(cache=True, error_model="numpy")
def _of_solved(joints, row, body):
    """Return prior knowledge that consists of the solved joints of a person alone."""
    count, bones = joints.positions.shape[1], len(body.bones)
    known = PersonPrior(
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
    """Enter the solved joints of a person into `known` as prior knowledge."""
    for j in range(len(known.places)):
        if np.isfinite(joints.positions[row, j, 0]):
            known.places[j] = joints.positions[row, j]
            invert_symmetric(joints.covariances[row, j], 1.0, known.information[j])


@njit(cache=True, error_model="numpy")
def _expected(followed, who, shown, body):
    """Return the prior knowledge about a tracked person.

    Joints that no view shows do not continue with their own velocity: they keep their position relative to
    the body.

    Args:
        who: Row of the person in `followed`.
        shown: (J,) whether a view shows the joint.
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
    return PersonPrior(
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
