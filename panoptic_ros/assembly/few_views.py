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

import numpy as np

from panoptic_ros.assembly.judgement import Joints
from panoptic_ros.domain import Prediction
from panoptic_ros.geometry.symmetric import largest_eigenvalue
from panoptic_ros.solving.bodies import Body, Known, Rays, begin, estimate
from panoptic_ros.solving.joint_records import Candidates
from panoptic_ros.solving.scene import Scene, seeing_views

Array = np.ndarray

FEW_VIEWS = 2  # people whom more views show need no help
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


def place_shown(scene: Scene, found: Candidates, joints: Joints, body: Body) -> None:
    """Place missing joints of people of few views, in place, that these views show.

    Args:
        joints: of all candidates.
    """
    member, missing = found.grouping.member, np.isnan(joints.positions[..., 0])
    supporting = (member >= 0).sum(axis=1)
    few = np.flatnonzero(missing.any(axis=1) & (supporting >= 1) & (supporting <= FEW_VIEWS))
    if len(few):
        few = few[seeing_views(scene, joints.positions[few]).sum(axis=1) <= FEW_SEEING]
    for k in few.tolist():
        rays, scores, number = _rays_of(scene, found, k)
        known = _of_solved(joints, k, body)
        begin(known, rays, body, found.guide.positions[k].copy())
        places, covariances, _ = estimate(known, rays, body)
        placed = missing[k] & np.isfinite(places[:, 0])
        joints.positions[k, placed], joints.covariances[k, placed] = places[placed], covariances[placed]
        joints.scores[k, placed], joints.views[k, placed] = scores[placed], number[placed]


def hold_people(
    scene: Scene, found: Candidates, prediction: Prediction, kept: Array, joints: Joints, body: Body,
    worst: float,
) -> tuple[Array, Joints, Array]:  # fmt: skip
    """The people that were kept and those who can be held besides, with joints that are placed.

    Args:
        kept: (P,) rows of the candidates, whose joints are `joints`.
        worst: m, standard deviation beyond which a joint is given up.

    Returns:
        rows of the candidates, joints, and which joints (P, J) were placed.
    """
    views = (found.grouping.member >= 0).sum(axis=1)
    wanted = (found.who >= 0) & (views >= 1) & (views <= FEW_VIEWS)
    wanted &= prediction.lengths.shape[1] == len(body.bones)
    lacking = np.flatnonzero(wanted[kept] & np.isnan(joints.positions[..., 0]).any(axis=1))
    wanted[kept] = False
    held = np.flatnonzero(wanted)
    placed = np.zeros((len(kept) + len(held), joints.views.shape[1]), bool)
    if not len(lacking) and not len(held):
        return kept, joints, placed
    fresh = joints.positions[found.who[kept] < 0]
    there = np.arange(len(placed)) < len(kept)
    kept, joints = np.concatenate([kept, held]), joints.joined(Joints.nothing(len(held), placed.shape[1]))
    up = upwards(scene.cams.rotations[np.unique(scene.evidence.view)])  # others may look anywhere
    for row in [*lacking.tolist(), *np.flatnonzero(~there).tolist()]:
        rays, scores, number = _rays_of(scene, found, int(kept[row]))
        if np.count_nonzero(number) < FEWEST_JOINTS:
            continue
        known = _expected(prediction, int(found.who[kept[row]]), number > 0, body, up)
        _take_solved(known, joints, row)
        places, covariances, residuals = estimate(known, rays, body)
        fits = residuals[np.isfinite(residuals)]
        if not len(fits) or np.median(fits) > WORST_FIT:
            continue
        covariances *= GROWTH
        sure = np.array([largest_eigenvalue(block) for block in covariances]) <= worst**2  # False for NaN
        own = np.isnan(joints.positions[row, :, 0]) & sure
        if there[row] or (own.any() and not _is_there(np.where(own[:, None], places, np.nan), fresh)):
            there[row], placed[row] = True, own
            joints.positions[row, own], joints.covariances[row, own] = places[own], covariances[own]
            joints.scores[row, own], joints.views[row, own] = 0.5 * scores[own], number[own]
    return kept[there], joints.rows(there), placed[there]


