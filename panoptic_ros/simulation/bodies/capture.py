"""Simulated capture of one body with a ring of cameras, 13 IMUs and a T-pose.

The capture also holds the known subject data and the ground truth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.domain.segments import SegmentedBody, SegmentModel
from panoptic_ros.domain.subjects import BodyState, Device, ImuSeries, Subject, TPose
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.geometry.rotations import turn_about_z
from panoptic_ros.simulation.bodies.cameras import JointNoise, detect_joints
from panoptic_ros.simulation.bodies.imus import ImuNoise, measure, mistaken, random_mount, unknown_heading
from panoptic_ros.simulation.bodies.motion import T_POSE_S, BodyMotion, Clip, laid_out, make_motion, moved

Array = np.ndarray
FIRST_NS = 1_000_000_000
FOCAL, SIZE = 1050.0, (1920, 1080)
RING = 4.75  # m; radius of the camera ring
KEYPOINT_SD, TRUNK_KEYPOINT_SD, OWN_KEYPOINT_SD = (
    0.016,
    0.029,
    0.008,
)  # m per axis; first two: offsets of the detector's limb and trunk joints, third: of this person
TRUNK_KEYPOINTS = ("Neck", "lHip", "rHip", "lShoulder", "rShoulder")
DEVICES: tuple[tuple[str, tuple[float, float, float]], ...] = (
    ("hips", (-0.1, 0.0, 0.02)),
    ("spine4", (0.1, 0.0, 0.06)),
    ("head", (-0.08, 0.0, 0.1)),
    ("lUpperArm", (0.0, 0.15, 0.04)),
    ("lForearm", (0.0, 0.18, 0.03)),
    ("rUpperArm", (0.0, -0.15, 0.04)),
    ("rForearm", (0.0, -0.18, 0.03)),
    ("lThigh", (0.05, 0.06, -0.22)),
    ("lShin", (0.05, 0.0, -0.15)),
    ("lFoot", (0.06, 0.0, -0.03)),
    ("rThigh", (0.05, -0.06, -0.22)),
    ("rShin", (0.05, 0.0, -0.15)),
    ("rFoot", (0.06, 0.0, -0.03)),
)
SPARSE = ("hips", "head", "lForearm", "rForearm", "lShin", "rShin")  # the six-IMU set of Malleson et al. 2020


USUAL_JOINTS, USUAL_IMUS = JointNoise(), ImuNoise()


@dataclass(frozen=True)
class BodyScene:
    """Scene of a body capture.

    Args:
        clips: Names of recorded motions of one body, played one after another.
        path: Direction (deg) of each clip, which starts where the previous one ended. () centres every clip
            at the same place, facing x.
        at: Position (2,) m of the first clip, or of all clips without a path.
        facing: Rotation of the whole motion, deg.
        cameras: Number of cameras.
        focal: Focal length, px.
        t_pose: Error of the T-pose per joint and axis, deg (standard deviation).
        mounts: Whether the file states the IMU mountings. Otherwise they come from the T-pose.
        rate: Rate of cameras and IMUs, Hz.
        seconds: Longest duration, s.
        joints: Errors of the 2D joints.
        imus: Errors of the IMUs.
        heading: Largest rotation (deg) of the IMUs' inertial frame about the vertical. A nonzero value makes
            the file declare the heading unknown.
        clock: Largest offset of the IMU clock, s.
        designated: Whether the person is solved for.
        others: Further people. Only their `clips`, `path`, `at`, `facing`, `t_pose`, `mounts`, `heading`,
            `clock` and `designated` apply.
    """

    clips: tuple[str, ...] = ("02_05",)
    path: tuple[float, ...] = ()
    at: tuple[float, float] = (0.0, 0.0)
    facing: float = 0.0
    cameras: int = 8
    focal: float = FOCAL
    t_pose: float = 2.0
    mounts: bool = True
    rate: float = 60.0
    seconds: float = 1e3
    joints: JointNoise = USUAL_JOINTS
    imus: ImuNoise = USUAL_IMUS
    heading: float = 0.0
    clock: float = 0.0
    designated: bool = True
    others: tuple[BodyScene, ...] = ()


@dataclass(frozen=True, eq=False)
class BodyCapture:
    """Simulated capture of one person with its ground truth.

    Args:
        rig: Calibrated cameras.
        joint_names: Names of the detector's K joints.
        stamps: Timestamps (T,) ns.
        pixels: Detected joints (C, T, K, 2), NaN = missing.
        scores: Scores (C, T, K).
        devices: IMU samples by device.
        subject: Known data of the subject.
        stature: Body height, m.
        motion: True motion.
        mounts: True mounting (3, 3) of each device, segment from device.
    """

    rig: Rig
    joint_names: tuple[str, ...]
    stamps: Array
    pixels: Array
    scores: Array
    devices: dict[str, ImuSeries]
    subject: Subject
    stature: float
    motion: BodyMotion
    mounts: dict[str, Array]

    def truth(self) -> list[BodyState]:
        """Return the true bodies at all timestamps."""
        return states_of(self.subject.id, self.stamps, self.motion)


def states_of(number: int, stamps: Array, motion: BodyMotion) -> list[BodyState]:
    """Return the true bodies of the person with id `number` at all timestamps."""
    return [
        BodyState(int(stamp), number, motion.places[t], motion.frames[t]) for t, stamp in enumerate(stamps)
    ]


def simulate_body(scene: BodyScene, seed: int, model: SegmentModel, clips: Mapping[str, Clip]) -> BodyCapture:
    """Simulate the first person of a scene alone; the same scene and seed always give the same capture."""
    rng = np.random.default_rng([seed, 23])
    body, motion = moving_body(rng, scene, model, clips)
    rig = ring(rng, scene.cameras, scene.focal)
    known, points = detected_body(rng, body, motion, {})
    names = tuple(known.keypoints)
    pixels, scores = detect_joints(
        rng, rig, points, trunk_of(model, motion)[None], names, scene.joints, scene.rate
    )
    worn = wear(rng, scene, model, motion)
    subject = Subject(
        0,
        known,
        worn.devices,
        worn.t_pose,
        motion.roots[0].round(2),
        heading_known=not scene.heading,
        stature=clips[scene.clips[0]].stature,
    )
    stamps = FIRST_NS + np.round(motion.times * 1e9).astype(np.int64)
    return BodyCapture(
        rig, names, stamps, pixels, scores, worn.samples, subject, subject.stature, motion, worn.mounts
    )


def moving_body(
    rng: np.random.Generator, scene: BodyScene, model: SegmentModel, clips: Mapping[str, Clip]
) -> tuple[SegmentedBody, BodyMotion]:
    """Return the body of a scene's first person and its motion."""
    chosen = [clips[name] for name in scene.clips]
    body = model.body(chosen[0].stature).with_offsets(dict(zip(model.names, chosen[0].offsets)))
    chosen = laid_out(chosen, scene.path)
    motion = make_motion(rng, model.names, chosen, scene.rate, scene.t_pose, body.chain)
    kept = motion.times <= scene.seconds
    motion = BodyMotion(*(part[kept] for part in vars(motion).values()))
    if any(scene.at) or scene.facing:
        motion = moved(motion, math.radians(scene.facing), scene.at)
    return body, motion


