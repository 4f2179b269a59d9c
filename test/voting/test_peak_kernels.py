import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.bench.stage1.dense import is_maximum
from panoptic_ros.voting.peak_kernels import highest


@given(seed=st.integers(0, 10**6), share=st.floats(0.0, 1.0), levels=st.integers(1, 20))
def test_the_highest_of_scattered_voxels(seed, share, levels):
    rng = np.random.default_rng(seed)
    rank = np.where(rng.random((2, 5, 4, 6)) < share, rng.integers(0, levels, (2, 5, 4, 6)) / 7.0, -1.0)
    at = np.argwhere(rank >= 0.0)
    at = at[rng.permutation(len(at))]
    top = highest(at[:, 0], at[:, 1:] + 1, rank[tuple(at.T)], np.ones(len(at), np.int64))
    assert top.tolist() == is_maximum(rank, at).tolist()


def test_what_is_known_to_be_beaten_is_not_asked():
    voxels = np.array([[1, 1, 1], [3, 1, 1], [5, 1, 1]])
    top = highest(np.zeros(3, np.int64), voxels, np.array([0.3, 0.5, 0.4]), np.array([1, 1, 0]))
    assert top.tolist() == [True, True, False]
