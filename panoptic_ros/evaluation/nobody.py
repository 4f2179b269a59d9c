"""Diagnosis of the likely reason why few or no people are found in 3D although the views show people."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain import DetectionSet
from panoptic_ros.evaluation.rig_agreement import LEAST_JOINTS, LEAST_SCORE
from panoptic_ros.stage import Notice

MANY = 20  # smallest number of 2D poses from which at least one person should be found
HARDLY = 0.05  # smallest plausible share of people found, and of instants in which two views show people


def why_nobody(sets: Sequence[DetectionSet], found: int, warnings: Sequence[Notice]) -> list[Notice]:
    """Return a notice if few or no people were found from many 2D poses.

    Args:
        sets: Detection sets of the capture.
        found: Number of people found, summed over all instants.
        warnings: Warnings of the rig check.
    """
    counts = [[len(view.scores) for view in item.views] for item in sets]
    seen = sum(map(sum, counts))
    shown = sum(max(row, default=0) for row in counts)
    if seen < MANY or found >= HARDLY * shown:
        return []
    who = "few people were" if found else "no people were"
    text = f"{who} found in 3D although the views show {seen} 2D people: {_reason(sets, counts, warnings)}"
    return [Notice("result.nobody", "warning", text, {"seen": seen, "found": found})]


def _reason(sets: Sequence[DetectionSet], counts: list[list[int]], warnings: Sequence[Notice]) -> str:
    if warnings:
        return "the check of the rig reports the reason: " + warnings[0].text
    together = [sum(n > 0 for n in row) > 1 for row in counts]
    if not any(together):
        single = all(len(row) < 2 for row in counts)
        why = "every instant has one view only" if single else "no two views of an instant show people"
        return f"{why}; are the stamps of all cameras of one clock, and is the capture that of this rig?"
    scores = np.concatenate([view.scores.reshape(-1) for item in sets for view in item.views])
    given = scores[scores > 0.0]
    if not len(given) or np.median(given) < LEAST_SCORE:
        low = float(np.median(given)) if len(given) else 0.0
        return f"half of the joints have scores of {low:.2g} or less; scores from {LEAST_SCORE:g} on count"
    joints = np.concatenate([(view.scores > 0.0).sum(1) for item in sets for view in item.views])
    few = int(np.median(joints))
    if few < LEAST_JOINTS:
        known = "joints or fewer of this skeleton; are joint_names right?"
        return f"half of the people have {few} {known}"
    if float(np.mean(together)) < HARDLY:
        return f"two views show people in {100 * float(np.mean(together)):.0f} % of the instants only"
    return "the rays of people meet, so look at the parameters of assembly and tracking"