def _is_there(person: Array, others: Array) -> bool:
    """Whether a person (J, 3) stands where one of others (P, J, 3), who are new, was found."""
    for other in others:
        gaps = np.linalg.norm(person - other, axis=-1)
        known = np.isfinite(gaps)
        if known.any() and np.median(gaps[known]) < SAME_PLACE:
            return True
    return False


def upwards(rotations: Array) -> Array:
    """Which way (3,) is up, for cameras (V, 3, 3) that are hardly rolled: across all of their right axes.

    Where these leave a choice, it is the one nearest to the upper edges of the images.
    """
    across = LEVEL * np.einsum("vi,vj->ij", rotations[:, 0], rotations[:, 0])
    found: Array = np.linalg.solve(across + np.eye(3), -rotations[:, 1].sum(axis=0))
    return found / max(float(np.linalg.norm(found)), 1e-9)


def _rays_of(scene: Scene, found: Candidates, k: int) -> tuple[Rays, Array, Array]:
    """What the 2D people of candidate k show; mean scores (J,) and numbers (J,) of its rays."""
    member, source = found.grouping.member[k], found.source[k]
    views = np.flatnonzero(member >= 0)
    rows = member[views, None], source[views]
    shown = scene.precision[rows] > 0.0
    number = shown.sum(axis=0)
    scores = (shown * scene.evidence.scores[rows]).sum(axis=0) / np.maximum(number, 1)
    rays = Rays(
        member.copy(), source.copy(), found.guide.shifts[k].copy(), np.ones(len(number)), scene.observations
    )
    return rays, scores, number


def _of_solved(joints: Joints, row: int, body: Body) -> Known:
    """The joints of a person that are solved, and nothing else."""
    shape, bones = joints.positions[row].shape, len(body.bones)
    known = Known(
        np.full(shape, np.nan), np.zeros((*shape, 3)), np.zeros((bones, 3)), np.full(bones, np.inf),
        np.full(bones, np.nan), np.full(bones, SIDES), np.zeros(shape), np.zeros(3), np.inf,
    )  # fmt: skip
    _take_solved(known, joints, row)
    return known


def _take_solved(known: Known, joints: Joints, row: int) -> None:
    """Enter the joints of a person that are solved into what is known, in place."""
    solved = np.isfinite(joints.positions[row, :, 0])
    known.places[solved] = joints.positions[row, solved]
    known.information[solved] = np.linalg.inv(joints.covariances[row, solved])


def _expected(prediction: Prediction, who: int, shown: Array, body: Body, up: Array) -> Known:
    """What is known of a person who is followed, of whom some joints are shown (J,).

    Joints that no view shows do not go on as they moved: they keep their place in the body.
    """
    bones = body.bones
    places, ages, speeds = prediction.positions[who].copy(), prediction.ages[who], prediction.velocities[who]
    passed = max(float(ages.min()), 1e-3)
    variances = prediction.variances[who, :, 0] + PLACE**2
    variances[~shown] += (UNSEEN * passed) ** 2
    information = np.where(np.isfinite(places[:, :1, None]), np.eye(3) / variances[:, None, None], 0.0)
    still = places - passed * speeds
    both = shown[bones].all(axis=1)
    ends = np.where(both[:, None, None], places[bones], still[bones])
    vectors = ends[:, 1] - ends[:, 0]
    speed = float(np.median(np.linalg.norm(speeds[shown], axis=-1)))
    slack = np.where(both, TURNING, STRAYING + SWINGING * speed) * passed + 0.5 * PLACE
    slack[np.isnan(vectors[:, 0])] = np.inf
    bone = BONE * np.sqrt(max(1.0, BONE_MEMORY / passed))
    return Known(
        places, information, np.nan_to_num(vectors), slack, prediction.lengths[who].copy(),
        np.full(len(bones), bone), still, up, RISING * passed,
    )  # fmt: skip
