"""A capture folder is shown as it is read, with the truth where it is known; a bag may have it, too."""

import asyncio
import threading
import time

import cv2
import numpy as np
import pytest
from recorded_scene import BODY, SKELETON, START_NS, make_rig
from websockets.asyncio.client import connect

from panoptic_ros.capture import open_capture_folder
from panoptic_ros.errors import DataError
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.messages.family import decode_cdr
from panoptic_ros.io.plain_formats import PlainSkeletonFrame, PlainSkeletons
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.view.page.folder import FolderScene
from panoptic_ros.view.page.recorded import RecordedScene
from panoptic_ros.view.page.recorded_talk import RecordedTalk
from panoptic_ros.view.page.server import PageServer
from panoptic_ros.view.page.truth import KEY, TruthSkeletons


def plain(start_ns, count=60):
    """One person of id 5 who lacks the right ankle, in joints of another order."""
    names = ("elsewhere", *SKELETON.joint_names[:5][::-1])
    positions = np.concatenate([np.zeros((1, 3)), BODY[:5][::-1]])[None]
    frames = [
        PlainSkeletonFrame(
            k,
            start_ns + round(k * 1e9 / 30),
            np.array([5]),
            positions + [k, 0, 0],
            np.ones((1, 6)),
            np.full((1, 6, 3, 3), np.nan),
            np.zeros(1, bool),
            np.full((1, 6), -1),
        )
        for k in range(count)
    ]
    return PlainSkeletons(names, tuple(frames))


@pytest.fixture
def folder(tmp_path):
    rig = make_rig(2)
    write_rig(tmp_path / "rig.json", rig)
    for camera in rig.names:
        (tmp_path / camera).mkdir()
        for k in range(60):
            cv2.imwrite(str(tmp_path / camera / f"{k:04d}.png"), np.full((480, 640, 3), 4 * k, np.uint8))
    return tmp_path


def scene_of(folder, truth=None):
    return FolderScene(open_capture_folder(folder), "test", SKELETON, truth)


def decoded(scene, messages):
    topics = scene.facts()["topics"]
    for topic, data in messages:
        key, owner, kind = topics[topic]
        yield key, owner, decode_cdr(data, kind)


def test_truth_is_handed_out_by_stamp_in_the_joints_of_the_scene():
    truth = TruthSkeletons(plain(START_NS), SKELETON)
    found = list(truth.between(START_NS + 10**9, START_NS + 2 * 10**9))
    assert len(found) == 30
    poses = from_message(decode_cdr(found[0], "panoptic_msgs/msg/Skeletons"), "RefinedPoseSet")
    assert poses.ids.tolist() == [5] and poses.index == 30
    assert np.allclose(poses.positions[0, :5], BODY[:5] + [30, 0, 0])
    assert np.isnan(poses.positions[0, 5]).all()


def test_a_bag_with_truth_has_its_messages_for_who_wants_them(recording):
    scene = RecordedScene(recording, "test", truth=plain(START_NS))
    without = list(decoded(scene, scene.messages(1)))
    found = list(decoded(scene, scene.messages(1, [KEY])))
    assert len(found) == len(without) + 30
    assert {key for key, _, _ in found} - {key for key, _, _ in without} == {KEY}


def test_a_folder_is_read_while_pages_wait(folder):
    scene = scene_of(folder, TruthSkeletons(plain(0), SKELETON))
    assert scene.block_count >= 2 and scene.facts()["rates"] == {"cam0": 30.0, "cam1": 30.0}
    reading = threading.Timer(0.2, scene.scan, (lambda: False, lambda: None))
    reading.start()
    for number in range(2):
        while not scene.has(number):
            time.sleep(0.01)
        found = list(decoded(scene, scene.messages(number, [KEY])))
        previews = [from_message(message, "Preview") for key, _, message in found if key == "preview"]
        assert sorted({preview.camera for preview in previews}) == ["cam0", "cam1"]
        assert len(previews) == 20 and len(found) == 50
        assert {preview.stamp_ns // 10**9 for preview in previews} == {number}
    reading.join()
    assert scene.presence.complete and [span[0] for span in scene.presence.spans] == [5]
    scene.close()


def test_an_image_that_cannot_be_read_is_told_to_who_waits(folder):
    scene = scene_of(folder)
    (folder / "cam1" / "0040.png").write_bytes(b"no image")
    scene.scan(lambda: False, lambda: None)
    assert len(list(scene.messages(0))) == 20
    with pytest.raises(DataError, match="0040.png"):
        list(scene.messages(1))
    scene.close()


def test_previews_that_are_kept_have_a_bound(folder):
    scene = FolderScene(open_capture_folder(folder), "test", SKELETON, most=30_000)
    scene.scan(lambda: False, lambda: None)
    assert scene.has(1) and not scene.presence.complete
    with pytest.raises(DataError, match=r"previews of \d s fill the 3e-05 GB .* `panoptic run`"):
        list(scene.messages(1))
    scene.close()


def test_pages_that_wait_take_no_threads_and_do_not_delay_the_end(folder):
    scene = scene_of(folder)

    async def check():
        async with PageServer(RecordedTalk(scene)).listening() as address:
            pages = [await connect(address.replace("http", "ws").replace("/?", "/data?")) for _ in range(40)]
            for page in pages:
                await page.send('{"block": 0}')
            await asyncio.sleep(0.2)
            assert await asyncio.wait_for(asyncio.to_thread(lambda: 5), 5) == 5

    begun = time.monotonic()
    asyncio.run(check())
    assert time.monotonic() - begun < 30.0
    scene.close()
