"""The order of numbers: by time of appearance, then by place, whatever the rows."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.identity.numbering import numbering_order, numbering_places

PLACES = np.array([[2.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])


def test_people_who_appear_together_are_in_order_of_their_places():
    assert numbering_order(PLACES).tolist() == [1, 3, 2, 0]


def test_earlier_people_come_first():
    times = np.array([0.0, 0.01, 0.5, 0.53])
    assert numbering_order(PLACES, times, 0.02).tolist() == [1, 0, 2, 3]
    assert numbering_order(PLACES, times, 0.1).tolist() == [1, 0, 3, 2]


def test_nobody_has_no_order():
    assert len(numbering_order(np.zeros((0, 2)), np.zeros(0), 0.1)) == 0


@given(st.permutations(range(6)), st.integers(0, 1000))
def test_rows_do_not_matter(rows, seed):
    rng = np.random.default_rng(seed)
    places, times = rng.uniform(-2.0, 2.0, (6, 2)), np.repeat(rng.uniform(0.0, 5.0, 3), 2)
    before = numbering_order(places, times, 0.03)
    assert np.array_equal(np.array(rows)[numbering_order(places[rows], times[rows], 0.03)], before)


def test_people_in_rows_and_round_tables_keep_their_order_under_noise():
    rng = np.random.default_rng(0)
    turns = np.arange(6) * np.pi / 3.0
    arrangements = (
        np.array([[0.0, k] for k in range(4)], float),
        np.array([[k, 0.0] for k in range(4)], float),
        np.array([[i, k] for i in range(2) for k in range(3)], float),
        np.stack([np.cos(turns), np.sin(turns)], axis=1),
    )
    for places in arrangements:
        order = numbering_order(places).tolist()
        noisy = [numbering_order(places + rng.normal(0.0, 0.015, places.shape)).tolist() for _ in range(200)]
        assert np.mean([one == order for one in noisy]) > 0.97


def test_a_place_is_the_mean_of_the_known_joints():
    positions = np.array([[[1.0, 2.0, 0.5], [3.0, 4.0, 1.5], [np.nan] * 3]])
    assert np.allclose(numbering_places(positions), [[2.0, 3.0]])
