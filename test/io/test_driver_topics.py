"""The file of `panoptic run --topics`."""

import pytest

from panoptic_ros.errors import DataError
from panoptic_ros.io.driver_topics import DriverTopics, read_driver_topics


def test_topics_in_the_order_of_the_file(tmp_path):
    path = tmp_path / "drivers.yaml"
    path.write_text(
        "right: {image: /r/image_raw/compressed}\n"
        "left: {image: /l/image_raw, camera_info: /l/camera_info, depth: /l/depth, encoding: bayer_rggb8}\n"
    )
    found = read_driver_topics(path)
    assert list(found.cameras.items()) == [
        ("right", DriverTopics("/r/image_raw/compressed")),
        ("left", DriverTopics("/l/image_raw", "/l/camera_info", "/l/depth", "bayer_rggb8")),
    ]
    assert not found.sensors and not found.fixed_frame
    assert dict(found.cameras["right"].named) == {"image": "/r/image_raw/compressed"}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "expected a table of cameras"),
        ("[a, b]", "expected a table of cameras"),
        ("left: /l/image_raw", "camera left has no 'image'"),
        ("left: {camera_info: /l}", "camera left has no 'image'"),
        ("left: {image: /l, images: /l}", "unknown key 'images'; the nearest known one is 'image'"),
        ("left: {image: [1]}", r"image is \[1\], expected a name"),
        ("left: {image: l/image_raw}", "write the whole name, /l/image_raw"),
        ("left: {depth: /d, encoding: mono8}", "depth sensor left has an encoding"),
        ("fixed_frame: [map]\nleft: {image: /i}", r"fixed_frame is \['map'\], expected the name"),
        ("a: {depth: /d}\nb: {depth: /d}", "a and b have the same depth /d"),
        ("left: {image: /i}\nright: {image: /i}", "left and right have the same image /i"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, told):
    path = tmp_path / "drivers.yaml"
    path.write_text(text)
    with pytest.raises(DataError, match=told):
        read_driver_topics(path)


def test_depth_sensors_alone_and_the_fixed_frame(tmp_path):
    path = tmp_path / "drivers.yaml"
    path.write_text(
        "fixed_frame: hall\nk1: {depth: /k1/depth, camera_info: /k1/info}\nleft: {image: /l/image_raw}\n"
    )
    found = read_driver_topics(path)
    assert found.fixed_frame == "hall" and list(found.cameras) == ["left"]
    assert dict(found.sensors) == {"k1": DriverTopics(depth="/k1/depth", camera_info="/k1/info")}
    assert list(found.everything) == ["left", "k1"]
