"""Designated people."""

import numpy as np
import pytest

from panoptic_ros.domain import SubjectSet
from panoptic_ros.errors import ConfigError, DataError
from panoptic_ros.identity.subjects import (
    REACH,
    WAIT,
    VisibleTracks,
    found_subjects,
    subject_word,
    subjects_of,
)

SECOND = 10**9


def seen(*middles, drift=(0.0, 0.0, 0.0)):
    """People with the ids 0, 1, ... at these places."""
    return VisibleTracks(np.arange(len(middles)), np.array(middles, float), np.tile(drift, (len(middles), 1)))


def test_words_say_ids_and_places():
    found = subjects_of([subject_word(3, np.array([0.4, -1.25, 0.95])), subject_word(0, None)])
    assert found.ids.tolist() == [3, 0] and found.places[0].tolist() == [0.4, -1.25, 0.95]
    assert np.isnan(found.places[1]).all() and found.times.tolist() == [-1, -1]


@pytest.mark.parametrize("word", ["a", "3=1 2", "3=1 2 x", "", "3=1 2 inf"])
def test_other_words_are_refused(word):
    with pytest.raises(ConfigError, match="is not of the form ID or ID=X Y Z"):
        subjects_of([word])


def test_an_id_stands_once():
    with pytest.raises(ConfigError, match=r"distinct ids from 0 on, found \[3, 3\]"):
        subjects_of(["3", "3=1 2 3"])
    with pytest.raises(DataError, match="distinct ids from 0 on"):
        SubjectSet(0, [-2])


def test_places_choose_the_nearest_pairs_and_the_rest_is_in_the_order_of_coming():
    subjects = SubjectSet(0, [5, 6, 7, 8], [[0.4, 0, 1], [0, 0, 1], [np.nan] * 3, [9, 9, 1]])
    people = seen([3, 0, 1], [0.5, 0, 1], [0.25, 0, 0.9])
    found = found_subjects(subjects, np.arange(4), people, SECOND, SECOND)
    assert found == {1: 0, 2: 1, 0: 2}  # nobody is at the place of the last one


def test_a_place_counts_at_its_time_and_for_a_while():
    subjects = SubjectSet(0, [5], [[0, 0, 1]], [10 * SECOND])

    def found(seconds, x, speed=0.0):
        people = seen([x, 0, 1], drift=(speed, 0, 0))
        return found_subjects(subjects, np.array([0]), people, round(seconds * SECOND), 0)

    assert found(10.0, 0.9 * REACH) == {0: 0} and found(10.0, 1.1 * REACH) == {}
    assert found(9.9, 0.0) == {} and found(10.1 + WAIT, 0.0) == {}
    assert found(10.8, 1.2, speed=1.5) == {0: 0} and found(10.8, 1.2) == {}  # walked on since
