"""How long newcomers wait until they are found."""

from __future__ import annotations

import math

from panoptic_ros.evaluation.newcomers import newcomers_scores, newcomers_waits
from panoptic_ros.evaluation.pairing import pair_sequences


def scene(build, found):
    """Person 0 is always there; 1 comes at frame 2 and is found from frame `found` on; 2 never is, from 4."""
    truth, result = [], []
    for k in range(8):
        ids = [0] + [1] * (k >= 2) + [2] * (k >= 4)
        truth.append(build.frame(k, ids, build.people_at(k, 3)[ids]))
        seen = [0] + [1] * (k >= found)
        result.append(build.frame(k, [7 + i for i in seen], build.people_at(k, 3)[seen]))
    return pair_sequences(build.sequence(truth), build.sequence(result))


def test_waits_are_from_the_first_true_frame_to_the_first_find(build):
    waits = newcomers_waits(scene(build, 5))
    assert math.isclose(waits[1], 3 * 0.04)
    assert math.isinf(waits[2])
    assert set(waits) == {1, 2}  # who is there from the beginning has not come


def test_scores_tell_the_longest_wait_of_those_found_and_who_is_missed(build):
    assert newcomers_scores(scene(build, 2)) == {
        "newcomers": 2,
        "newcomers_missed": 1,
        "newcomers_wait_s": 0.0,
    }
    assert newcomers_scores([])["newcomers_wait_s"] is None
