"""Whether people are found, and whether they keep their identity.

All counts are on found pairs. Switch: a truth person is found under another id than when last found.
Fragment: a truth person is found again after frames in which it was not (frames in which it is to
be ignored do not count). MOTA = 1 - (missed + false + switches) / truth. IDF1 = 2 * found pairs under the
best one-to-one map of identities / (truth + result).
"""
from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from panoptic_ros.evaluation.joint_scores import ratio
from panoptic_ros.evaluation.pairing import FramePair


@dataclass(frozen=True, slots=True)
class PersonScores:
    """Skeletons counted over all frames; recall and precision are shares of found ones."""

    truth: int
    result: int
    found: int
    recall: float
    precision: float


@dataclass(frozen=True, slots=True)
class IdentityScores:
    """Counts of identity errors, and MOTA and IDF1 (at most 1)."""

    switches: int
    fragments: int
    mota: float
    idf1: float


def found_ids(pair: FramePair) -> dict[int, int]:
    """Result id of every truth person who is found in this frame."""
    return {who: name for (who, name), found in zip(pair.match_ids, pair.found) if found}


def score_people(pairs: Sequence[FramePair]) -> PersonScores:
    """Person recall and precision."""
    truth = sum(len(pair.truth_ids) for pair in pairs)
    result = sum(len(pair.result_ids) for pair in pairs)
    found = sum(int(pair.found.sum()) for pair in pairs)
    return PersonScores(truth, result, found, ratio(found, truth), ratio(found, result))


def score_identities(pairs: Sequence[FramePair]) -> IdentityScores:
    """Switches, fragments, MOTA and IDF1."""
    last: dict[int, int] = {}  # truth person -> id when last found
    lost: set[int] = set()  # found before, missed since
    together: Counter[tuple[int, int]] = Counter()
    switches = fragments = 0
    for pair in pairs:
        now = found_ids(pair)
        switches += sum(last.get(who, name) != name for who, name in now.items())
        fragments += len(lost & now.keys())
        together.update(now.items())
        last.update(now)
        missed = set(pair.truth_ids.tolist()) - now.keys()
        lost = (lost | (missed & last.keys())) - now.keys()
    people = score_people(pairs)
    errors = (people.truth - people.found) + (people.result - people.found) + switches
    return IdentityScores(
        switches=switches,
        fragments=fragments,
        mota=1.0 - ratio(errors, people.truth),
        idf1=ratio(2 * _best_overlap(together), people.truth + people.result),
    )


def _best_overlap(together: Counter[tuple[int, int]]) -> int:
    """Largest number of found pairs under a one-to-one map of identities."""
    if not together:
        return 0
    whos = sorted({who for who, _ in together})
    names = sorted({name for _, name in together})
    counts = np.zeros((len(whos), len(names)), np.int64)
    for (who, name), count in together.items():
        counts[whos.index(who), names.index(name)] = count
    return int(counts[linear_sum_assignment(counts, maximize=True)].sum())
