import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.detection.score_maps import (
    NOBODY,
    PatchArrays,
    PatchSet,
    gate_radius,
    gated,
    merged_patches,
    person_patches,
    quantised,
)
from panoptic_ros.domain import JointMap

AFFINE = np.array([[0.25, 0.0, 0.0], [0.0, 0.25, 0.0]])
STRAIGHT = JointMap(2, ((0,), (1,)))


def record(levels, patches, joint_map=STRAIGHT):
    return PatchSet((levels.shape[2], levels.shape[1]), AFFINE, patches).score_maps(joint_map)


def gaussians(places, rows=40, columns=50, sigma=1.4):
    y, x = np.mgrid[:rows, :columns]
    return np.array(
        [
            np.max([np.exp(-((x - px) ** 2 + (y - py) ** 2) / (2 * sigma**2)) for px, py in joint], axis=0)
            for joint in places
        ]
    )


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 4))
def test_patches_together_are_the_maps_above_the_cut(seed, people):
    rng = np.random.default_rng(seed)
    maps = rng.random((2, 14, 17)) ** 6
    levels = quantised(maps, 0.05)
    cells = rng.uniform(-3, 20, (people, 2, 2))
    seen = rng.random((people, 2)) < 0.8
    patches = merged_patches(levels, cells, seen, rng.uniform(1, 6, people))
    made = record(levels, patches)
    np.testing.assert_array_equal(made.dense(2), levels)
    assert set(made.persons.tolist()) <= {NOBODY, *range(people)}
    # every cell is carried once: the patches add up to the maps as well
    assert int(made.data.astype(int).sum()) == int(levels.astype(int).sum())


def test_quantising_cuts_and_rounds():
    levels = quantised(np.array([-1.0, 0.0, 0.049, 0.05, 0.5, 1.0, 2.0]).reshape(1, 1, -1), 0.05)
    assert levels.ravel().tolist() == [0, 0, 0, 13, 128, 255, 255] and levels.dtype == np.uint8


def test_each_person_gets_the_blob_at_his_joint_and_the_rest_is_nobodys():
    places = [[(10, 10), (30, 20), (45, 35)], [(12, 30), (32, 8)]]
    levels = quantised(gaussians(places), 0.05)
    cells = np.array([[[10, 10], [12, 30]], [[30.4, 20.2], [32, 8]]], float)
    made = record(levels, merged_patches(levels, cells, np.ones((2, 2), bool), np.array([6.0, 6.0])))
    middles = made.corners + 0.5 * (made.sizes - 1)
    owners = {(j, p): middle for j, p, middle in zip(made.joints, made.persons, middles)}
    assert set(owners) == {(0, 0), (0, 1), (0, NOBODY), (1, 0), (1, 1)}
    np.testing.assert_allclose(owners[0, 1], (30, 20))
    np.testing.assert_allclose(owners[0, NOBODY], (45, 35))


def test_a_shared_blob_is_split_at_the_middle():
    levels = quantised(gaussians([[(20, 20), (24, 20)], []][:1] * 2), 0.05)
    cells = np.array([[[20, 20], [20, 20]], [[24, 20], [24, 20]]], float)
    made = record(levels, merged_patches(levels, cells, np.ones((2, 2), bool), np.array([8.0, 8.0])))
    assert set(made.persons.tolist()) == {0, 1}
    left, right = (made.corners[made.persons == p][0, 0] for p in (0, 1))
    assert left < 20 and right in (22, 23)


def test_unseen_joints_claim_nothing_and_people_without_maps_have_none():
    levels = quantised(gaussians([[(20, 20)], [(20, 20)]]), 0.05)
    cells = np.full((1, 2, 2), 20.0)
    made = record(levels, merged_patches(levels, cells, np.array([[True, False]]), np.array([6.0])))
    assert sorted(zip(made.joints.tolist(), made.persons.tolist())) == [(0, 0), (1, NOBODY)]
    empty = np.zeros_like(levels)
    assert len(merged_patches(empty, cells, np.ones((1, 2), bool), np.array([6.0]))) == 0


def test_joints_are_those_of_the_working_skeleton():
    levels = quantised(gaussians([[(20, 20)], [(10, 10)]]), 0.05)
    patches = merged_patches(levels, np.zeros((0, 2, 2)), np.zeros((0, 2), bool), np.zeros(0))
    made = record(levels, patches, JointMap(2, ((0, 1), (1,), (), (0,), (1,))))
    assert sorted(made.joints.tolist()) == [1, 3, 4]  # 0 is a mean, 2 is never seen
    dense = made.dense(5)
    np.testing.assert_array_equal(dense[3], levels[0])
    np.testing.assert_array_equal(dense[1], dense[4])


def test_no_patches_is_a_valid_record():
    made = record(np.zeros((2, 5, 6), np.uint8), PatchArrays.of([]))
    assert made.data.size == 0 and made.dense(2).max() == 0 and made.grid_size == (6, 5)


