"""Live messages are paired by stamp, not by arrival; what pages do not want is not asked for."""

import numpy as np
from recorded_scene import SKELETON, as_bytes, make_patches, make_poses, make_preview, make_rig, make_view

from panoptic_ros.domain import RefinedPoseSet
from panoptic_ros.graph.topics import ALWAYS_SHOWN
from panoptic_ros.view.page.live import PATIENCE_S, LiveScene
from panoptic_ros.view.page.peek import stamp_of_bytes

RIG = make_rig()


class Fed:
    """A scene and one page."""

    def __init__(self):
        self.scene, self.woken, self.now = LiveScene(), 0, 100.0
        self.scene.begin(RIG, SKELETON)
        self.topics = [tuple(topic) for topic in self.scene.facts()["topics"]]
        self.client = self.scene.attach(self._wake)

    def _wake(self):
        self.woken += 1

    def give(self, key, record, owner=""):
        self.scene.take(key, owner, as_bytes(record), self.now, 0)

    def got(self):
        messages = self.scene.collect(self.client)
        if messages is None:
            return None
        self.scene.drawn(self.client)
        return sorted(self.topics[message.topic][:2] for message in messages)


def stamp(index):
    return 10**18 + index * 33_333_333


def test_an_image_waits_for_the_skeletons_of_its_stamp():
    fed, camera = Fed(), RIG.cameras[1]
    fed.give("skeletons", make_poses(RIG, 0, stamp(0)))
    assert fed.got() == [("skeletons", "")]
    poses = make_poses(RIG, 1, stamp(1))
    fed.give("preview", make_preview(camera.name, stamp(1) - 7), camera.name)
    fed.give("detections", make_view(camera, poses, stamp(1) - 7), camera.name)
    later = make_poses(RIG, 2, stamp(2))
    fed.give("detections", make_view(camera, later, stamp(2) - 7), camera.name)
    assert fed.got() is None
    fed.give("skeletons", poses)
    assert fed.got() == [("detections", "cam1"), ("preview", "cam1"), ("skeletons", "")]
    fed.give("skeletons", later)
    assert fed.got() == [("skeletons", "")]


def test_skeletons_that_do_not_name_their_views_are_paired_by_stamp():
    fed = Fed()
    poses = make_poses(RIG, 4, stamp(4))
    names = [name for name in poses.__dataclass_fields__ if name != "sources"]
    alone = RefinedPoseSet(**{name: getattr(poses, name) for name in names})
    for camera, away in ((RIG.cameras[0], 7_000_000), (RIG.cameras[1], 60_000_000)):
        fed.give("preview", make_preview(camera.name, stamp(4) - away), camera.name)
        fed.give("detections", make_view(camera, poses, stamp(4) - away), camera.name)
    fed.got()
    fed.give("skeletons", alone)
    assert fed.got() == [("detections", "cam0"), ("preview", "cam0"), ("skeletons", "")]


def test_images_are_shown_where_nobody_makes_skeletons():
    fed, camera = Fed(), RIG.cameras[0]
    fed.give("skeletons", make_poses(RIG, 0, stamp(0)))
    fed.got()
    fed.now += PATIENCE_S + 0.1
    fed.give("preview", make_preview(camera.name, stamp(50)), camera.name)
    assert fed.got() == [("preview", "cam0")]
    fed.give("detections", make_view(camera, make_poses(RIG, 50, stamp(50)), stamp(50)), camera.name)
    assert fed.got() == [("detections", "cam0"), ("preview", "cam0")]


def test_without_a_page_nothing_is_wanted():
    fed = Fed()
    assert fed.scene.wanted() == frozenset(ALWAYS_SHOWN)
    fed.scene.choose(fed.client, ["proposals", "audio", "no such thing"])
    assert fed.scene.wanted() == frozenset((*ALWAYS_SHOWN, "proposals"))
    fed.scene.detach(fed.client)
    assert fed.scene.wanted() == frozenset()


def test_a_page_behind_gets_the_newest_patches_beside_the_newest_skeletons():
    fed = Fed()
    fed.scene.choose(fed.client, ["patches"])
    assert "patches" in fed.scene.wanted()
    for index in range(5):
        fed.give("patches", make_patches(RIG, index, stamp(index)))
        fed.give("skeletons", make_poses(RIG, index, stamp(index)))
    messages = fed.scene.collect(fed.client)
    assert sorted(fed.topics[message.topic][0] for message in messages) == ["patches", "skeletons"]
    assert {stamp_of_bytes(message.data) for message in messages} == {stamp(4)}


def test_what_cannot_be_read_is_counted():
    fed = Fed()
    fed.scene.take("skeletons", "", b"\0\1\0\0nonsense", 1.0, 0)
    fed.scene.take("preview", "cam0", b"", 1.0, 0)
    fed.scene.take("preview", "cam99", b"of a camera that is not there", 1.0, 0)
    assert fed.got() is None
    assert fed.scene.state(fed.client, 1.0)["page"] == {"dropped": 0, "bad": 2}


def test_health_is_told_by_arrival():
    fed, camera = Fed(), RIG.cameras[0]
    for index in range(60):
        fed.now = 100.0 + index / 30
        fed.give("detections", make_view(camera, make_poses(RIG, index, stamp(index)), stamp(index)), "cam0")
    state = fed.scene.state(fed.client, fed.now + 0.5)
    assert 20 < state["cameras"]["cam0"]["rate_hz"] < 30
    assert np.isclose(state["cameras"]["cam0"]["age_s"], 0.5)
    assert state["cameras"]["cam1"] == {"rate_hz": 0.0, "age_s": None}


def test_latency_counts_only_where_stamps_are_of_the_wall_clock():
    scene = LiveScene()
    scene.begin(RIG, SKELETON)
    client = scene.attach(lambda: None)
    scene.take("skeletons", "", as_bytes(make_poses(RIG, 1, 5 * 10**9)), 1.0, 10**18)
    assert scene.state(client, 1.0)["latency_ms"] is None
    for _ in range(3):
        scene.take("skeletons", "", as_bytes(make_poses(RIG, 1, stamp(1))), 1.0, stamp(1) + 120_000_000)
    assert np.allclose(scene.state(client, 1.0)["latency_ms"], 120.0)
