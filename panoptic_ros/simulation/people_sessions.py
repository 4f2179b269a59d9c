"""Simulated recordings of people, with clocks that are off and a detector with biases."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Rig, ViewDetections
from panoptic_ros.simulation.degradation import NOISY, Degradation
from panoptic_ros.simulation.detector import SimulatedDetector
from panoptic_ros.simulation.people import SimulatedPerson, draw_group
from panoptic_ros.simulation.rigs import RigPlan
from panoptic_ros.simulation.skeleton import JOINTS, SKELETON

Array = np.ndarray
START_NS = 1_800_000_000_000_000_000  # first stamp


@dataclass(frozen=True)
class PeopleScene:
    """Scene of a recording.

    Args:
        rig: Cameras.
        activities: One per person, see `people.ACTIVITIES`.
        seconds: Duration, s.
        degradation: Faults of the detector.
        bias_m: Standard deviation, m per image axis, of constant errors of each joint, person and camera.
        lag_s: Largest offset, s, of a camera's images; their stamps do not show it.
        rate_hz: Rate, Hz, of all cameras.
        area_m: Radius, m, of the space that people use.
    """

    rig: RigPlan
    activities: tuple[str, ...] = ("walk", "walk")
    seconds: float = 5.0
    degradation: Degradation = NOISY
    bias_m: float = 0.0
    lag_s: float = 0.0
    rate_hz: float = 30.0
    area_m: float = 2.3


class TrueJoints(NamedTuple):
    """Detected joints with their truth: camera, frame, person, joint (N,), and pixels (N, 2)."""

    camera: Array
    frame: Array
    person: Array
    joint: Array
    pixels: Array


class PeopleSession(NamedTuple):
    """Simulated recording.

    Args:
        rig: True cameras.
        people: True people.
        views: 2D poses of all views. Frame k has the stamp k / rate.
        offsets: (C,) s, true offsets: images are taken at their stamp plus the offset.
        times: (K,) s, stamps of the frames since the first.
        joints: Joints of true people in all views.
    """

    rig: Rig
    people: tuple[SimulatedPerson, ...]
    views: tuple[ViewDetections, ...]
    offsets: Array
    times: Array
    joints: TrueJoints


def simulate_people(scene: PeopleScene, seed: int) -> PeopleSession:
    """Return the recording of a scene; the same scene and seed always give the same one."""
    rng = np.random.default_rng([seed, len(scene.activities)])
    rig = scene.rig.build(rng)
    people = tuple(draw_group(rng, scene.activities, scene.area_m))
    offsets = rng.uniform(-scene.lag_s, scene.lag_s, len(rig))
    bias = scene.bias_m * rng.standard_normal((len(rig), len(people), len(JOINTS), 2))
    detector = SimulatedDetector((seed, len(rig), 1), scene.degradation, rig, people)
    times = np.arange(round(scene.seconds * scene.rate_hz)) / scene.rate_hz
    views: list[ViewDetections] = []
    known: list[Array] = []
    for frame, time in enumerate(times):
        for c, seen in enumerate(detector.detect(frame, time + offsets)):
            camera = rig.cameras[c]
            person, joint = seen.sources[..., 0], seen.sources[..., 1]
            true = person >= 0
            where = np.stack([one.joints(np.array([time + offsets[c]]))[0] for one in people])
            depth = camera.cam_from_world.apply(where)[..., 2]
            focal = np.diag(camera.intrinsics.matrix)[:2]
            shift = focal * bias[c] / depth[..., None]
            points = seen.points + np.where(true[..., None], shift[person, joint], 0.0)
            views.append(
                ViewDetections(
                    camera.name,
                    START_NS + round(1e9 * time),
                    frame,
                    camera.image_size,
                    SKELETON.hash,
                    points,
                    seen.scores,
                    seen.scores.sum(1) / np.maximum((seen.scores > 0.0).sum(1), 1),
                )
            )
            count = int(true.sum())
            known.append(
                np.column_stack(
                    [np.full(count, c), np.full(count, frame), person[true], joint[true], points[true]]
                )
            )
    table = np.concatenate(known)
    camera_row, frame_row, person_row, joint_row = table[:, :4].astype(np.int64).T
    joints = TrueJoints(camera_row, frame_row, person_row, joint_row, table[:, 4:])
    return PeopleSession(rig, people, tuple(views), offsets, times, joints)
