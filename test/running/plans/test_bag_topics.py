"""Which images of bags are taken, and as what: encodings that are given or shown, and videos."""

import captures
import numpy as np
import pytest
from mcap_files import Channel, write_mcap

from panoptic_ros.cli.main import main
from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import CalibrationError, DataError, UsageError
from panoptic_ros.io.bags import BagReader, BagWriter
from panoptic_ros.io.messages import bag_messages, compressed_image_message, to_message
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.running.plans.bag_topics import BagChoice, absent_told, image_streams, with_encodings

ANY = BagChoice()
SIZE = (48, 64)
FFMPEG = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"


def shades(camera):
    """Return brightness with details, levels."""
    return np.random.default_rng(len(camera)).integers(20, 230, SIZE).astype(np.uint8)


def write_images(path, encodings):
    """Write two images of each camera in 4:2:2, brightness in the first byte; the first one is dark."""
    family = bag_messages()
    with BagWriter(path) as bag:
        for camera, encoding in encodings.items():
            values = np.full((2, *SIZE, 2), 128, np.uint8)
            values[0, ..., 0], values[1, ..., 0] = 16, shades(camera)
            for k in (0, 1):
                message = family.make(
                    "sensor_msgs/msg/Image",
                    header=family.header(k, ""),
                    height=SIZE[0],
                    width=SIZE[1],
                    encoding=encoding,
                    is_bigendian=0,
                    step=2 * SIZE[1],
                    data=values[k].reshape(-1),
                )
                bag.write(f"/{camera}/image_raw", k, message)
    return path


def taken(path, choice=ANY):
    """Return streams, lines for the user, and the mean error of the second image, levels, by camera."""
    with BagReader(path) as bag:
        streams, told = with_encodings(image_streams(choice, [bag], captures.RIG, ""), [bag])
        errors = {}
        for stream in streams:
            frame = stream.record(list(stream.messages(bag))[1].message, 1)
            expected = np.clip((shades(stream.camera).astype(int) - 16) * 1.164, 0, 255)
            errors[stream.camera] = np.abs(frame.image.mean(axis=2) - expected).mean()
    return streams, told, errors


def test_images_are_taken_as_they_show_and_told(tmp_path):
    bag = write_images(tmp_path / "bag", {"cam0": "yuyv", "cam1": "yuv422", "cam2": "8UC2"})
    streams, told, errors = taken(bag)
    assert [stream.encoding for stream in streams] == ["", "yuyv", ""] and max(errors.values()) < 2
    assert len(told) == 2 and "/cam1/image_raw has encoding yuv422, but shows" in told[0]
    assert "/cam2/image_raw has encoding 8UC2, which names no colours: read as yuyv" in told[1]


def test_an_encoding_that_is_asked_for_counts_more(tmp_path):
    bag = write_images(tmp_path / "bag", {"cam0": "mono8", "cam1": "yuv422", "cam2": "yuyv"})
    choice = BagChoice(encodings={"": "YUYV", "cam2": "uyvy"})
    streams, told, errors = taken(bag, choice)
    assert [stream.encoding for stream in streams] == ["YUYV", "YUYV", "uyvy"] and not told
    assert max(errors["cam0"], errors["cam1"]) < 2 and errors["cam2"] > 20


@pytest.mark.parametrize(
    ("encodings", "kind", "told"),
    [({"cam9": "yuyv"}, CalibrationError, "cam9"), ({"": "yuyw"}, DataError, "'yuyw', perhaps yuy")],
)
def test_encodings_that_cannot_be_are_refused(tmp_path, encodings, kind, told):
    bag = write_images(tmp_path / "bag", {"cam0": "yuyv"})
    with pytest.raises(kind, match=told):
        taken(bag, BagChoice(encodings=encodings))


def test_encodings_of_what_states_none_are_refused(tmp_path):
    with BagWriter(tmp_path / "people") as bag:
        view = captures.view(captures.RIG.cameras[0], 0, 0)
        bag.write("/cam0/detections", 0, to_message(view, bag_messages()))
    with BagWriter(tmp_path / "jpeg") as bag:
        frame = ViewFrame("cam0", 0, 0, np.zeros((*SIZE, 3), np.uint8))
        bag.write("/cam0/image_raw/compressed", 0, compressed_image_message(frame, bag_messages(), 90))
    for name, told in (("people", "--redetect"), ("jpeg", "as its images are compressed")):
        with BagReader(tmp_path / name) as bag, pytest.raises(UsageError, match=told):
            image_streams(BagChoice(encodings={"": "rgb8"}), [bag], captures.RIG, "")


@pytest.mark.parametrize("kind", [FFMPEG, "foxglove_msgs/msg/CompressedVideo"])
def test_videos_are_named_with_the_remedy(tmp_path, kind, capsys):
    topics = [Channel(f"/cam{k}/image_raw/ffmpeg", kind=kind, definition="uint8[] data") for k in range(3)]
    path = write_mcap(tmp_path / "x.mcap", topics, [(k, k, bytes(8)) for k in range(3)])
    write_rig(tmp_path / "rig.json", captures.RIG)
    given = ["run", "--bag", str(path), "--rig", str(tmp_path / "rig.json"), "--out", str(tmp_path / "out")]
    for more in ([], ["--topic", "cam0=/cam0/image_raw/ffmpeg"]):
        assert main([*given, *more]) == 2
        line = capsys.readouterr().err
        assert "/cam0/image_raw/ffmpeg is compressed video" in line and "image_transport republish" in line
        assert kind.split("/")[-1] in line and "so are 2 more topics" in line and "--topic" not in line
    with BagReader(path) as bag:
        assert "camera cam1 is left out: /cam1/image_raw/ffmpeg is comp" in absent_told("cam1", [bag])
        assert absent_told("cam3", [bag]) == "camera cam3 of the rig is not in the bag"


def test_one_encoding_alone_is_that_of_all_cameras(capsys):
    given = ["run", "--bag", "b", "--out", "o"]
    assert main([*given, "--encoding", "yuyv", "--encoding", "rgb8"]) == 2
    assert "--encoding gives yuyv and rgb8" in capsys.readouterr().err
    assert main(["run", "folder", "--out", "o", "--encoding", "yuyv"]) == 2
    assert "only with --bag" in capsys.readouterr().err
