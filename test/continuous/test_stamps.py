"""Views whose timestamps cannot be right are left out and counted."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from panoptic_ros.continuous.stamps import partial_notices, rising_stamps, usable_views
from panoptic_ros.solving.frames import CameraFrame

NAMES = ("a", "b")
SECOND = 1_000_000_000


def frame(camera, stamp_s, value=None):
    """View of one person, whose joints have the value; by default, the value is the timestamp."""
    plane = np.full((1, 19, 2), stamp_s if value is None else value)
    return CameraFrame(camera, round(SECOND * stamp_s), plane, np.ones((1, 19)), np.zeros((1, 19)))


def take(seconds=4.0, rate=10.0):
    """Views of two cameras in turn; their values tell them apart."""
    steps = range(int(seconds * rate))
    return [frame(c, 10.0 + (k + 0.5 * c) / rate, value=k) for k in steps for c in (0, 1)]


def test_a_recording_without_faults_is_kept_in_the_order_of_timestamps():
    views = take()
    shuffled = [*views[1::2], *views[::2]]
    kept, notices = usable_views(shuffled, NAMES)
    assert kept == views and notices == []


@pytest.mark.parametrize(
    ("stamps", "count"),
    [
        ([], 0),
        ([5], 1),
        ([1, 2, 3], 3),
        ([3, 2, 1], 1),
        ([1, 2, 9, 3, 4], 4),
        ([1, 1, 2, 2], 2),
        ([0, 5, 1, 2, 3], 4),
    ],
)
def test_the_longest_increasing_part_is_found(stamps, count):
    chosen = rising_stamps(stamps)
    values = [stamps[k] for k in chosen]
    assert len(chosen) == count and chosen == sorted(chosen)
    assert all(a < b for a, b in pairwise(values))


def test_timestamps_that_run_backwards_or_repeat_are_left_out_and_counted_by_camera():
    views = take()
    views[20] = replace(views[20], stamp_ns=views[20].stamp_ns - SECOND)
    views[41] = replace(views[41], stamp_ns=views[39].stamp_ns)
    views[60] = replace(views[60], stamp_ns=views[60].stamp_ns + SECOND)
    kept, notices = usable_views(views, NAMES)
    assert len(kept) == len(views) - 3 and views[20] not in kept and views[60] not in kept
    (notice,) = notices
    assert notice.severity == "warning" and "3 of 80 views" in notice.text and "a (2), b (1)" in notice.text


def test_of_two_views_with_one_timestamp_the_first_counts():
    views = take()
    views[41] = replace(views[41], stamp_ns=views[39].stamp_ns)
    kept, _ = usable_views(views, NAMES)
    assert views[39] in kept and views[41] not in kept


def test_views_that_were_recorded_late_are_used():
    views = take()
    late = [*views[:20], views[22], views[21], views[20], *views[23:]]
    kept, notices = usable_views(late, NAMES)
    assert kept == views
    assert [notice.code for notice in notices] == ["continuous.late_views"] and "1 of 80" in notices[0].text


def test_an_image_that_a_camera_repeats_counts_once_and_is_told():
    views = take()
    for k in (21, 22, 24, 40):  # 22 and 24 show the same image
        views[k] = replace(views[k], plane=views[k - 2].plane)
    kept, notices = usable_views(views, NAMES)
    assert [view for view in views if view not in kept] == [views[k] for k in (21, 22, 24, 40)]
    (notice,) = notices
    assert notice.code == "continuous.repeated_images" and notice.values["views"] == {"a": 3, "b": 1}


@pytest.mark.parametrize("people", [0, 1])
def test_people_without_motion_or_noise_are_shown_four_times_a_second(people):
    views = [replace(view, plane=np.zeros((people, 19, 2))) for view in take()]
    views = [replace(view, scores=view.scores[:people], heights=view.heights[:people]) for view in views]
    kept, _ = usable_views(views, NAMES)
    gaps = np.diff([view.stamp_ns for view in kept if view.camera == 0])
    assert (gaps >= 0.25 * SECOND).all() and (gaps <= 0.3 * SECOND).all() if people else kept == views


def test_a_copy_of_a_view_counts_once_without_a_notice():
    views = take()
    kept, notices = usable_views([v for view in views for v in (view, replace(view))], NAMES)
    assert kept == views and notices == []


def test_a_view_at_another_time_than_all_others_does_not_stretch_the_recording():
    late = frame(0, 3600.0)
    kept, notices = usable_views([*take(), late], NAMES)
    assert late not in kept and len(kept) == 80
    assert [notice.code for notice in notices] == ["continuous.stray_stamps"]


def test_views_of_one_camera_alone_are_left_out_if_there_are_others():
    since_boot = [frame(0, 0.1 * k) for k in range(30)]
    kept, notices = usable_views([*since_boot, *take()], NAMES)
    assert len(kept) == 80 and notices[0].values["views"] == {"a": 30}


def test_cameras_without_a_common_time_are_kept_for_the_explanation():
    views = [*(frame(0, 0.1 * k) for k in range(30)), *(frame(1, 100.0 + 0.1 * k) for k in range(30))]
    kept, notices = usable_views(views, NAMES)
    assert len(kept) == 60 and notices == []


def test_a_camera_that_begins_late_is_named():
    views = [view for view in take() if view.camera == 0 or view.stamp_ns > 12 * SECOND]
    (notice,) = partial_notices(views, NAMES)
    assert notice.severity == "info" and "4.0 s only: b (2.0 to 4.0 s)" in notice.text
    assert partial_notices(views, NAMES, known={1}) == [] and partial_notices(take(), NAMES) == []
