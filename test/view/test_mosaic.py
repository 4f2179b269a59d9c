"""Mosaics: bounded, steady, nothing lost."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.view.overlay_run import Mosaic


@given(
    st.lists(st.tuples(st.integers(8, 2000), st.integers(8, 2000)), min_size=1, max_size=31),
    st.tuples(st.integers(300, 2000), st.integers(300, 1200)),
)
def test_the_picture_is_bounded_and_even(sizes, limit):
    mosaic = Mosaic({f"c{i}": size for i, size in enumerate(sizes)}, limit)
    assert mosaic.size[0] <= limit[0] and mosaic.size[1] <= limit[1]
    assert mosaic.size[0] % 2 == 0 and mosaic.size[1] % 2 == 0
    assert mosaic.columns * mosaic.rows >= len(sizes)


def test_every_view_has_its_tile_and_missing_ones_say_so():
    mosaic = Mosaic({f"c{i}": (400, 300) for i in range(4)}, (1000, 800))
    images = {f"c{i}": np.full((300, 400, 3), 60 * (i + 1), np.uint8) for i in range(3)}
    picture = mosaic.compose(images, "0.5 s")
    assert picture.shape == (mosaic.size[1], mosaic.size[0], 3)
    centres = ((200, 200), (600, 200), (200, 500), (600, 500))
    assert [picture[y, x, 0] for x, y in centres] == [60, 120, 180, 24]
    assert picture[300:, 404:].max() > 200  # the words "no image"


def test_images_that_are_scaled_already_are_taken_as_they_are():
    mosaic = Mosaic({"a": (1080, 1920), "b": (1088, 1920)}, (900, 800))
    scaled = {
        name: np.full((round(1920 * s), round(w * s), 3), 99, np.uint8)
        for (name, s), w in zip(mosaic.scales.items(), (1080, 1088))
    }
    full = {"a": np.full((1920, 1080, 3), 99, np.uint8), "b": np.full((1920, 1088, 3), 99, np.uint8)}
    difference = mosaic.compose(scaled).astype(int) - mosaic.compose(full)
    assert (difference != 0).mean() < 0.01


def test_wide_and_tall_views_get_different_grids():
    assert Mosaic({f"c{i}": (1920, 1080) for i in range(4)}).columns == 2
    assert Mosaic({f"c{i}": (1088, 1920) for i in range(4)}).columns == 4


def test_what_cannot_be_is_refused():
    with pytest.raises(UsageError, match="no views"):
        Mosaic({})
    with pytest.raises(UsageError, match="do not fit"):
        Mosaic({f"c{i}": (100, 100) for i in range(30)}, (20, 20))
    with pytest.raises(DataError, match="no view x"):
        Mosaic({"a": (10, 10)}).compose({"x": np.zeros((10, 10, 3), np.uint8)})
