"""What pairs messages is read without decoding them."""

import pytest
from recorded_scene import as_bytes, make_poses, make_preview, make_rig, make_view

from panoptic_ros.domain import PoseSet
from panoptic_ros.errors import DataError
from panoptic_ros.view.page.peek import detections_head, skeletons_head, stamp_of_bytes
from panoptic_ros.view.page.presence import ids_of

RIG = make_rig()
STAMP = 1_234_567_890_123_456_789


@pytest.mark.parametrize("little", [True, False])
@pytest.mark.parametrize("index", [0, 40, 110])
def test_heads_are_what_was_written(index, little):
    poses = make_poses(RIG, index, STAMP)
    assert skeletons_head(as_bytes(poses, little)) == (STAMP, STAMP, dict.fromkeys(RIG.names, 1000 + index))
    view = make_view(RIG.cameras[2], poses, STAMP - 5)
    assert detections_head(as_bytes(view, little)) == (STAMP - 5, 1000 + index)
    assert stamp_of_bytes(as_bytes(make_preview("cam1", STAMP), little)) == STAMP
    assert ids_of(as_bytes(poses, little)) == poses.ids.tolist()


def test_skeletons_that_name_no_views():
    poses = make_poses(RIG, 40, STAMP)
    names = [name for name in PoseSet.__dataclass_fields__ if name != "sources"]
    alone = PoseSet(**{name: getattr(poses, name) for name in names})
    assert skeletons_head(as_bytes(alone)) == (STAMP, STAMP, {})


def test_what_is_cut_off_is_told():
    data = as_bytes(make_poses(RIG, 40, STAMP))
    for length in range(100):
        with pytest.raises(DataError):
            skeletons_head(data[:length])
    for length in range(20):
        with pytest.raises(DataError):
            detections_head(data[:length])
    for length in range(12):
        with pytest.raises(DataError):
            stamp_of_bytes(data[:length])
