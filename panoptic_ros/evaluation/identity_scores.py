"""Scores of finding people and of keeping their identity.

All counts are on found pairs. A switch occurs when a truth person is found under another id than last time.
It is a switch over a gap if the truth has no frame for `GAP` in between, since no tracker can follow people
through cuts. A fragment occurs when a truth person is found again after frames in which it was missed. Frames
in which the truth ignores the person are left out. MOTA = 1 - (missed + false + switches) / truth. IDF1 = 2 *
found pairs under the best one-to-one map of identities / (truth + result).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from panoptic_ros.evaluation.joint_scores import ratio
from panoptic_ros.evaluation.pairing import FramePair

GAP = 1.0  # s; shortest interval without truth frames that is treated as a gap


@dataclass(frozen=True, slots=True)
class PersonScores:
    """Counts of skeletons over all frames; recall and precision are shares of found skeletons.

    Args:
        truth, result, found: Number of skeletons in the truth, in the result, and found.
        unmatched_per_frame: Result skeletons per frame without a match. The truth may not list all people.
    """

    truth: int
    result: int
    found: int
    recall: float
    precision: float
    unmatched_per_frame: float


@dataclass(frozen=True, slots=True)
class IdentityScores:
    """Counts of identity errors, MOTA and IDF1 (at most 1), and the share of found pairs with equal ids."""

    switches: int
    switches_over_gaps: int  # part of `switches`
    fragments: int
    mota: float
    idf1: float
    same_ids: float


def found_ids(pair: FramePair) -> dict[int, int]:
    """Return the result id of every truth person who is found in this frame, by truth id."""
    return {who: name for (who, name), found in zip(pair.match_ids, pair.found) if found}


def score_people(pairs: Sequence[FramePair]) -> PersonScores:
    """Return person recall and precision."""
    truth = sum(len(pair.truth_ids) for pair in pairs)
    result = sum(len(pair.result_ids) for pair in pairs)
    found = sum(int(pair.found.sum()) for pair in pairs)
    unmatched = result - sum(len(pair.matches) for pair in pairs)
    return PersonScores(
        truth, result, found, ratio(found, truth), ratio(found, result), ratio(unmatched, len(pairs))
    )


def score_identities(pairs: Sequence[FramePair]) -> IdentityScores:
    """Return switches, fragments, MOTA and IDF1; pairs must be sorted by time."""
    # truth person -> (id when last found, number of the stretch without gaps)
    last: dict[int, tuple[int, int]] = {}
    lost: set[int] = set()  # people found before and missed since
    together: Counter[tuple[int, int]] = Counter()
    switches = over_gaps = fragments = stretch = 0
    before = pairs[0].stamp_ns if pairs else 0
    for pair in pairs:
        stretch += pair.stamp_ns - before > GAP * 1e9
        before = pair.stamp_ns
        now = found_ids(pair)
        others = [last[who] for who, name in now.items() if who in last and last[who][0] != name]
        switches += len(others)
        over_gaps += sum(earlier != stretch for _, earlier in others)
        fragments += len(lost & now.keys())
        together.update(now.items())
        last.update({who: (name, stretch) for who, name in now.items()})
        missed = set(pair.truth_ids.tolist()) - now.keys()
        lost = (lost | (missed & last.keys())) - now.keys()
    people = score_people(pairs)
    errors = (people.truth - people.found) + (people.result - people.found) + switches
    return IdentityScores(
        switches=switches,
        switches_over_gaps=over_gaps,
        fragments=fragments,
        mota=1.0 - ratio(errors, people.truth),
        idf1=ratio(2 * _best_overlap(together), people.truth + people.result),
        same_ids=ratio(sum(count for (who, name), count in together.items() if who == name), people.found),
    )


def _best_overlap(together: Counter[tuple[int, int]]) -> int:
    """Return the largest number of found pairs under a one-to-one map of identities."""
    if not together:
        return 0
    whos = sorted({who for who, _ in together})
    names = sorted({name for _, name in together})
    counts = np.zeros((len(whos), len(names)), np.int64)
    for (who, name), count in together.items():
        counts[whos.index(who), names.index(name)] = count
    return int(counts[linear_sum_assignment(-counts)].sum())