def detected_body(
    rng: np.random.Generator, body: SegmentedBody, motion: BodyMotion, detector: dict[str, Array]
) -> tuple[SegmentedBody, Array]:
    """Return the body with the known detector offsets, and the true positions (T, K, 3) m of its joints.

    Args:
        detector: Offset (3,) m of each of the detector's joints by name. Missing ones are drawn and stored
            here.
    """
    known, true_points = _keypoints(rng, body, detector)
    at = [true_points[name] for name in known.keypoints]
    segments, offsets = np.array([s for s, _ in at]), np.array([o for _, o in at])
    points = motion.places[:, segments] + (motion.frames[:, segments] @ offsets[..., None])[..., 0]
    return known, points


def trunk_of(model: SegmentModel, motion: BodyMotion) -> Array:
    """Return the lower and upper ends (T, 2, 3) m of the trunk."""
    return motion.places[:, [0, model.index("neck")]]


class BodyImus(NamedTuple):
    """IMUs on a body.

    Args:
        devices: Devices as the file states them.
        t_pose: T-pose.
        samples: IMU samples by device.
        mounts: True mountings (3, 3), segment from device.
    """

    devices: tuple[Device, ...]
    t_pose: TPose
    samples: dict[str, ImuSeries]
    mounts: dict[str, Array]


