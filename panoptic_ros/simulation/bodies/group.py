"""Simulated capture of several people, some of whom are solved for.

The detections have the errors of real detectors: people hide each other, joints are assigned to the wrong
person, and some detections are false.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import Camera, Rig, SkeletonModel, ViewDetections
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState, ImuSeries, Subject
from panoptic_ros.simulation.bodies.cameras import detect_joints
from panoptic_ros.simulation.bodies.capture import (
    FIRST_NS,
    BodyCapture,
    BodyScene,
    detected_body,
    moving_body,
    ring,
    simulate_body,
    states_of,
    trunk_of,
    wear,
)
from panoptic_ros.simulation.bodies.motion import BodyMotion, Clip

Array = np.ndarray
FIRST_STRANGER = 100  # first id of people who are not designated
LOST = 0.03  # share of 2D poses that the detector misses completely
# false 2D poses: rate per view and instant, mean score, share of visible joints
GHOSTS, GHOST_SCORE, GHOST_JOINTS = 0.1, 0.4, 0.6
# px; distance below which two people's joints may be swapped, and the probability of a swap
NEAR_PX, MIXED = 40.0, 0.1


@dataclass(frozen=True, eq=False)
class BodyGroup:
    """Simulated capture of several people with its ground truth.

    Args:
        views: Detections by camera, then instant, in random order: points (P, K, 2) px, NaN = missing, and
            scores (P, K).
        devices: IMU samples by device.
        subjects: Designated people.
        truth: True bodies of the designated people.
        strangers: True bodies of all other people.
    """

    rig: Rig
    joint_names: tuple[str, ...]
    stamps: Array
    views: list[list[tuple[Array, Array]]]
    devices: dict[str, ImuSeries]
    subjects: tuple[Subject, ...]
    truth: list[BodyState]
    strangers: list[BodyState]

    def detections(self, instant: int, skeleton: SkeletonModel) -> list[ViewDetections]:
        """Return the detections of all cameras at an instant, in the joints of `skeleton`.

        The detector must have all joints of the skeleton.
        """
        columns = [self.joint_names.index(name) for name in skeleton.joint_names]
        found = []
        for camera, seen in zip(self.rig.cameras, self.views):
            points, scores = (part[:, columns] for part in seen[instant])
            points = np.where(scores[..., None] > 0.0, points, np.nan)
            found.append(
                ViewDetections(
                    camera.name,
                    int(self.stamps[instant]),
                    instant,
                    camera.image_size,
                    skeleton.hash,
                    points,
                    scores,
                    scores.mean(1),
                )
            )
        return found


def simulate_group(scene: BodyScene, seed: int, model: SegmentModel, clips: Mapping[str, Clip]) -> BodyGroup:
    """Simulate all people of a scene; the same scene and seed always give the same group."""
    if not scene.others:
        return group_of(simulate_body(scene, seed, model, clips))
    rng = np.random.default_rng([seed, 31])
    rig = ring(rng, scene.cameras, scene.focal)
    people, detector = (scene, *scene.others), dict[str, Array]()
    moving = [moving_body(rng, person, model, clips) for person in people]
    length = min(len(motion.times) for _, motion in moving)
    motions = [BodyMotion(*(part[:length] for part in vars(motion).values())) for _, motion in moving]
    trunks = np.array([trunk_of(model, motion) for motion in motions])
    seen, devices, subjects, truth, strangers = [], dict[str, ImuSeries](), [], [], []
    stamps = FIRST_NS + np.round(motions[0].times * 1e9).astype(np.int64)
    for k, (person, (body, _), motion) in enumerate(zip(people, moving, motions)):
        known, points = detected_body(rng, body, motion, detector)
        names = tuple(known.keypoints)
        seen.append(detect_joints(rng, rig, points, trunks, names, scene.joints, scene.rate))
        number = k if person.designated else FIRST_STRANGER + k
        states = states_of(number, stamps, motion)
        if not person.designated:
            strangers += states
            continue
        worn = wear(rng, person, model, motion, 1 + len(devices))
        devices |= worn.samples
        truth += states
        subjects.append(
            Subject(
                number,
                known,
                worn.devices,
                worn.t_pose,
                motion.roots[0].round(2),
                heading_known=not person.heading,
                stature=clips[person.clips[0]].stature,
            )
        )
    views = [
        _views(rng, camera, np.array([p[c] for p, _ in seen]), np.array([s[c] for _, s in seen]))
        for c, camera in enumerate(rig.cameras)
    ]
    return BodyGroup(rig, names, stamps, views, devices, tuple(subjects), truth, strangers)


def group_of(capture: BodyCapture) -> BodyGroup:
    """Return the capture of one person as a group."""
    views = [
        [(capture.pixels[c, t][None], capture.scores[c, t][None]) for t in range(len(capture.stamps))]
        for c in range(len(capture.pixels))
    ]
    return BodyGroup(
        capture.rig,
        capture.joint_names,
        capture.stamps,
        views,
        capture.devices,
        (capture.subject,),
        capture.truth(),
        [],
    )


def _views(
    rng: np.random.Generator, camera: Camera, pixels: Array, scores: Array
) -> list[tuple[Array, Array]]:
    """Return the detections of one camera, instant by instant.

    Args:
        pixels: Joints of people (P, T, K, 2) px.
        scores: Their scores (P, T, K).
    """
    found = []
    for t in range(pixels.shape[1]):
        points, told = pixels[:, t].copy(), scores[:, t].copy()
        _mix(rng, points, told)
        there = (told > 0.0).sum(1) >= 3
        there &= rng.random(len(points)) >= LOST
        points, told = points[there], told[there]
        if rng.random() < GHOSTS and len(points):
            ghost = _ghost(rng, camera, points[0], told[0])
            points, told = np.concatenate([points, ghost[0][None]]), np.concatenate([told, ghost[1][None]])
        order = rng.permutation(len(points))
        found.append((points[order], told[order]))
    return found


def _mix(rng: np.random.Generator, points: Array, scores: Array) -> None:
    """Swap some joints of two people who are close to each other in the image, in place."""
    for p in range(len(points)):
        for q in range(p):
            near = np.linalg.norm(points[p] - points[q], axis=-1) < NEAR_PX  # False where a joint is missing
            wrong = np.flatnonzero(near & (rng.random(len(near)) < MIXED))
            for values in (points, scores):
                values[p, wrong], values[q, wrong] = values[q, wrong], values[p, wrong].copy()


def _ghost(rng: np.random.Generator, camera: Camera, points: Array, scores: Array) -> tuple[Array, Array]:
    """Return a false detection with the shape of a real one: points (K, 2) px and scores (K,).

    It lies at a random place in the image.
    """
    middle = np.nanmean(points, axis=0)
    place = rng.uniform((0.0, 0.0), np.array(camera.image_size, float))
    shape = place + rng.uniform(0.5, 1.2) * (points - middle)
    there = (scores > 0.0) & (rng.random(len(points)) < GHOST_JOINTS) & camera.contains(shape)
    told = np.clip(GHOST_SCORE + 0.1 * rng.normal(size=len(points)), 0.05, 1.0)
    return np.where(there[:, None], shape, np.nan), np.where(there, told, 0.0)
