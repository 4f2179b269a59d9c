"""What waits of the views of an instant."""

from collections import deque

import numpy as np

from panoptic_ros.domain import ViewAppearance, ViewSources


def seen(camera, *frames):
    return deque(ViewAppearance(camera, frame, frame, np.zeros((0, 2, 3))) for frame in frames)


def test_what_waits_of_the_views_is_taken_out_with_all_that_is_older():
    sources = ViewSources(("a", "b", "c"), [7, 7, 4], np.zeros((0, 3)))
    waiting = {"a": seen("a", 5, 6, 7, 8), "b": seen("b", 6, 9)}
    found = sources.taken_from(waiting)
    assert {camera: record.frame_number for camera, record in found.items()} == {"a": 7}
    assert [record.frame_number for record in waiting["a"]] == [8]
    assert [record.frame_number for record in waiting["b"]] == [9]
