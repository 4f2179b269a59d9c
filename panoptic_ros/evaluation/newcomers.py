"""How long it takes until somebody who comes is found."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from panoptic_ros.evaluation.identity_scores import found_ids
from panoptic_ros.evaluation.pairing import FramePair


def newcomers_waits(pairs: Sequence[FramePair]) -> dict[int, float]:
    """Time in s from the first frame of the truth with a person to the first in which they are found.

    Who is in the first frame has not come. Infinite: never found. Pairs in the order of time.
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
    """How many come, how many of them are never found, and the longest wait (s) of the others, or None."""
    waits = newcomers_waits(pairs).values()
    found = [wait for wait in waits if math.isfinite(wait)]
    return {
        "newcomers": len(waits),
        "newcomers_missed": len(waits) - len(found),
        "newcomers_wait_s": max(found, default=None),
    }
