"""Samples of IMUs out of the bytes of their messages: what the messages themselves say."""

import numpy as np
import pytest

pytest.importorskip("rclpy")
from rclpy.serialization import serialize_message

from panoptic_ros.errors import DataError
from panoptic_ros.nodes.middleware.decoding import decoder_of, packed_decoder_of
from panoptic_ros.nodes.middleware.family import message_class
from panoptic_ros.nodes.middleware.packets import unpacked

IMU = message_class("sensor_msgs/msg/Imu")


def message(frame_id="imu", **first):
    """One whose numbers all differ; first: of each covariance that is not 0."""
    rng = np.random.default_rng(0)
    found = IMU()
    found.header.frame_id, found.header.stamp.sec, found.header.stamp.nanosec = frame_id, 12, 345
    turn = rng.normal(size=4)
    x, y, z, w = (turn / np.linalg.norm(turn)).tolist()
    found.orientation.x, found.orientation.y, found.orientation.z, found.orientation.w = x, y, z, w
    for vector in (found.angular_velocity, found.linear_acceleration):
        vector.x, vector.y, vector.z = rng.normal(size=3).tolist()
    for name in ("orientation", "angular_velocity", "linear_acceleration"):
        getattr(found, f"{name}_covariance")[:] = rng.uniform(0.1, 1.0, 9)
    for name, value in first.items():
        getattr(found, f"{name}_covariance")[0] = value
    return found


def both(data):
    return packed_decoder_of("imu", "d")(data), decoder_of("imu", "d", 0, 0)(unpacked(data, IMU), 0)


@pytest.mark.parametrize("unknown", [{}, {"angular_velocity": -1.0}])
@pytest.mark.parametrize("length", range(9))
def test_bytes_say_what_the_message_says(length, unknown):
    quick, slow = both(serialize_message(message("x" * length, **unknown)))
    assert (quick.device, quick.stamp_ns) == (slow.device, slow.stamp_ns) == ("d", 12_000_000_345)
    for name in ("orientation", "rate", "force"):
        assert np.array_equal(getattr(quick, name), getattr(slow, name), equal_nan=True)
        assert not getattr(quick, name).flags.writeable
    assert np.isnan(quick.rate).all() == bool(unknown) and not np.isnan(quick.force).any()


@pytest.mark.parametrize("values", [(0.0, 0.0, 0.0, 0.0), (np.nan,) * 4, (0.0, np.nan, 0.0, 1.0)])
def test_orientations_of_zeros_or_nan_are_not_there(values):
    given = message()
    for part, value in zip("xyzw", values):
        setattr(given.orientation, part, value)
    for found in both(serialize_message(given)):
        assert np.isnan(found.orientation).all() and not np.isnan(found.force).any()


def test_what_is_no_plain_message_is_left_to_the_message_itself():
    data = serialize_message(message())
    for other in (data[:-1], data + b"\0", b"\0\0" + data[2:], b""):
        assert packed_decoder_of("imu", "d")(other) is None
    assert packed_decoder_of("bodies", "") is None


@pytest.mark.parametrize(
    "read",
    [
        lambda data: packed_decoder_of("imu", "d")(data),
        lambda data: decoder_of("imu", "d", 0, 0)(unpacked(data, IMU), 0),
    ],
)
def test_bad_numbers_are_refused_either_way(read):
    bad = message()
    bad.linear_acceleration.y = float("nan")
    with pytest.raises(DataError, match="Imu.linear_acceleration of d is .*nan.* covariance of -1"):
        read(serialize_message(bad))
    for part, value, told in (
        ("angular_velocity", 2000.0, "at most 1000"),
        ("linear_acceleration", float("inf"), "inf"),
    ):
        bad = message()
        getattr(bad, part).z = value
        with pytest.raises(DataError, match=told):
            read(serialize_message(bad))
    bad = message()
    bad.header.stamp.sec = -5
    with pytest.raises(DataError, match="out of range"):
        read(serialize_message(bad))
    bad = message()
    bad.orientation.w += 3.0
    with pytest.raises(DataError, match=r"ImuSample.orientation of d holds .*, expected 1|holds|length"):
        read(serialize_message(bad))


def textured(encoding, luma):
    """Return an Image of 4:2:2 whose brightness has details and stands in that byte of each pixel."""
    values = np.full((40, 60, 2), 128, np.uint8)
    values[..., luma] = np.random.default_rng(0).integers(20, 230, (40, 60))
    found = message_class("sensor_msgs/msg/Image")(width=60, height=40, step=120, encoding=encoding)
    found.data = values.tobytes()
    return found, values[..., luma]


def test_live_images_are_taken_as_the_first_with_details_shows_and_told_once():
    told = []
    decode = decoder_of("image", "c", 0, 0, tell=told.append)
    dark, _ = textured("yuv422", 1)
    dark.data = bytes([128, 16] * 2400)
    exchanged, grey = textured("yuv422", 0)
    assert not decode(dark, 0).image.any() and not told
    for number in (1, 2):
        shown = decode(exchanged, number).image.astype(int)
        assert np.abs(shown - np.clip((grey[..., None].astype(int) - 16) * 1.164, 0, 255)).max() < 2
    assert len(told) == 1 and "image of camera c has encoding yuv422" in told[0]


@pytest.mark.parametrize("encoding", ["", "uyvy"])
def test_images_are_taken_as_asked_for_and_recorded_ones_as_stated(encoding):
    exchanged, grey = textured("uyvy", 0)
    tell = pytest.fail if encoding else None
    shown = decoder_of("image", "c", 0, 0, encoding, tell)(exchanged, 0).image.astype(int)
    assert np.abs(shown.mean(axis=2) - grey).mean() > 20
