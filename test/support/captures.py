"""A small exact capture for the contract suite: two people who move, four cameras round them."""

import numpy as np

from panoptic_ros.domain import Camera, Rig, ViewDetections
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.skeletons import load_skeleton
from panoptic_ros.stage import StageContext

SKELETON = load_skeleton("panoptic19")
HEIGHTS = {  # m: (forward, left, up) of a standing person's joints
    "Neck": (0, 0, 1.45),
    "Nose": (0.1, 0, 1.6),
    "BodyCenter": (0, 0, 0.95),
    "lShoulder": (0, 0.18, 1.43),
    "lElbow": (0.02, 0.25, 1.15),
    "lWrist": (0.1, 0.25, 0.92),
    "lHip": (0, 0.1, 0.94),
    "lKnee": (0.03, 0.11, 0.5),
    "lAnkle": (0, 0.11, 0.09),
    "lEye": (0.09, 0.03, 1.64),
    "lEar": (0, 0.07, 1.62),
}


def look_at(name, eye, target=(0.0, 0.0, 1.0), focal=800.0, size=(1280, 720)):
    z = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
    x = np.cross(z, [0, 0, 1.0]) / np.linalg.norm(np.cross(z, [0, 0, 1.0]))
    rotation = np.stack([x, np.cross(z, x), z])
    matrix = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]])
    distortion = [0.02, -0.01, 1e-4, -1e-4, 0.0]
    return Camera(name, size, Intrinsics(matrix, distortion), Rigid(rotation, -rotation @ np.array(eye)))


RIG = Rig(
    tuple(
        look_at(f"cam{k}", (4.2 * np.cos(a), 4.2 * np.sin(a), 1.8 + 0.2 * k))
        for k, a in enumerate(np.arange(4) * np.pi / 2 + 0.3)
    )
)
CONTEXT = StageContext(RIG, SKELETON)


def person(centre, yaw):
    points = []
    for name in SKELETON.joint_names:
        forward, left, up = HEIGHTS.get(name) or np.array(HEIGHTS["l" + name[1:]]) * [1, -1, 1]
        c, s = np.cos(yaw), np.sin(yaw)
        points.append([centre[0] + c * forward - s * left, centre[1] + s * forward + c * left, up])
    return np.array(points)


def people(time_s):
    """(2, 19, 3) m."""
    walker = person((0.8 * np.cos(time_s), 0.8 * np.sin(time_s)), time_s + np.pi / 2)
    return np.stack([walker, person((-0.9, -0.6), 0.4)])


def view(camera, index, stamp_ns, noise=0.5):
    rng = np.random.default_rng([index, RIG.index(camera.name)])
    pixels, seen = camera.project(people(stamp_ns * 1e-9))
    pixels = pixels + noise * rng.standard_normal(pixels.shape)
    inside = seen & camera.contains(pixels)
    scores = np.where(inside, 0.9, 0.0)
    points = np.where(inside[..., None], pixels, np.nan)
    return ViewDetections(
        camera.name, stamp_ns, index, camera.image_size, SKELETON.hash, points, scores, scores.max(1)
    )


def views(frames=12, rate=30):
    """Views of all cameras, instant by instant."""
    return [view(camera, i, round(i * 1e9 / rate)) for i in range(frames) for camera in RIG.cameras]
