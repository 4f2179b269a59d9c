"""Who comes back is told from who was there all the time."""

import numpy as np

from panoptic_ros.kinematics.people.returning import LOOKS, Absence, Appearance

FRAME = 33_000_000


def seen(*places):
    return [Appearance(np.array([x, y, 1.0]), {0: (np.zeros((3, 2)), np.ones(3))}) for x, y in places]


def absent(looks, begin=0, place=(0.0, 0.0, 1.0)):
    """Looks one after another; the numbers of those in which the subject is back."""
    absence, back = Absence(np.array(place), -200_000_000), []
    for k, appearances in enumerate(looks):
        if absence.look(appearances, begin + k * FRAME, 0.5):
            back.append(k)
    return back


def test_somebody_who_stays_or_walks_past_is_never_taken():
    bystander = [seen((3.0 - 0.04 * k, 0.2)) for k in range(120)]  # right through where the subject was last
    assert absent(bystander) == []


def test_a_newcomer_is_taken_once_several_looks_agree():
    looks = [seen((3.0, 0.0)) for _ in range(30)] + [seen((3.0, 0.0), (1.0, 1.0)) for _ in range(5)]
    assert absent(looks)[0] == 30 + LOOKS - 1


def test_a_ghost_of_one_look_and_who_is_too_far_are_not():
    ghosts = [seen((0.9, 0.9)) if k % 40 == 39 else [] for k in range(120)]
    assert absent(ghosts) == []
    assert absent([seen() for _ in range(12)] + [seen((9.0, 0.0)) for _ in range(10)]) == []


def test_who_never_left_is_found_at_once():
    assert absent([seen((0.3, 0.0)) for _ in range(5)])[0] == LOOKS - 1
