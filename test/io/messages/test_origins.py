from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.domain import DetectionSet, ViewDetections
from panoptic_ros.io.messages import bag_messages, from_message, to_message
from panoptic_ros.io.messages.family import bag_typestore
from panoptic_ros.io.messages.records import MOST_KEPT, OriginalMessages

FAMILY = bag_messages()
KIND = "panoptic_msgs/msg/DetectionSet"


def view(stamp_ns):
    return ViewDetections("a", stamp_ns, 0, (640, 480), "cafe", np.ones((1, 2, 2)), np.ones((1, 2)), [0.5])


def came(record, origins):
    """The record of a message, as a node reads it."""
    message = to_message(record, FAMILY)
    found = from_message(message, type(record).__name__)
    origins.keep(found, message)
    return found, message


def test_what_goes_on_inside_is_the_message_that_it_came_as_with_the_same_bytes():
    origins = OriginalMessages(["DetectionSet"])
    found, message = came(view(7), origins)
    item = DetectionSet(0, 7, "cafe", (found,))
    written = to_message(item, replace(FAMILY, origin=origins.of))
    assert written.views[0] is message
    anew = to_message(item, FAMILY)
    assert anew.views[0] is not message
    pack = bag_typestore().serialize_cdr
    assert bytes(pack(written, KIND)) == bytes(pack(anew, KIND))


def test_what_was_changed_on_the_way_is_written_anew():
    origins = OriginalMessages(["DetectionSet"])
    found, _ = came(view(7), origins)
    item = DetectionSet(0, 8, "cafe", (replace(found, stamp_ns=8),))
    assert to_message(item, replace(FAMILY, origin=origins.of)).views[0].header.stamp.nanosec == 8


@pytest.mark.parametrize(("given", "kept"), [(["DetectionSet"], MOST_KEPT), (["RefinedPoseSet"], 0), ([], 0)])
def test_few_are_kept_and_only_where_they_are_wanted(given, kept):
    origins = OriginalMessages(given)
    records = [came(view(k), origins)[0] for k in range(MOST_KEPT + 5)]
    found = [origins.of(record) is not None for record in records]
    assert found == [False] * (len(records) - kept) + [True] * kept
