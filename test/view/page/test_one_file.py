"""A recording in one file: all of it, or a part, and nothing that is too much."""

import base64
import gzip
import json
import re

import numpy as np
import pytest
from recorded_scene import START_NS

from panoptic_ros.errors import UsageError
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.messages.family import decode_cdr
from panoptic_ros.view.page.one_file import one_file
from panoptic_ros.view.page.packets import HEAD, MESSAGE
from panoptic_ros.view.page.recorded import RecordedScene


@pytest.fixture
def scene(recording):
    found = RecordedScene(recording, "test")
    found.scan(lambda: False, lambda: None)
    return found


def data_of(html):
    (text,) = re.findall(r'id="data">(.*?)</script>', html.decode(), re.DOTALL)
    return json.loads(text)


def messages_of(block, topics):
    packet = gzip.decompress(base64.b64decode(block))
    count, at = HEAD.unpack_from(packet)[3], HEAD.size
    for _ in range(count):
        topic, length, _ = MESSAGE.unpack_from(packet, at)
        key, owner, kind = topics[topic]
        yield key, owner, decode_cdr(packet[at + MESSAGE.size : at + MESSAGE.size + length], kind)
        at += MESSAGE.size + length + -(MESSAGE.size + length) % 8


def test_it_holds_every_instant_and_image_and_the_2d_people_of_these(scene):
    data = data_of(one_file(scene))
    assert len(data["blocks"]) == 4 and data["presence"]["spans"][0][0] == 2
    found = [item for block in data["blocks"] for item in messages_of(block, data["facts"]["topics"])]
    count = {key: sum(item[0] == key for item in found) for key in ("skeletons", "preview", "detections")}
    assert count == {"skeletons": 120, "preview": 160, "detections": 160}
    poses = [from_message(message, "RefinedPoseSet") for key, _, message in found if key == "skeletons"]
    assert poses[40].sources is not None and poses[40].ids.tolist() == [2, 7]
    assert np.allclose(list(data["facts"]["rates"].values()), 30.0, rtol=0.02)


def test_a_part_begins_at_its_own_zero(scene):
    data = data_of(one_file(scene, 1.5, 3.0))
    assert len(data["blocks"]) == 2
    assert data["facts"]["begin_ns"] == str(START_NS + 10**9)
    assert data["presence"]["spans"] == [[2, 0.0, pytest.approx(1.9667, abs=1e-3)], [7, 0.0, 2.0]]


def test_too_much_and_nothing_are_told(scene, monkeypatch):
    with pytest.raises(UsageError, match="no data from 9 s"):
        one_file(scene, 9.0)
    monkeypatch.setattr("panoptic_ros.view.page.one_file.LONGEST_S", 3)
    with pytest.raises(UsageError, match="4 s are too much for one file.*--from and --to"):
        one_file(scene)
