"""Delay until a new person is found."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from panoptic_ros.evaluation.identity_scores import found_ids
from panoptic_ros.evaluation.pairing import FramePair


def newcomers_waits(pairs: Sequence[FramePair]) -> dict[int, float]:
    """Return the delay (s) by truth id from a person's first truth frame to its first match.

    People in the first frame are not treated as new. The delay is infinite for people who are never found.
    Pairs must be sorted by time.
    """
    came: dict[int, int] = {}
    waits: dict[int, float] = {}
    there = set(pairs[0].truth_ids.tolist()) if pairs else set()
    for pair in pairs:
        found = found_ids(pair)
        for number in pair.truth_ids.tolist():
            if number not in there and number not in came:
                came[number], waits[number] = pair.stamp_ns, math.inf
            if number in found and math.isinf(waits.get(number, 0.0)):
                waits[number] = 1e-9 * (pair.stamp_ns - came[number])
    return waits


def newcomers_scores(pairs: Sequence[FramePair]) -> dict[str, Any]:
    """Return the number of new people, the number never found, and the longest delay.

    The longest delay (s) is taken over the people who are found; it is None without any.
    """
    waits = newcomers_waits(pairs).values()
    found = [wait for wait in waits if math.isfinite(wait)]
    return {
        "newcomers": len(waits),
        "newcomers_missed": len(waits) - len(found),
        "newcomers_wait_s": max(found, default=None),
    }
