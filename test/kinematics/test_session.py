"""Images of a recording are put together to sets, and each instant gets those that it needs."""

import re
from pathlib import Path

import numpy as np

import panoptic_ros.kinematics
from panoptic_ros.domain.subjects import ViewPeople, ViewSeries
from panoptic_ros.kinematics.session import _sets_of, instants_of

FIRST, PERIOD = 1_700_000_000_000_000_000, 40_000_000
NOBODY = ViewPeople(np.zeros((0, 19, 2)), np.zeros((0, 19)))


def series(*periods):
    stamps = FIRST + np.array([round(share * PERIOD) for share in periods])
    return ViewSeries(stamps, (NOBODY,) * len(stamps))


def cameras(sets):
    return [sorted(stamps) for _, stamps in sets]


def test_images_of_about_the_same_time_are_one_set():
    views = {0: series(0, 1, 2, 3), 1: series(0.3, 1.3, 3.3), 2: series(0, 2)}
    sets, _ = _sets_of(views, instants_of(views, {}, 25.0))
    assert cameras(sets) == [[0, 1, 2], [0, 1], [0, 2], [0, 1]]
    assert [instant.stamp_ns for instant, _ in sets] == [max(stamps.values()) for _, stamps in sets]


def test_no_image_is_left_out_where_stamps_shake():
    views = {0: series(0, 1.1, 2, 2.6, 4), 1: series(0, 1, 2, 3, 4)}
    sets, needed = _sets_of(views, instants_of(views, {}, 25.0))
    assert sum(map(len, cameras(sets))) == 10 and needed[-1] == len(sets) - 1


def test_an_instant_needs_the_first_images_after_it():
    views = {0: series(0, 1, 2, 3), 1: series(0.3, 1.3, 2.3)}
    stamps = FIRST + np.array([0, PERIOD // 4, PERIOD, 3 * PERIOD])
    _, needed = _sets_of(views, stamps)
    assert needed.tolist() == [0, 1, 1, 3]


def test_an_instant_waits_for_no_image_beyond_a_gap():
    views = {0: series(0, 1, 2, 3, 4, 5, 6), 1: series(0, 6)}
    stamps = FIRST + PERIOD * np.arange(7)
    assert _sets_of(views, stamps)[1].tolist() == [0, 1, 2, 6, 6, 6, 6]
    assert _sets_of({}, stamps)[1].tolist() == [-1] * 7


def test_instants_begin_with_the_first_image():
    views = {0: series(1, 2), 1: series(0.5)}
    assert instants_of(views, {}, 50.0)[0] == FIRST + PERIOD // 2
    assert len(instants_of({}, {}, 50.0)) == 0


def test_recordings_and_live_data_are_solved_by_one_driver():
    root = Path(panoptic_ros.kinematics.__file__).parent
    makes = {p.name for p in root.rglob("*.py") if re.search(r"\b(SubjectTracker|Presence)\(", p.read_text())}
    assert makes - {"tracker.py", "presence.py"} == {"person.py"}
