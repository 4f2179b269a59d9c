"""The decoder against a plain search over all cells, and its answers to made maps."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from panoptic_ros.detection.decoders.center_heads import decode_center_heads

K = 4


def empty(rows=24, columns=32):
    return {
        "center": np.zeros((1, rows, columns), np.float32),
        "heat": np.zeros((K, rows, columns), np.float32),
        "regress": np.zeros((2 * K, rows, columns), np.float32),
        "offset": np.full((2 * K, rows, columns), 0.5, np.float32),
        "box_scale": np.full((2, rows, columns), 16.0, np.float32),
        "box_offset": np.zeros((2, rows, columns), np.float32),
    }


def put_person(heads, centre, joints, score=0.9, heat=0.8):
    y, x = centre
    heads["center"][0, y, x] = score
    for k, (row, column) in enumerate(joints):
        heads["heat"][k, row, column] = heat
        heads["regress"][2 * k : 2 * k + 2, y, x] = row - y, column - x


def test_one_person_is_found_where_the_maps_say():
    heads = empty()
    joints = [(10, 12), (8, 14), (14, 12), (12, 15)]
    put_person(heads, (11, 13), joints)
    heads["offset"][2:4, 8, 14] = 0.25, 0.75  # y before x
    people = decode_center_heads(heads, 4, 10, 0.1)
    assert len(people) == 1
    expected = 4.0 * (np.array(joints)[:, ::-1] + 0.5)
    expected[1] = 4 * (14 + 0.75), 4 * (8 + 0.25)
    np.testing.assert_allclose(people.points[0], expected, atol=1e-5)
    np.testing.assert_allclose(people.scores[0], 0.8, atol=1e-6)  # the guess was exact: weight 1
    np.testing.assert_allclose(people.person_scores, 0.9 * 0.8, atol=1e-6)
    np.testing.assert_allclose(people.boxes[0], [4 * (13 - 8), 4 * (11 - 8), 4 * (13 + 8), 4 * (11 + 8)])


def test_two_people_keep_their_own_joints_and_the_better_comes_first():
    heads = empty()
    put_person(heads, (12, 8), [(10, 6), (10, 9), (14, 6), (14, 9)], score=0.5)
    put_person(heads, (12, 20), [(10, 18), (10, 21), (14, 18), (14, 21)], score=0.9)
    people = decode_center_heads(heads, 4, 10, 0.1)
    assert people.person_scores[0] > people.person_scores[1]
    assert (people.points[0, :, 0] > 4 * 16).all() and (people.points[1, :, 0] < 4 * 12).all()


def test_low_scores_many_people_and_empty_maps():
    heads = empty()
    assert len(decode_center_heads(heads, 4, 10, 0.1)) == 0
    for column in (4, 12, 20, 28):
        put_person(heads, (12, column), [(12, column)] * K, score=0.3 + 0.01 * column)
    assert len(decode_center_heads(heads, 4, 10, 0.1)) == 4
    assert len(decode_center_heads(heads, 4, 2, 0.1)) == 2
    assert len(decode_center_heads(heads, 4, 10, 0.5)) == 0
    best = decode_center_heads(heads, 4, 1, 0.1)
    assert best.points[0, 0, 0] == 4 * 28.5


def test_cells_outside_of_the_box_do_not_count():
    heads = empty()
    put_person(heads, (12, 16), [(12, 16)] * K)
    heads["heat"][0, 12, 30] = 1.0  # better, but not in the box of 8 cells to each side
    assert decode_center_heads(heads, 4, 1, 0.1).points[0, 0, 0] == 4 * 16.5


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
@example(575)  # a box beyond the right border
def test_equals_a_search_over_all_cells(seed):
    rng = np.random.default_rng(seed)
    rows, columns = 16, 20
    heads = {
        "center": rng.random((1, rows, columns), np.float32),
        "heat": rng.random((K, rows, columns), np.float32),
        "regress": rng.normal(0, 4, (2 * K, rows, columns)).astype(np.float32),
        "offset": rng.random((2 * K, rows, columns), np.float32),
        "box_scale": rng.uniform(4, 20, (2, rows, columns)).astype(np.float32),
        "box_offset": rng.normal(0, 1, (2, rows, columns)).astype(np.float32),
    }
    people = decode_center_heads(heads, 4, 1000, 0.0)
    peaks = 0
    for y in range(rows):
        for x in range(columns):
            around = heads["center"][0, max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3]
            if heads["center"][0, y, x] < around.max():
                continue
            peaks += 1
            expected = [brute_force_joint(heads, k, y, x) for k in range(K)]
            distance = [np.abs(expected - p).max() for p in people.points]
            assert min(distance) < 1e-3
    assert len(people) == peaks


def cells_between(low, high, count):
    """Cells of an axis inside of a box; a box between cells, or beyond the border, has the next one."""
    inside = [cell for cell in range(count) if max(low, 0) <= cell < min(high, count)]
    return inside or [min(int(np.ceil(max(low, 0))), count - 1)]


def brute_force_joint(heads, k, y, x):
    rows, columns = heads["center"].shape[1:]
    gy, gx = heads["regress"][2 * k : 2 * k + 2, y, x] + (y, x)
    h, w = np.maximum(heads["box_scale"][:, y, x], 0)
    cy, cx = heads["box_offset"][:, y, x] + (y, x)
    best = (-1.0, 0, 0)
    for row in cells_between(cy - h / 2, cy + h / 2, rows):
        for column in cells_between(cx - w / 2, cx + w / 2, columns):
            weight = np.exp(-((row - gy) ** 2 + (column - gx) ** 2) / (0.3 * min(rows, columns)))
            best = max(best, (heads["heat"][k, row, column] * weight, row, column))
    _, row, column = best
    dy, dx = heads["offset"][2 * k : 2 * k + 2, row, column]
    return np.array([4 * (column + dx), 4 * (row + dy)])


def test_inputs_are_left_alone():
    heads = empty()
    put_person(heads, (11, 13), [(10, 12)] * K)
    before = {name: values.copy() for name, values in heads.items()}
    decode_center_heads(heads, 4, 10, 0.1)
    assert all(np.array_equal(values, before[name]) for name, values in heads.items())


@pytest.mark.parametrize("centre", [(0, 0), (23, 31), (0, 31)])
def test_people_at_the_border(centre):
    heads = empty()
    put_person(heads, centre, [centre] * K)
    people = decode_center_heads(heads, 4, 10, 0.1)
    np.testing.assert_allclose(people.points[0, 0], 4 * (np.array(centre[::-1]) + 0.5))
