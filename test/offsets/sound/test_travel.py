"""How long sound travels: by the geometry alone, and by how directly each microphone hears."""

from itertools import combinations

import numpy as np
import pytest

from panoptic_ros.offsets.sound.directness import Directness
from panoptic_ros.offsets.sound.travel import ONSET_S, ROOM, SPEED_OF_SOUND, SourcePositions, unknown_travel

PLACES = np.array([[0.0, 0.0, 1.5], [5.0, 0.5, 1.5], [4.0, 4.5, 2.0], [0.5, 4.0, 1.0]])
PAIRS = np.array(list(combinations(range(4), 2)))


def heard(heights, tails):
    return Directness(PAIRS[:, 0], PAIRS[:, 1], np.asarray(heights), np.asarray(tails))


def unheard(windows):
    return heard(np.full((len(PAIRS), windows), np.nan), np.full((len(PAIRS), windows), np.nan))


def at(source, critical=0.9):
    """What a talker at a place sounds like: tails by the energy that comes straight."""
    ways = np.linalg.norm(PLACES - source, axis=1)
    direct = (critical / ways) ** 2
    share = np.sqrt(direct / (1.0 + direct))
    first, second = PAIRS.T
    tails = np.log1p(2.0 * direct[first]) - np.log1p(2.0 * direct[second])
    return ways / SPEED_OF_SOUND, (share[first] * share[second])[:, None], tails[:, None]


def test_travel_is_that_of_the_way_and_no_more():
    mean, covariance = SourcePositions(PLACES).travel(unheard(2))
    assert mean.shape == (4, 2) and np.allclose(mean, 0.0, atol=0.004) and np.allclose(mean[:, 0], mean[:, 1])
    for a, b in combinations(range(4), 2):
        way = np.linalg.norm(PLACES[a] - PLACES[b]) / SPEED_OF_SOUND
        deviation = np.sqrt(covariance[a, a] + covariance[b, b] - 2.0 * covariance[a, b])
        assert 0.2 * way < deviation < ROOM * way
    one_pair = Directness(np.array([0]), np.array([1]), np.full((1, 1), np.nan), np.full((1, 1), np.nan))
    _, together = SourcePositions(np.zeros((2, 3))).travel(one_pair)
    assert together[0, 0] + together[1, 1] - 2.0 * together[0, 1] == pytest.approx(2.0 * ONSET_S**2)
    assert unknown_travel(2, 12.0)[1][0, 0] > 3.0 * unknown_travel(2, 6.0)[1][0, 0]


@pytest.mark.parametrize("source", [(0.5, 0.4, 1.4), (4.5, 1.0, 1.5), (3.9, 4.0, 1.7), (2.4, 2.2, 1.5)])
def test_who_is_heard_directly_is_near(source):
    ways, heights, tails = at(np.array(source))
    mean, covariance = SourcePositions(PLACES).travel(heard(heights, tails))
    true = ROOM * (ways - ways.mean())
    prior, wide = SourcePositions(PLACES).travel(unheard(1))
    error = np.linalg.norm(mean[:, 0] - true)
    assert error < max(0.5 * np.linalg.norm(prior[:, 0] - true), 0.004)
    assert np.trace(covariance) < 0.7 * np.trace(wide)
    assert error**2 < 2.0 * np.trace(covariance)


def test_every_window_has_a_place_of_its_own_and_what_is_missing_tells_nothing():
    one, other = at(np.array([0.5, 0.4, 1.4])), at(np.array([3.9, 4.0, 1.7]))
    gap = np.full((len(PAIRS), 1), np.nan)
    mean, _ = SourcePositions(PLACES).travel(
        heard(np.hstack([one[1], gap, other[1]]), np.hstack([one[2], gap, other[2]]))
    )
    assert mean[:, 0].argmin() == 0 and mean[:, 2].argmin() == 2
    assert np.allclose(mean[:, 1], SourcePositions(PLACES).travel(unheard(1))[0][:, 0])
