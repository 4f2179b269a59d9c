"""Records refuse bad content and keep what they are given."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.domain import (
    DetectionSet,
    FrameRate,
    Groups,
    JointMap,
    PoseSet,
    Prediction,
    ScoreMaps,
    SkeletonModel,
    Timecode,
    TrackedPoseSet,
    ViewDetections,
    ViewFrame,
    ViewSources,
)
from panoptic_ros.errors import ClockError, ConfigError, DataError

RATES = [
    FrameRate(24, Fraction(24000, 1001)),
    FrameRate(24, Fraction(24)),
    FrameRate(25, Fraction(25)),
    FrameRate(30, Fraction(30000, 1001)),
    FrameRate(30, Fraction(30000, 1001), True),
    FrameRate(30, Fraction(30)),
]


def view(points=((1.0, 2.0),), scores=(0.5,), **more):
    fields = {
        "camera": "a",
        "stamp_ns": 1,
        "frame_number": 0,
        "image_size": (4, 3),
        "skeleton_hash": "h",
        "person_scores": [0.5],
        **more,
    }
    return ViewDetections(points=[points], scores=[scores], **fields)


def test_arrays_of_callers_stay_writable_and_apart():
    places, numbers = np.zeros((1, 2, 3)), np.zeros((1, 2))
    people = Prediction(places, places, numbers, places, numbers > 0.0)
    member = np.zeros((1, 2), np.int64)
    groups = Groups(member, member > 0)
    places[:], member[:] = 1.0, 1
    assert not people.positions.any() and not groups.member.any()
    with pytest.raises(ValueError, match="read-only"):
        groups.member[:] = 1


def test_arrays_are_copied_and_read_only():
    points = np.array([[[1.0, 2.0]]])
    record = ViewDetections("a", 1, 0, (4, 3), "h", points, [[0.5]], [0.5])
    points[:] = 9
    assert record.points[0, 0].tolist() == [1.0, 2.0]
    with pytest.raises(ValueError, match="read-only"):
        record.points[0, 0, 0] = 3


@pytest.mark.parametrize(
    "bad",
    [
        {"points": ((np.nan, 2.0),)},
        {"points": ((np.inf, 2.0),), "scores": (0.0,)},
        {"scores": (1.5,)},
        {"scores": (np.nan,)},
        {"scores": (0.5, 0.5)},
        {"stamp_ns": -1},
        {"stamp_ns": 1.5},
        {"image_size": (0, 3)},
        {"person_scores": [0.1, 0.2]},
        {"camera": ""},
    ],
)
def test_bad_view_is_refused(bad):
    with pytest.raises(DataError):
        view(**bad)


def test_a_score_that_is_no_share_is_named():
    with pytest.raises(DataError, match=r"ViewDetections.scores has the score 97, outside of 0..1; scale"):
        view(scores=(97.0,))


def test_set_refuses_a_camera_twice_and_mixed_skeletons():
    with pytest.raises(DataError, match="twice"):
        DetectionSet(0, 1, "h", (view(), view()))
    with pytest.raises(DataError, match="skeleton"):
        DetectionSet(0, 1, "g", (view(),))


def test_image_must_be_bgr_bytes():
    with pytest.raises(DataError, match="uint8"):
        ViewFrame("a", 1, 0, np.zeros((4, 4, 3)))


def test_score_maps_take_the_maximum_of_patches():
    affine = [[1, 0, 0], [0, 1, 0]]
    sizes = [[2, 1], [2, 1], [1, 1]]
    data = [10, 20, 15, 5, 7]
    maps = ScoreMaps((4, 3), affine, [0, 0, 1], [0, 1, -1], [[0, 0], [1, 0], [3, 2]], sizes, data)
    dense = maps.dense(2)
    assert dense[0, 0].tolist() == [10, 20, 5, 0] and dense[1, 2, 3] == 7 and dense.sum() == 42
    with pytest.raises(DataError, match="outside"):
        ScoreMaps((4, 3), affine, [0], [0], [[3, 0]], [[2, 1]], [1, 2])
    with pytest.raises(DataError, match="to a line"):
        ScoreMaps((4, 3), np.zeros((2, 3)), [0], [0], [[0, 0]], [[2, 1]], [1, 2])
    with pytest.raises(DataError, match="bytes"):
        ScoreMaps((4, 3), affine, [0], [0], [[0, 0]], [[2, 1]], [1])


def test_poses_refuse_half_missing_joints_and_double_ids():
    good = dict(
        index=0,
        stamp_ns=1,
        skeleton_hash="h",
        positions=np.zeros((2, 1, 3)),
        covariances=np.zeros((2, 1, 3, 3)),
        scores=np.ones((2, 1)),
        views=np.ones((2, 1)),
        states=np.ones((2, 1)),
        person_scores=np.ones(2),
    )
    PoseSet(**good)
    with pytest.raises(DataError, match="missing"):
        PoseSet(**{**good, "states": np.zeros((2, 1))})
    with pytest.raises(DataError, match="not finite"):
        PoseSet(**{**good, "covariances": np.full((2, 1, 3, 3), np.nan)})
    with pytest.raises(DataError, match="twice"):
        TrackedPoseSet(**good, ids=[1, 1])


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        ({"cameras": ("a", "a")}, "a camera twice: a, a"),
        ({"cameras": ("a",)}, "2 frame numbers for the views of 1 camera"),
        ({"persons": [[0]]}, r"expected \(P V\) with V = 2"),
        ({"persons": [[0, -2]]}, "index -2"),
        ({"frames": [0, -1]}, "frame number -1"),
    ],
)
def test_bad_sources_are_refused(bad, match):
    good = {"cameras": ("a", "b"), "frames": [5, 6], "persons": [[0, -1], [2, 1]]}
    ViewSources(**good)
    with pytest.raises(DataError, match=match):
        ViewSources(**{**good, **bad})


def test_rows_of_sources_and_of_somebody_whom_no_view_shows():
    sources = ViewSources(("a", "b"), [5, 6], [[0, 3], [2, 1]])
    picked = sources.rows([1, -1, 0])
    assert picked.persons.tolist() == [[2, 1], [-1, -1], [0, 3]]
    assert picked.cameras == ("a", "b") and picked.frames.tolist() == [5, 6]
    assert sources.rows([]).persons.shape == (0, 2)
    assert sources.rows([]).rows([-1]).persons.tolist() == [[-1, -1]]


def test_sources_are_of_as_many_people_and_say_nothing_without_views():
    good = dict(
        index=0,
        stamp_ns=1,
        skeleton_hash="h",
        positions=np.zeros((2, 1, 3)),
        covariances=np.zeros((2, 1, 3, 3)),
        scores=np.ones((2, 1)),
        views=np.ones((2, 1)),
        states=np.ones((2, 1)),
        person_scores=np.ones(2),
    )
    with pytest.raises(DataError, match="2D people of 1 people for 2"):
        PoseSet(**good, sources=ViewSources(("a",), [5], [[0]]))
    assert PoseSet(**good, sources=ViewSources((), (), np.zeros((2, 0)))).sources is None


def test_joint_map_means_need_all_sources():
    mapping = JointMap(3, ((0,), (0, 1), ()))
    points = np.array([[[0.0, 0], [2, 4], [9, 9]]])
    mapped, scores = mapping.apply(points, np.array([[0.5, 0.8, 1.0]]))
    assert mapped[0, 1].tolist() == [1.0, 2.0] and scores[0].tolist() == [0.5, 0.5, 0.0]
    assert np.isnan(mapped[0, 2]).all()
    mapped, scores = mapping.apply(points, np.array([[0.5, 0.0, 1.0]]))
    assert np.isnan(mapped[0, 1]).all() and scores[0, 1] == 0


def test_skeleton_must_be_a_tree():
    with pytest.raises(ConfigError, match="no bone leads to c"):
        SkeletonModel("s", ("a", "b", "c"), 0, ((0, 1),), 0)
    with pytest.raises(ConfigError, match="does not extend"):
        SkeletonModel("s", ("a", "b", "c"), 0, ((0, 1), (1, 0)), 0)


@given(st.integers(0, 24 * 3600 * 30), st.sampled_from(RATES))
def test_timecode_counts_frames_both_ways(count, rate):
    label = Timecode.from_frame_count(count, rate)
    day = 24 * 107892 if rate.drop_frame else 24 * 3600 * rate.nominal
    assert label.frame_count == count % day


def test_drop_frame_skips_labels_not_frames():
    rate = RATES[4]
    before = Timecode(0, 0, 59, 29, rate)
    assert str(Timecode.from_frame_count(before.frame_count + 1, rate)) == "00:01:00;02"
    assert float(Timecode(1, 0, 0, 0, rate).frame_count / rate.exact) == pytest.approx(3600.0, abs=0.01)
    with pytest.raises(ClockError, match="no such timecode"):
        Timecode(0, 1, 0, 0, rate)
