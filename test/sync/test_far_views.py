"""Recorded sets: views with stamps of another clock are left out and named."""

import pytest

from panoptic_ros.domain import DetectionSet
from panoptic_ros.sync.far_views import without_far_views

SECOND = 10**9
KINDS = {
    "5 s ahead": lambda t: t + 5 * SECOND,
    "1 h ahead": lambda t: t + 3600 * SECOND,
    "since boot": lambda t: t + 652 * SECOND,
    "zero": lambda t: 0,
    "2^32 ns ahead": lambda t: t + 2**32,
}


def sets(bench, cameras="abcde", bad="", kind="since boot", rate=30.0, count=40):
    """Sets from 10 s on, some of whose cameras have wrong stamps."""
    found = []
    for k in range(count):
        t = round(SECOND * (10 + k / rate))
        stamps = [KINDS[kind](t) if c in bad else t + 1000 * i for i, c in enumerate(cameras)]
        views = [bench.view(c, stamp, k) for c, stamp in zip(cameras, stamps, strict=True)]
        found.append(DetectionSet(k, t, bench.skeleton.hash, tuple(views)))
    return found


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bad", ["a", "c", "be"])
def test_the_views_of_a_minority_are_left_out_and_named(bench, kind, bad):
    kept, notices = without_far_views(sets(bench, bad=bad, kind=kind))
    assert [item.stamp_ns for item in kept] == [item.stamp_ns for item in sets(bench)]
    assert all({v.camera for v in item.views} == set("abcde") - set(bad) for item in kept)
    assert [note.values["camera"] for note in notices] == sorted(bad)
    assert all(note.code == "sync.clock_off" and "40 of 40 frames" in note.text for note in notices)


@pytest.mark.parametrize("cameras", ["ab", "abcd"])
def test_without_a_majority_the_stamps_of_the_frames_decide(bench, cameras):
    bad = cameras[: len(cameras) // 2]
    kept, notices = without_far_views(sets(bench, cameras, bad))
    assert all({v.camera for v in item.views} == set(cameras) - set(bad) for item in kept)
    assert ["no majority" in note.text for note in notices] == [True] * len(bad)


def test_stamps_of_frames_that_only_the_wrong_camera_has(bench):
    wrong = [
        DetectionSet(item.index, item.stamp_ns + 652 * SECOND, item.skeleton_hash, item.views)
        for item in sets(bench, bad="a")
    ]
    kept, _ = without_far_views(wrong)
    apart = [item.stamp_ns - own.stamp_ns for item, own in zip(kept, sets(bench), strict=True)]
    assert max(map(abs, apart)) < 10_000


@pytest.mark.parametrize("rate", [0.3, 1.0, 30.0])
def test_good_sets_are_as_they_were(bench, rate):
    good = sets(bench, rate=rate)
    late = [
        DetectionSet(
            item.index,
            item.stamp_ns,
            item.skeleton_hash,
            tuple(
                bench.view(v.camera, v.stamp_ns + 0.45 * SECOND / rate, k) if v.camera == "d" else v
                for v in item.views
            ),
        )
        for k, item in enumerate(good)
    ]
    assert without_far_views(late) == (late, [])
