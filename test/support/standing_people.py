"""Scenes with exact truth: standing people, a ring of cameras, 2D joints with chosen faults."""

import numpy as np
import pytest
from fed_stages import unassociated

from panoptic_ros.domain import Camera, DetectionSet, ProposalSet, Rig, ViewDetections
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.skeletons import load_skeleton
from panoptic_ros.stage import StageContext

SKELETON = load_skeleton("panoptic19")
SHAPE = {  # m, facing +x, left is +y
    "Neck": (0, 0, 1.45),
    "Nose": (0.12, 0, 1.6),
    "BodyCenter": (0, 0, 0.95),
    "Shoulder": (0, 0.18, 1.42),
    "Elbow": (0.02, 0.24, 1.15),
    "Wrist": (0.15, 0.26, 0.95),
    "Hip": (0, 0.1, 0.93),
    "Knee": (0.03, 0.11, 0.5),
    "Ankle": (0, 0.11, 0.08),
    "Eye": (0.1, 0.035, 1.64),
    "Ear": (0.02, 0.075, 1.62),
}


def person(x=0.0, y=0.0, turn=0.0):
    """Joints (19, 3) m of somebody standing at x, y, turned by `turn` rad."""
    rows = []
    for name in SKELETON.joint_names:
        side = 1.0 if name[0] == "l" else -1.0
        a, b, c = SHAPE[name if name in SHAPE else name[1:]]
        rows.append((a, side * b if name not in SHAPE else b, c))
    c, s = np.cos(turn), np.sin(turn)
    return np.array(rows) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [x, y, 0.0]


def ring(count, radius=4.0, distortion=(0, 0, 0, 0, 0)):
    """A rig of cameras that look at the middle."""
    cameras = []
    for i in range(count):
        angle = 2 * np.pi * i / count + 0.3
        centre = np.array([radius * np.cos(angle), radius * np.sin(angle), 2.2])
        forward = np.array([0, 0, 1.0]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        k = [[1000.0, 0, 639.5], [0, 1000.0, 479.5], [0, 0, 1]]
        pose = Rigid(rotation, -rotation @ centre)
        cameras.append(Camera(f"cam{i}", (1280, 960), Intrinsics(k, distortion), pose))
    return Rig(tuple(cameras))


def proposals(rig, people, index=0, noise=0.0, seed=0, change=None, skeleton=SKELETON, rate=30.0):
    """A set of what all cameras see; change(camera index, points, scores) edits a view in place."""
    rng = np.random.default_rng([seed, index])
    people = np.asarray(people, float).reshape(-1, len(skeleton), 3)
    views = []
    stamp = 1_000_000_000 + round(index * 1e9 / rate)
    for i, camera in enumerate(rig.cameras):
        points = camera.project(people)[0] + noise * rng.standard_normal((*people.shape[:2], 2))
        scores = np.full(people.shape[:2], 0.8)
        if change is not None:
            change(i, points, scores)
        scores[np.isnan(points[..., 0])] = 0.0
        views.append(
            ViewDetections(
                camera.name,
                stamp,
                index,
                camera.image_size,
                skeleton.hash,
                points,
                scores,
                scores.mean(axis=1),
            )
        )
    detections = DetectionSet(index, stamp, skeleton.hash, tuple(views))
    return ProposalSet.of_nothing(unassociated(detections, len(skeleton)))


def context(rig, skeleton=SKELETON):
    """What a stage may know."""
    return StageContext(rig, skeleton)


class Scenes:
    """The builders, for tests."""

    skeleton = SKELETON
    person = staticmethod(person)
    ring = staticmethod(ring)
    proposals = staticmethod(proposals)
    context = staticmethod(context)


@pytest.fixture(scope="session")
def scenes():
    return Scenes