def wear(
    rng: np.random.Generator, scene: BodyScene, model: SegmentModel, motion: BodyMotion, first: int = 1
) -> BodyImus:
    """Simulate 13 IMUs on a body, with a common inertial frame and a common clock.

    Args:
        first: Number of the first device.
    """
    worn, samples, mounts = [], {}, {}
    for k, (segment, position) in enumerate(DEVICES):
        name, mount, place = f"imu{k + first:02d}", random_mount(rng), np.array(position)
        index, mounts[name] = model.index(segment), mount
        samples[name] = measure(rng, motion, index, place, mount, scene.imus, FIRST_NS)
        stated = mistaken(rng, mount, scene.imus.mounting) if scene.mounts else None
        worn.append(Device(name, index, place, stated))
    if scene.heading or scene.clock:
        angle = math.radians(scene.heading) * rng.uniform(-1.0, 1.0)
        late = round(1e9 * scene.clock * rng.uniform(-1.0, 1.0))
        samples = {name: unknown_heading(s, angle).shifted(late) for name, s in samples.items()}
    end = FIRST_NS + int(1e9 * (T_POSE_S - 0.2))
    faces = turn_about_z(math.radians(scene.facing)) @ np.array([1.0, 0.0, 0.0])
    return BodyImus(tuple(worn), TPose(FIRST_NS, end, faces), samples, mounts)


def sparse(capture: BodyCapture, cameras: Sequence[int], imus: int) -> BodyCapture:
    """Return the same capture with only these cameras and 0, 6 or 13 IMUs."""
    chosen = list(cameras)
    names = capture.subject.body.model.names
    kept = [d for d in capture.subject.devices if imus == 13 or (imus == 6 and names[d.segment] in SPARSE)]
    rig = Rig(tuple(capture.rig.cameras[c] for c in chosen)) if chosen else capture.rig
    return replace(
        capture,
        rig=rig,
        pixels=capture.pixels[chosen],
        scores=capture.scores[chosen],
        devices={d.name: capture.devices[d.name] for d in kept},
        subject=replace(capture.subject, devices=tuple(kept)),
    )


def ring(rng: np.random.Generator, count: int, focal: float) -> Rig:
    """Return cameras around the room that look at its middle."""
    cameras = []
    for k in range(count):
        angle = 2.0 * np.pi * (k + rng.uniform(-0.1, 0.1)) / count
        centre = np.array([RING * np.cos(angle), RING * np.sin(angle), rng.uniform(1.2, 2.6)])
        forward = np.array([0.0, 0.0, 1.0]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        matrix = np.array([[focal, 0, SIZE[0] / 2 - 0.5], [0, focal, SIZE[1] / 2 - 0.5], [0, 0, 1.0]])
        pose = Rigid(rotation, -rotation @ centre)
        cameras.append(Camera(f"cam{k:02d}", SIZE, Intrinsics(matrix, np.zeros(5)), pose))
    return Rig(tuple(cameras))


def _keypoints(
    rng: np.random.Generator, body: SegmentedBody, detector: dict[str, Array]
) -> tuple[SegmentedBody, dict[str, tuple[int, Array]]]:
    """Return the body with the known detector offsets, and the true joint positions on this person.

    The positions are (segment index, offset (3,) m) by joint name.
    """
    names = body.model.names
    known, true = {}, {}
    for name, (segment, offset) in body.keypoints.items():
        spread = TRUNK_KEYPOINT_SD if name in TRUNK_KEYPOINTS else KEYPOINT_SD
        if name not in detector:
            detector[name] = spread * rng.normal(size=3)
        place = offset + detector[name]
        known[name] = (names[segment], place)
        true[name] = (segment, place + OWN_KEYPOINT_SD * rng.normal(size=3))
    return body.with_keypoints(known), true
