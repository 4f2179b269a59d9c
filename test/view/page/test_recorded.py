"""A bag is handed out second by second, whole and unchanged."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_scene import SKELETON, START_NS, make_rig, write_scene

from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bags import BagReader, BagWriter
from panoptic_ros.io.messages import bag_messages, compressed_image_message, from_message, to_message
from panoptic_ros.io.messages.family import decode_cdr
from panoptic_ros.view.page import recorded
from panoptic_ros.view.page.recorded import RecordedScene


def all_messages(scene, keys=()):
    return [message for number in range(scene.block_count) for message in scene.messages(number, keys)]


def test_every_message_is_in_one_block(recording):
    scene = RecordedScene(recording, "test")
    topics = scene.facts()["topics"]
    found = sorted((tuple(topics[topic][:2]), data) for topic, data in all_messages(scene))
    with BagReader(recording) as bag:
        raw = [(name, bytes(data)) for name, _, data, _ in bag.raw()]
    assert len(found) == len(raw) - 2  # but the rig and the skeleton
    assert sorted(data for _, data in found) == sorted(
        data for name, data in raw if name.count("/") > 1 or name == "/skeletons"
    )
    assert scene.block_count == 4


def test_facts_are_json_with_everything_that_a_page_needs(recording):
    facts = json.loads(json.dumps(RecordedScene(recording, "a title").facts(), allow_nan=False))
    rig = make_rig()
    assert [camera["name"] for camera in facts["cameras"]] == list(rig.names)
    assert facts["cameras"][3]["lens"] == "fisheye" and facts["title"] == "a title"
    assert np.allclose(facts["cameras"][0]["centre"], rig.cameras[0].centre)
    assert facts["skeleton"]["joints"] == list(SKELETON.joint_names)
    assert facts["begin_ns"] == str(START_NS)
    inner = {kind for fields in facts["schemas"].values() for _, kind, _ in fields if "/" in kind}
    assert inner <= set(facts["schemas"])


def test_presence_tells_where_ids_begin_and_end(recording):
    scene, told = RecordedScene(recording, "test"), []
    scene.scan(lambda: False, lambda: told.append(scene.presence.complete))
    assert told == [True]
    spans = [[span[0], *np.round(span[1:], 3)] for span in scene.presence.spans]
    assert spans == [[2, 0, 2.967], [7, 1, 3.967]]


def test_scanning_ends_when_asked_to(recording):
    scene = RecordedScene(recording, "test")
    scene.scan(lambda: True, lambda: None)
    assert not scene.presence.complete


def test_previews_are_made_of_images_where_there_are_none(tmp_path):
    rig, family = make_rig(2), bag_messages()
    with BagWriter(tmp_path / "bag") as bag:
        bag.write("/lab/rig", START_NS, to_message(rig, family))
        bag.write("/lab/skeleton_model", START_NS, to_message(SKELETON, family))
        for index in range(30):
            stamp = START_NS + index * 33_333_333
            image = np.full((480, 640, 3), 8 * index, np.uint8)
            message = compressed_image_message(ViewFrame("cam1", stamp, index, image), family, 90)
            bag.write("/lab/cam1/image_raw/compressed", stamp, message)
    scene = RecordedScene(tmp_path / "bag", "test")
    messages = all_messages(scene)
    previews = [from_message(decode_cdr(data, TOPICS["preview"].message), "Preview") for _, data in messages]
    assert {preview.camera for preview in previews} == {"cam1"}
    assert len(previews) == 10 and len({preview.stamp_ns // 10**8 for preview in previews}) == 10


def test_a_bag_without_a_rig_is_told(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        bag.write("/skeleton_model", 1, to_message(SKELETON, bag_messages()))
    with pytest.raises(DataError, match="lacks /rig: give --rig"):
        RecordedScene(tmp_path / "bag", "test")
    assert RecordedScene(tmp_path / "bag", "test", rig=make_rig()).rig.names == make_rig().names


def test_blocks_of_nowhere_are_empty(recording):
    scene = RecordedScene(recording, "test")
    assert list(scene.messages(99)) == [] and list(scene.messages(-5)) == []


def test_write_scene_without_images(tmp_path):
    write_scene(tmp_path / "bag", 5, previews=False)
    scene = RecordedScene(tmp_path / "bag", "test")
    assert {key for key, _, _ in scene.facts()["topics"]} == {"skeletons", "detections"}


def test_the_scan_waits_while_a_second_is_drawn(recording, monkeypatch):
    now = [100.0]
    clock = SimpleNamespace(monotonic=lambda: now[0], sleep=lambda s: now.__setitem__(0, now[0] + s))
    monkeypatch.setattr(recorded, "time", clock)
    scene = RecordedScene(recording, "test")
    scene.block(0)
    scene.scan(lambda: False, lambda: None)
    assert now[0] == pytest.approx(100.0 + recorded.QUIET_S, abs=0.01) and scene.presence.complete
