import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from panoptic_ros.domain import VisibilityLimit
from panoptic_ros.errors import DataError

SIZE = (40, 30)


def test_a_point_is_seen_up_to_the_limit_of_its_cell():
    limit = VisibilityLimit(np.array([[1000, 2000], [0, 500]], np.uint16))
    pixels = np.array([[-0.5, -0.5], [19.4, 0.0], [19.6, 14.4], [19.6, 14.6], [39.5, 29.5], [0.0, 20.0]])
    nearest = [1.0, 1.0, 2.0, 0.5, 0.5, 1e9]
    assert limit.sees(pixels, np.array(nearest), SIZE).all()
    assert limit.sees(pixels[:5], np.array(nearest[:5]) + 0.001, SIZE).sum() == 0


def test_depths_set_the_limit_with_the_margin_and_unknown_ones_none():
    depths = np.array([[2.0, 0.0], [np.nan, np.inf], [3.5001, 80.0]])
    assert VisibilityLimit.of_depths(depths, 0.25).cells.tolist() == [[2250, 0], [0, 0], [3751, 0]]


def test_of_depths_that_share_a_cell_the_farthest_counts_and_unknown_ones_lift_the_limit():
    depths = np.full((240, 320), 2.0)
    depths[:, 161] = 4.0  # of the cell with column 160
    depths[0, 319] = 0.0
    cells = VisibilityLimit.of_depths(depths, 0.0).cells
    assert cells.shape == (120, 160)
    assert (cells[:, 80] == 4000).all() and (np.delete(cells, 80, axis=1)[:, :-1] == 2000).all()
    assert cells[0, -1] == 0 and (cells[1:, -1] == 2000).all()


@given(
    arrays(np.float64, st.tuples(st.integers(1, 9), st.integers(150, 500)), elements=st.floats(0.0, 20.0)),
    st.floats(0.0, 0.5),
)
def test_a_point_on_a_measured_surface_is_always_seen(depths, margin):
    limit = VisibilityLimit.of_depths(depths, margin)
    rows, columns = np.indices(depths.shape)
    pixels = np.stack([columns, rows], axis=-1)
    assert limit.sees(pixels, depths + margin - 1e-9, depths.shape[::-1]).all()


@given(
    arrays(np.uint16, st.tuples(st.integers(1, 5), st.integers(1, 5)), elements=st.integers(0, 9)),
    arrays(np.uint16, st.tuples(st.integers(1, 5), st.integers(1, 5)), elements=st.integers(0, 9)),
)
def test_combined_is_the_nearer_one_at_the_middles_of_its_cells(first, second):
    one, other = VisibilityLimit(first), VisibilityLimit(second)
    both = one.combined(other)
    height, width = both.cells.shape
    rows, columns = np.indices((height, width))
    middles = np.stack([(columns + 0.5) * 60 / width - 0.5, (rows + 0.5) * 60 / height - 0.5], axis=-1)
    for depth in np.arange(10) * 1e-3:
        depths = np.full((height, width), depth)
        expected = one.sees(middles, depths, (60, 60)) & other.sees(middles, depths, (60, 60))
        assert (both.sees(middles, depths, (60, 60)) == expected).all()


@pytest.mark.parametrize(
    "bad, words",
    [
        (lambda: VisibilityLimit(np.zeros((3, 4))), "float64"),
        (lambda: VisibilityLimit(np.zeros((0, 4), np.uint16)), r"\(0, 4\)"),
        (lambda: VisibilityLimit(np.zeros(4, np.uint16)), r"shape \(4,\)"),
        (lambda: VisibilityLimit.of_depths(np.zeros(4), 0.2), "expected"),
        (lambda: VisibilityLimit.of_depths(np.full((2, 2), -1.0), 0.2), "negative depth, -1.000 m"),
    ],
)
def test_bad_content_is_refused(bad, words):
    with pytest.raises(DataError, match=words):
        bad()
