from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.io.skeletons import load_skeleton
from panoptic_ros.solving.example import easy_associations, easy_instants
from panoptic_ros.stage import StageContext

SKELETON = load_skeleton("panoptic19")


def test_the_easy_associations_are_easy(scenes):
    rig = scenes.ring(6)
    cameras = {camera.name: camera for camera in rig.cameras}
    for number, item in enumerate(easy_associations(rig, SKELETON)):
        assert len(item.detections.views) == 4 and item.who.tolist() == [number - 1]
        for slot, person in zip(item.evidence.slots, item.groups.member[0]):
            view = item.detections.views[slot]
            expected, seen = cameras[view.camera].project(item.places[0])
            assert seen.sum() > 10
            points = view.points[item.evidence.rows[person]]
            np.testing.assert_allclose(points[seen], expected[seen], atol=1e-6)


@st.composite
def desk_rigs(draw):
    """Cameras of 20 to 140 degrees, .4 to 1.2 m from the middle that they look at, with any lens."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    cameras = []
    for k in range(draw(st.integers(2, 5))):
        away = rng.normal(size=3)
        away *= draw(st.floats(0.4, 1.2)) / np.linalg.norm(away)
        z = rng.normal(0.0, 0.05, 3) - away
        z /= np.linalg.norm(z)
        x = np.cross(z, rng.normal(size=3))
        x /= np.linalg.norm(x)
        rotation = np.stack([x, np.cross(z, x), z])
        focal = 640.0 / np.tan(np.radians(0.5 * draw(st.floats(20.0, 140.0))))
        matrix = [[focal, 0, rng.uniform(600, 680)], [0, focal, rng.uniform(330, 390)], [0, 0, 1]]
        kind = draw(st.sampled_from(["brown", "rational", "fisheye"]))
        terms = rng.normal(0.0, [0.3, 0.3, 4e-3, 4e-3, 0.2, 0.3, 0.3, 0.3])
        terms = {"brown": terms[:5], "rational": terms, "fisheye": 0.1 * terms[:4]}[kind]
        lens = Intrinsics(matrix, terms, "fisheye" if kind == "fisheye" else "brown")
        cameras.append(Camera(f"cam{k}", (1280, 720), lens, Rigid(rotation, -rotation @ away)))
    return Rig(tuple(cameras))


@settings(max_examples=60, deadline=None)
@given(rig=desk_rigs())
def test_the_example_is_one_that_the_cameras_of_any_rig_could_give(rig):
    for item in easy_instants(rig, SKELETON):
        for view in item.views:
            points = view.points[np.isfinite(view.points).all(-1)]
            assert rig.camera(view.camera).contains(points).all()


@settings(max_examples=12, deadline=None)
@given(rig=desk_rigs())
def test_desk_rigs_start(rig):
    """No stage refuses the people with which it warms up, whatever the rig."""
    context, topics = StageContext(rig, SKELETON), []
    pipeline = Pipeline(
        configure({"offsets": {"active": True}}),
        context,
        (*FUSION, "offsets"),
        on_record=lambda topic, record: topics.append(topic),
    )
    items = list(easy_instants(rig, SKELETON))
    for item in items:
        pipeline.push("detection_sets", item)
    pipeline.flush()
    assert topics.count("skeletons") == len(items)


def test_cameras_on_a_desk_see_the_example(scenes):
    rig = scenes.ring(4)
    small = Rig(
        tuple(
            replace(c, cam_from_world=Rigid(c.cam_from_world.rotation, 0.15 * c.cam_from_world.translation))
            for c in rig.cameras
        )
    )
    for example in (rig, small):
        first = next(easy_instants(example, SKELETON))
        assert all((view.scores[0] > 0.0).sum() > 10 and view.scores[1, -1] > 0.0 for view in first.views)
