import numpy as np
import pytest
from score_fields import KeypointField, ViewField, keypoint_widths

from panoptic_ros.domain import ScoreMaps, ViewDetections

SIZE = (100, 80)


def view(points, scores, maps=None):
    points = np.array(points, float)
    return ViewDetections("a", 0, 0, SIZE, "x", points, scores, np.ones(len(points)), maps)


def one_patch(joint=0, person=-1, corner=(2, 3), values=((0, 102), (204, 255)), grid=(20, 16)):
    values = np.array(values, np.uint8)
    return ScoreMaps(
        grid,
        np.array([[0.2, 0.0, 0.1], [0.0, 0.2, -0.3]]),
        [joint],
        [person],
        [corner],
        [values.shape[::-1]],
        values.ravel(),
    )


def pixel_of(cell_x, cell_y):
    return np.array([[(cell_x - 0.1) / 0.2, (cell_y + 0.3) / 0.2]])


def test_keypoint_field_is_a_gaussian_times_the_score():
    field = KeypointField(np.array([[[10.0, 20.0]]]), np.array([[0.8]]), np.array([2.0]))
    pixels = np.array([[10.0, 20.0], [12.0, 20.0], [10.0, 24.0], [40.0, 20.0]])
    assert field.sample(0, pixels) == pytest.approx([0.8, 0.8 * np.exp(-0.5), 0.8 * np.exp(-2.0), 0.0])


def test_keypoint_field_takes_the_best_person_and_ignores_missing_joints():
    points = np.array([[[10.0, 20.0]], [[11.0, 20.0]], [[np.nan, np.nan]]])
    field = KeypointField(points, np.array([[0.2], [0.9], [0.0]]), np.array([2.0, 1.0, 1.0]))
    assert field.sample(0, np.array([[10.0, 20.0]])) == pytest.approx([0.9 * np.exp(-0.5)])
    assert field.sample_person(0, 0, np.array([[10.0, 20.0]])) == pytest.approx([0.2])
    assert field.sample_person(2, 0, np.array([[10.0, 20.0]])) == pytest.approx([0.0])


def test_width_follows_the_box_but_not_below_the_floor():
    points = np.array([[[0.0, 0.0], [40.0, 90.0]], [[0.0, 0.0], [0.0, 80.0]], [[np.nan] * 2, [5.0, 5.0]]])
    widths = keypoint_widths(points, SIZE, 0.025)
    assert widths == pytest.approx([0.025 * 60.0, 0.025 * 40.0, 0.002 * np.hypot(*SIZE)])
    assert keypoint_widths(np.zeros((0, 3, 2)), SIZE, 0.025).shape == (0,)


def test_map_is_sampled_bilinearly_at_the_affine_place():
    field = ViewField(view(np.zeros((0, 2, 2)), np.zeros((0, 2)), one_patch()))
    cells = [(3, 3, 0.4), (2.5, 3, 0.2), (2.5, 3.5, (0.0 + 0.4 + 0.8 + 1.0) / 4), (4, 4, 0.0), (3.5, 4, 0.5)]
    for x, y, expected in cells:
        assert field.sample(0, pixel_of(x, y)) == pytest.approx([expected]), (x, y)


def test_zero_outside_of_image_and_grid():
    maps = one_patch(corner=(0, 0), values=np.full((4, 4), 255), grid=(4, 4))
    field = ViewField(view(np.zeros((0, 2, 2)), np.zeros((0, 2)), maps))
    assert field.sample(0, pixel_of(3.4, 3.4)) == pytest.approx([1.0])
    assert field.sample(0, pixel_of(3.6, 3.0)) == pytest.approx([0.0])
    assert not field.covers(pixel_of(3.6, 3.0))[0]
    plain = ViewField(view([[[99.4, 40.0]]], [[1.0]]))
    pixels = np.array([[99.4, 40.0], [99.6, 40.0], [np.nan, 0.0]])
    assert plain.covers(pixels).tolist() == [True, False, False]
    assert plain.sample(0, np.array([[99.6, 40.0]])) == pytest.approx([0.0])


def test_fields_are_mixed_joint_by_joint():
    field = ViewField(view([[[10.0, 20.0], [50.0, 60.0]]], [[0.7, 0.6]], one_patch(joint=0)))
    assert field.sample(0, np.array([[50.0, 60.0]])) == pytest.approx([0.0])
    assert field.sample(1, np.array([[50.0, 60.0]])) == pytest.approx([0.6])


def test_merged_maps_count_for_the_people_within_the_gate():
    at = pixel_of(3, 4)
    points = np.stack([at, at + (30.0, 0.0)])
    field = ViewField(view(points, np.full((2, 1), 0.5), one_patch()), relative_width=0.025, gate=4.0)
    assert field.sample_person(0, 0, at) == pytest.approx([1.0])
    assert field.sample_person(1, 0, at) == pytest.approx([0.0])


def test_maps_of_a_person_count_for_that_person_only():
    at = pixel_of(3, 4)
    points = np.stack([at, at])
    field = ViewField(view(points, np.full((2, 1), 0.5), one_patch(person=1)))
    assert field.sample_person(0, 0, at) == pytest.approx([0.0])
    assert field.sample_person(1, 0, at) == pytest.approx([1.0])
    assert field.sample(0, at) == pytest.approx([1.0])
