"""Transforms survive their messages."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from panoptic_ros.errors import DataError
from panoptic_ros.geometry import Rigid
from panoptic_ros.io.messages import bag_messages
from panoptic_ros.io.messages.transforms import read_transform, transform_message


def test_round_trip():
    given = Rigid(Rotation.from_rotvec([0.3, -2.0, 0.7]).as_matrix(), [1.0, -2.0, 0.5])
    message = transform_message(bag_messages(), 5, "map", "cam", given)
    parent, child, back = read_transform(message)
    assert (parent, child, message.header.stamp.nanosec) == ("map", "cam", 5)
    np.testing.assert_allclose(back.rotation, given.rotation, atol=1e-12)
    np.testing.assert_allclose(back.translation, given.translation)


@pytest.mark.parametrize(("field", "value"), [("x", np.nan), ("y", np.inf)])
def test_what_is_no_transform_is_refused(field, value):
    message = transform_message(bag_messages(), 5, "map", "cam", Rigid.identity())
    setattr(message.transform.translation, field, value)
    with pytest.raises(DataError, match="from 'cam' to 'map' is none"):
        read_transform(message)
