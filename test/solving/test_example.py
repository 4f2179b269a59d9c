import numpy as np

from panoptic_ros.io.skeletons import load_skeleton
from panoptic_ros.solving.example import easy_associations

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
