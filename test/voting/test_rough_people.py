import numpy as np

from panoptic_ros.association.config import AssociationConfig
from panoptic_ros.association.stage import AssociationStage
from panoptic_ros.domain import Camera, DetectionSet, Rig, TrackSet, ViewDetections
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.skeletons import load_skeleton
from panoptic_ros.solving.evidence import RigArrays
from panoptic_ros.solving.example import easy_associations
from panoptic_ros.stage import StageContext
from panoptic_ros.voting.explaining import rough_people

SKELETON = load_skeleton("panoptic19")
SECOND = 10**9


def ring(count):
    cameras = []
    for k in range(count):
        angle = 2.0 * np.pi * k / count
        centre = np.array([4.0 * np.cos(angle), 4.0 * np.sin(angle), 1.5 + 0.3 * (k % 3)])
        forward = np.array([0.0, 0.0, 1.0]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        matrix = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])
        lens = Intrinsics(matrix, np.array([-0.1, 0.02, 0.0, 0.0, 0.0]))
        cameras.append(Camera(f"cam{k}", (640, 480), lens, Rigid(rotation, -rotation @ centre)))
    return Rig(tuple(cameras))


def seen(rig, people, stamp_ns=0, delays=None, velocity=(0.0, 0.0, 0.0)):
    views = []
    for k, camera in enumerate(rig.cameras):
        delay = 0 if delays is None else delays[k]
        points = np.stack([camera.project(p + 1e-9 * delay * np.array(velocity))[0] for p in people])
        scores = np.full(points.shape[:2], 0.9)
        views.append(
            ViewDetections(
                camera.name, stamp_ns + delay, 0, camera.image_size, SKELETON.hash, points, scores,
                scores[:, 0],
            )
        )
    return DetectionSet(0, stamp_ns, SKELETON.hash, tuple(views))


def person(seed, x=0.0, y=0.0):
    return np.random.default_rng(seed).uniform(-0.5, 0.5, (19, 3)) + (x, y, 1.0)


def worst(found, people):
    gaps = np.linalg.norm(found[:, None] - np.stack(people)[None], axis=-1).max(-1)
    return gaps.min(axis=0).max()


def rough(rig, item):
    """Joints of the people of one instant."""
    (found,) = AssociationStage(AssociationConfig(), StageContext(rig, SKELETON)).step(item).outputs
    return rough_people(found, RigArrays.of(rig), SKELETON)


def test_finds_the_joints_of_associated_people():
    rig, people = ring(5), [person(0, 0.7), person(1, -0.7)]
    positions, velocities = rough(rig, seen(rig, people))
    assert positions.shape == (2, 19, 3)
    assert worst(positions, people) < 1e-6
    assert not velocities.any()


def test_views_of_their_own_instants_are_moved_by_the_predicted_velocity():
    rig, start, velocity = ring(5), person(0), np.array([1.0, 0.5, 0.0])
    delays = [0, 10_000_000, -10_000_000, 15_000_000, -5_000_000]
    stage = AssociationStage(AssociationConfig(), StageContext(rig, SKELETON))
    numbers = np.zeros((1, 19))
    states = np.concatenate([start, np.tile(velocity, (19, 1))], axis=-1)[None]
    known = (states, np.full((1, 19, 3), 1e-4), numbers, numbers)
    stage.step(TrackSet(0, SECOND, SKELETON.hash, np.zeros(1), *known, np.zeros(1)))
    item = seen(rig, [start + 0.033 * velocity], SECOND + 33_000_000, delays, velocity)
    (associated,) = stage.step(item).outputs
    positions, _ = rough_people(associated, RigArrays.of(rig), SKELETON)
    assert worst(positions, [start + 0.033 * velocity]) < 1e-6


def test_the_easy_associations_are_easy():
    rig = ring(6)
    for number, item in enumerate(easy_associations(rig, SKELETON)):
        assert len(item.detections.views) == 4
        assert item.who.tolist() == [number - 1]
        found, _ = rough_people(item, RigArrays.of(rig), SKELETON)
        assert np.abs(found - item.places).max() < 1e-6
