"""A body of the installed skeleton, poses of it, and where they put its segments."""

import numpy as np

from panoptic_ros.geometry.chain import Pose, place_segments, step_pose
from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.kinematics.pose.targets import NO_HINGES, PosePrior

MODEL = read_body_model()
BODY = MODEL.body(1.75)
CHAIN = BODY.chain
S, D = len(MODEL.names), MODEL.freedoms


def some_pose(seed=0, spread=0.4):
    rng = np.random.default_rng(seed)
    return Pose(rng.normal([0, 0, 1], 0.2, 3), rotations_of(spread * rng.normal(size=(S, 3))))


def placed(pose):
    frames, places = np.empty((S, 3, 3)), np.empty((S, 3))
    place_segments(CHAIN, pose, frames, places)
    return frames, places


def moved(pose, step):
    out = pose.copy()
    step_pose(pose, step, out)
    return out


def cameras(count=4):
    """Rotations and translations of cameras on a ring."""
    rotations, translations = [], []
    for k in range(count):
        angle = 2 * np.pi * k / count
        centre = np.array([4 * np.cos(angle), 4 * np.sin(angle), 2.0])
        forward = np.array([0, 0, 1.0]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        rotations.append(rotation)
        translations.append(-rotation @ centre)
    return np.array(rotations), np.array(translations)


def no_prior(segments):
    """No cost."""
    n = 3 * segments - 3
    far = np.full(n, 10.0)
    nothing = np.zeros((n, n))
    return PosePrior(np.zeros(n), nothing, nothing, -far, far, 0.0, 0.0, 0.0, 0.0, 0.0, NO_HINGES)
