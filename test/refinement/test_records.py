"""People come and go in all arrays at once."""

import numpy as np

from panoptic_ros.domain.of_all import joined, of_all, selected
from panoptic_ros.refinement.records import new_people, unknown


def test_people_are_joined_and_selected_in_all_arrays():
    few, more = (of_all(lambda a, k=k: a + a.dtype.type(k), unknown(5, 0.1, k, 4)) for k in (1, 2))
    both = joined(few, more)
    assert both.stamp_ns == 5 and both.dt == 0.1
    assert both.measured.noises[:, 0, 0, 0].tolist() == [1.0, 2.0, 2.0]
    assert both.motion.covariances.shape == (3, 4, 6, 6) and both.measured.people.dtype == bool
    again = selected(both, np.array([True, False, True]))
    assert again.noise[:, 0].tolist() == [1.0, 2.0] and again.measured.views.dtype == np.int32


def test_new_people_know_nothing():
    people = new_people([4, 2], 3, 5)
    assert people.ids.tolist() == [4, 2] and people.lengths.shape == (2, 5)
    assert np.isnan(people.innovations).all() and (people.factors == 1.0).all()
    assert len(joined(new_people([], 3, 5), people).ids) == 2
