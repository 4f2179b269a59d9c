"""Check of given focal lengths: people who walk determine them, and a wrong one costs millimetres."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from panoptic_ros.calibration.bundle import PLAIN, Adjustment, Observations, adjust, covariance_of
from panoptic_ros.calibration.people.solve import CalibratedPeople
from panoptic_ros.calibration.projection import OFFSET, POSE

Array = np.ndarray
ASPECT_SD = 1e-4  # relative, of the ratio of both focal lengths of a camera, which is kept
PARTS = 4  # parts of the recording that the jackknife leaves out in turn; shorter ones share errors
# standard deviations of a change that is certain; right lenses of Shelf reach 3.9 in one camera, 4.7 in all
CERTAIN = 4.0
# relative; 5 % costs 8 mm. Constant errors of a real detector look like a change of 3 % on Shelf
GOOD_FOCAL, REFUSED_FOCAL = 0.04, 0.1


class FocalCheck(NamedTuple):
    """Relative changes of focal lengths that fit the people best, and standard deviations.

    Args:
        changes, sds: (C,) of each camera.
        common, common_sd: Change of one factor for all cameras, and its standard deviation.
    """

    changes: Array
    sds: Array
    common: float
    common_sd: float

    def is_certain(self) -> tuple[Array, bool]:
        """Return whether the change of each camera (C,), and the common one, is certain."""
        own = np.abs(self.changes) > np.maximum(GOOD_FOCAL, CERTAIN * self.sds)
        return own, abs(self.common) > max(GOOD_FOCAL, CERTAIN * self.common_sd)


def check_focals(found: CalibratedPeople) -> FocalCheck:
    """Return the changes of focal lengths from an adjustment in which they are free.

    Deviations come from the covariance, which includes repeated biases of the detector. If a change seems
    certain, a jackknife over parts of the recording raises them: neighbouring instants share errors.
    """
    seen, state = found.rig.seen, _with_free_focals(found.rig.state)
    given = state.cameras.lenses[:, 0]
    best = adjust(seen, state, PLAIN)
    changes = best.cameras.lenses[:, 0] / given - 1.0
    try:
        covariance, index = covariance_of(seen, best)
    except np.linalg.LinAlgError:
        return FocalCheck(changes, np.full(len(given), np.inf), 0.0, float("inf"))
    rows = index[:, POSE]
    own = covariance[np.ix_(rows, rows)] / np.outer(given, given)
    weights = np.linalg.solve(own, np.ones(len(given)))
    variance = 1.0 / float(weights.sum())
    weights = weights * variance
    check = FocalCheck(changes, np.sqrt(np.diag(own)), float(weights @ changes), float(np.sqrt(variance)))
    certain, common = check.is_certain()
    if not (certain.any() or common):
        return check
    order = np.argsort(found.joints.instants, kind="stable")
    rest = [
        adjust(_without(seen, part), best, PLAIN).cameras.lenses[:, 0] / given - 1.0
        for part in np.array_split(order, PARTS)
    ]
    apart = np.array(rest) - np.mean(rest, axis=0)
    factor = (PARTS - 1) / PARTS
    sds = np.sqrt(factor * (apart**2).sum(axis=0))
    common_sd = float(np.sqrt(factor * ((apart @ weights) ** 2).sum()))
    return check._replace(sds=np.maximum(check.sds, sds), common_sd=max(check.common_sd, common_sd))


def focal_faults(check: FocalCheck, names: tuple[str, ...]) -> tuple[list[str], list[str]]:
    """Return lines about wrong focal lengths: reasons for refusal, and reasons for doubt."""
    certain, common = check.is_certain()
    if common and (2 * certain.sum() > len(names) or not certain.any()):
        faults = [("all cameras: ", check.common, check.common_sd)]
    else:
        faults = [
            (f"camera {name}: ", change, sd)
            for name, change, sd, sure in zip(names, check.changes, check.sds, certain)
            if sure
        ]
    refused: list[str] = []
    doubts: list[str] = []
    for where, change, sd in faults:
        line = (
            f"{where}people fit focal lengths {abs(change):.1%} {'shorter' if change < 0.0 else 'longer'} "
            f"(± {sd:.1%}) than given; check lens, zoom and image size, or calibrate the lens with a board"
        )
        (refused if abs(change) > REFUSED_FOCAL else doubts).append(line)
    return refused, doubts


def _with_free_focals(state: Adjustment) -> Adjustment:
    """Return the state with free focal lengths of fixed aspect."""
    cameras = state.cameras
    free = cameras.free.copy()
    free[:, POSE : POSE + 2] = True
    information = np.zeros((len(free), OFFSET - POSE, OFFSET - POSE))
    miss = np.array([1.0, -1.0]) / cameras.lenses[:, :2] / ASPECT_SD
    information[:, :2, :2] = miss[:, :, None] * miss[:, None]
    prior = cameras.lenses.copy()
    return replace(state, cameras=replace(cameras, free=free, prior=prior, prior_information=information))


def _without(seen: Observations, targets: Array) -> Observations:
    """Return observations in which targets have no weight."""
    left_out = np.isin(seen.targets, targets)[seen.views]
    return seen._replace(variances=np.where(left_out, np.inf, seen.variances))
