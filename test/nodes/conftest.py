"""A small recorded bag, made once."""
import captures
import pytest

from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.messages import bag_messages, to_message


def write_bag(path, views, rig=captures.RIG, skeleton=captures.SKELETON):
    family = bag_messages()
    with BagWriter(path) as bag:
        if rig is not None:
            bag.write("/rig", 0, to_message(rig, family))
        if skeleton is not None:
            bag.write("/skeleton_model", 0, to_message(skeleton, family))
        for view in views:
            bag.write(f"/{view.camera}/detections", view.stamp_ns, to_message(view, family))
    return path


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("bag") / "people", captures.views(40))