def test_unclaimed_joints_count_strong_peaks_of_nobody():
    levels = quantised(gaussians([[(20, 20), (40, 20)], [(10, 10)]]), 0.05)
    patches = merged_patches(levels, np.array([[[20, 20], [10, 10]]]), np.ones((1, 2), bool), np.array([6.0]))
    made = PatchSet((50, 40), AFFINE, patches)
    assert made.unclaimed_joints(0.3) == 1
    assert (
        PatchSet(
            (50, 40), AFFINE, merged_patches(levels, np.zeros((0, 2, 2)), np.zeros((0, 2), bool), np.zeros(0))
        ).unclaimed_joints(0.3)
        == 2
    )


def test_gates_of_one_person():
    levels = quantised(gaussians([[(20, 20), (40, 20)]] * 2), 0.05)
    kept = gated(levels, np.full((2, 2), 20.0), np.array([True, False]), 6.0)
    assert kept[0, 20, 20] == 255 and kept[0, 20, 40] == 0 and kept[1].max() == 0
    patches = person_patches(kept, 3, (100, 200))
    assert len(patches) == 1 and patches[0].person == 3
    assert patches[0].corner[0] > 110 and patches[0].corner[1] > 210


def test_the_gate_grows_with_the_person_within_limits():
    assert gate_radius(np.array([1.0, 40.0, 1000.0])).tolist() == [3.0, 6.0, 14.0]


def test_thirty_one_views_of_ten_people_stay_below_five_megabytes():
    rng = np.random.default_rng(0)
    cells = rng.uniform(5, 120, (10, 17, 2)) * (1, 0.7)
    levels = quantised(gaussians(np.moveaxis(cells, 0, 1), 96, 128), 0.05)
    patches = merged_patches(levels, cells, np.ones((10, 17), bool), np.full(10, 6.0))
    made = record(levels, patches, JointMap(17, tuple((k,) for k in range(17))))
    arrays = (made.data, made.joints, made.persons, made.corners, made.sizes)
    assert 31 * sum(array.nbytes for array in arrays) < 5e6


def nearest_joints(levels, cells, seen, radius):
    """For each cell the person in whose gate it lies, whose joint is nearest; the first of equals."""
    owners = np.full(levels.shape, NOBODY)
    for joint, row, column in np.ndindex(levels.shape):
        gaps = [
            np.float32((row - y) ** 2 + (column - x) ** 2) if seen[p, joint] else np.inf
            for p, (x, y) in enumerate(cells[:, joint])
        ]
        inside = [gap if gap <= reach**2 else np.inf for gap, reach in zip(gaps, radius)]
        if inside and min(inside) < np.inf:
            owners[joint, row, column] = int(np.argmin(inside))
    return owners


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 4))
def test_each_patch_is_all_that_is_nearest_to_a_joint_and_nothing_else(seed, people):
    rng = np.random.default_rng(seed)
    levels = quantised(rng.random((3, 9, 12)) ** 3, 0.05)
    cells = rng.uniform(-6, 16, (people, 3, 2))
    cells = np.where(rng.random(cells.shape) < 0.3, np.round(cells), cells)
    seen, radius = rng.random((people, 3)) < 0.8, rng.uniform(1, 6, people)
    before = levels.copy()
    own = [p for p in merged_patches(levels, cells, seen, radius) if p.person != NOBODY]
    np.testing.assert_array_equal(levels, before)
    owners = nearest_joints(levels, cells, seen, radius)
    expected = {}
    for person, joint in np.ndindex(people, 3):
        mine = np.where(owners[joint] == person, levels[joint], 0)
        if mine.any():
            rows, columns = np.flatnonzero(mine.any(axis=1)), np.flatnonzero(mine.any(axis=0))
            window = mine[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
            expected[person, joint] = ((columns[0], rows[0]), window)
    assert [(p.person, p.joint) for p in own] == list(expected)
    for patch, (corner, values) in zip(own, expected.values()):
        assert patch.corner == corner
        np.testing.assert_array_equal(patch.values, values)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000))
def test_what_is_nobodys_is_one_patch_for_each_blob(seed):
    rng = np.random.default_rng(seed)
    levels = quantised(rng.random((3, 9, 12)) ** 3, 0.3)
    nobody = np.zeros((0, 3, 2)), np.zeros((0, 3), bool), np.zeros(0)
    found = {(p.joint, p.corner, p.values.tobytes()) for p in merged_patches(levels, *nobody)}
    expected = set()
    for joint, values in enumerate(levels):
        count, labels = cv2.connectedComponents((values > 0).astype(np.uint8), connectivity=8)
        for label in range(1, count):
            left, top, width, height = cv2.boundingRect((labels == label).astype(np.uint8))
            own = np.where(labels == label, values, 0)[top : top + height, left : left + width]
            expected.add((joint, (left, top), own.tobytes()))
    assert found == expected
