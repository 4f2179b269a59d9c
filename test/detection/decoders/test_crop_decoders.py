"""SimCC, heat maps and single heads on made outputs with known answers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.detection.decoders.heatmap import decode_heatmap
from panoptic_ros.detection.decoders.simcc import decode_simcc, simcc_maps
from panoptic_ros.detection.decoders.single_heads import decode_single_heads


def gaussian(places, rows, columns, sigma, peak=1.0):
    y, x = np.mgrid[:rows, :columns]
    maps = [peak * np.exp(-((x - px) ** 2 + (y - py) ** 2) / (2 * sigma**2)) for px, py in places]
    return np.array(maps, np.float32)


def test_simcc_takes_the_best_bin_of_each_axis_and_the_weaker_score():
    across, down = np.full((2, 96), -0.1, np.float32), np.full((2, 128), -0.2, np.float32)
    across[0, 31], down[0, 90] = 0.9, 0.6
    across[1, 5], down[1, 7] = 1.3, 1.1  # no probabilities
    points, scores = decode_simcc(across, down, 2.0)
    np.testing.assert_allclose(points, [[15.5, 45.0], [2.5, 3.5]])
    np.testing.assert_allclose(scores, [0.6, 1.0])


def test_simcc_without_a_joint_scores_zero():
    points, scores = decode_simcc(np.full((1, 8), -0.5), np.full((1, 8), -0.1), 2.0)
    assert scores.tolist() == [0.0] and np.isfinite(points).all()


def test_simcc_maps_peak_at_the_joint_with_its_score():
    bins = np.arange(96)
    across = 0.9 * np.exp(-((bins - 40) ** 2) / 50.0)[None]
    down = 0.7 * np.exp(-((bins - 60) ** 2) / 50.0)[None]
    maps = simcc_maps(across, down, np.arange(0, 48), np.arange(-5, 48), 2.0)
    assert maps.shape == (1, 53, 48)
    assert np.unravel_index(maps[0].argmax(), maps[0].shape) == (30 + 5, 20)
    np.testing.assert_allclose(maps.max(), 0.7)
    assert (maps[:, :5] == 0).all()  # above the crop


@settings(max_examples=60, deadline=None)
@given(st.floats(8, 40), st.floats(8, 56), st.floats(1.5, 3.0), st.floats(0.3, 1.0))
def test_dark_is_exact_on_gaussians(x, y, sigma, peak):
    cells, scores = decode_heatmap(gaussian([(x, y)], 64, 48, sigma, peak), "dark")
    np.testing.assert_allclose(cells, [(x, y)], atol=0.02)
    assert 0.85 * peak < scores[0] <= peak + 1e-6


@settings(max_examples=60, deadline=None)
@given(st.floats(4, 40), st.floats(4, 56))
def test_a_quarter_step_goes_towards_the_joint(x, y):
    cells, _ = decode_heatmap(gaussian([(x, y)], 64, 48, 2.0), "quarter")
    assert np.abs(cells - (x, y)).max() <= 0.25 + 1e-3
    assert ((cells % 1 == 0.25) | (cells % 1 == 0.75) | (np.abs(cells - (x, y)) < 1e-3)).all()


@pytest.mark.parametrize("refine", ["quarter", "dark"])
def test_peaks_at_the_border_and_flat_maps(refine):
    heat = np.zeros((3, 16, 12), np.float32)
    heat[0, 0, 0] = 0.5
    heat[1, 15, 11] = 0.5
    cells, scores = decode_heatmap(heat, refine)
    assert cells[0].tolist() == [0, 0] and cells[1].tolist() == [11, 15]
    assert scores.tolist() == [0.5, 0.5, 0.0] and np.isfinite(cells).all()


def test_single_heads_prefer_the_person_in_the_middle():
    rows = columns = 32
    heads = {
        "center": gaussian([(16, 16)], rows, columns, 1.0, 0.6) + gaussian([(3, 3)], rows, columns, 1.0, 0.9),
        "heat": gaussian([(18, 12)], rows, columns, 1.0, 0.7) + gaussian([(4, 2)], rows, columns, 1.0, 0.8),
        "regress": np.zeros((2, rows, columns), np.float32),
        "offset": np.full((2, rows, columns), 0.5, np.float32),
    }
    heads["regress"][:, 16, 16] = -4, 2  # y before x: row 12, column 18
    heads["offset"][:, 12, 18] = 0.25, 0.75
    points, scores = decode_single_heads(heads, 4)
    np.testing.assert_allclose(points, [[4 * 18.75, 4 * 12.25]])
    np.testing.assert_allclose(scores, [0.7], atol=1e-6)  # the plain map, not the weighted one
