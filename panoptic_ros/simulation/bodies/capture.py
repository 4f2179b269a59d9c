"""A whole simulated capture: one body, a ring of cameras, 13 IMUs, a T-pose, and what is known of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.domain.segments import Body, SegmentModel
from panoptic_ros.domain.subjects import BodyState, Device, ImuSeries, Subject, TPose
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.simulation.bodies.cameras import JointNoise, detect_joints
from panoptic_ros.simulation.bodies.imus import ImuNoise, measure, mistaken, random_mount
from panoptic_ros.simulation.bodies.motion import T_POSE_S, BodyMotion, Clip, make_motion

Array = np.ndarray
FIRST_NS = 1_000_000_000
FOCAL, SIZE = 1050.0, (1920, 1080)
RING = 4.75  # m
KEYPOINT_SD, TRUNK_KEYPOINT_SD, OWN_KEYPOINT_SD = (
    0.016,
    0.029,
    0.008,
)  # m per axis: of the detector, of the person
TRUNK_KEYPOINTS = ("Neck", "lHip", "rHip", "lShoulder", "rShoulder")
DEVICES: tuple[tuple[str, tuple[float, float, float]], ...] = (
    ("hips", (-0.1, 0.0, 0.02)), ("spine4", (0.1, 0.0, 0.06)), ("head", (-0.08, 0.0, 0.1)),
    ("lUpperArm", (0.0, 0.15, 0.04)), ("lForearm", (0.0, 0.18, 0.03)),
    ("rUpperArm", (0.0, -0.15, 0.04)), ("rForearm", (0.0, -0.18, 0.03)),
    ("lThigh", (0.05, 0.06, -0.22)), ("lShin", (0.05, 0.0, -0.15)), ("lFoot", (0.06, 0.0, -0.03)),
    ("rThigh", (0.05, -0.06, -0.22)), ("rShin", (0.05, 0.0, -0.15)), ("rFoot", (0.06, 0.0, -0.03)),
)  # fmt: skip
SPARSE = ("hips", "head", "lForearm", "rForearm", "lShin", "rShin")  # the paper's six


USUAL_JOINTS, USUAL_IMUS = JointNoise(), ImuNoise()


@dataclass(frozen=True)
class BodyScene:
    """What is simulated.

    Args:
        clips: names of recorded motions, one after another, of one body.
        t_pose: degrees per joint and axis, off a T; mounts: whether the file states mountings, in place of
        the
            T-pose. rate: Hz, of cameras and IMUs.
    """

    clips: tuple[str, ...] = ("02_05",)
    cameras: int = 8
    t_pose: float = 2.0
    mounts: bool = True
    rate: float = 60.0
    seconds: float = 1e3
    joints: JointNoise = USUAL_JOINTS
    imus: ImuNoise = USUAL_IMUS


@dataclass(frozen=True, eq=False)
class BodyCapture:
    """Pixels (C, T, K, 2), NaN = missing, and scores (C, T, K) of the joints; samples by device; what is
    known of the subject; and the truth, with the mounting (3, 3) of each device, segment from device."""

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
        """True bodies at all stamps."""
        return [
            BodyState(int(stamp), self.subject.id, self.motion.places[t], self.motion.frames[t])
            for t, stamp in enumerate(self.stamps)
        ]


def simulate_body(scene: BodyScene, seed: int, model: SegmentModel, clips: Mapping[str, Clip]) -> BodyCapture:
    """One capture; the same scene and seed always give the same."""
    rng = np.random.default_rng([seed, 23])
    chosen = [clips[name] for name in scene.clips]
    stature = chosen[0].stature
    body = model.body(stature).with_offsets(dict(zip(model.names, chosen[0].offsets)))
    motion = make_motion(rng, model.names, chosen, scene.rate, scene.t_pose, body.chain)
    kept = motion.times <= scene.seconds
    motion = BodyMotion(*(part[kept] for part in vars(motion).values()))
    rig = _ring(rng, scene.cameras)
    known, true_points = _keypoints(rng, body)
    names = tuple(known.keypoints)
    at = [true_points[name] for name in names]
    segments, offsets = np.array([s for s, _ in at]), np.array([o for _, o in at])
    points = motion.places[:, segments] + (motion.frames[:, segments] @ offsets[..., None])[..., 0]
    trunk = motion.places[:, [0, model.index("neck")]]
    pixels, scores = detect_joints(rng, rig, points, trunk, names, scene.joints, scene.rate)
    worn, samples, mounts = [], {}, {}
    for k, (segment, position) in enumerate(DEVICES):
        name, mount, place = f"imu{k + 1:02d}", random_mount(rng), np.array(position)
        index, mounts[name] = model.index(segment), mount
        samples[name] = measure(rng, motion, index, place, mount, scene.imus, FIRST_NS)
        stated = mistaken(rng, mount, scene.imus.mounting) if scene.mounts else None
        worn.append(Device(name, index, place, stated))
    end = FIRST_NS + int(1e9 * (T_POSE_S - 0.2))
    subject = Subject(
        0, known, tuple(worn), TPose(FIRST_NS, end, np.array([1.0, 0.0, 0.0])), motion.roots[0].round(2),
        stature=stature,
    )  # fmt: skip
    stamps = FIRST_NS + np.round(motion.times * 1e9).astype(np.int64)
    return BodyCapture(rig, names, stamps, pixels, scores, samples, subject, stature, motion, mounts)


def sparse(capture: BodyCapture, cameras: Sequence[int], imus: int) -> BodyCapture:
    """The same capture with these cameras, and 0, 6 or 13 IMUs."""
    chosen = list(cameras)
    names = capture.subject.body.model.names
    kept = [d for d in capture.subject.devices if imus == 13 or (imus == 6 and names[d.segment] in SPARSE)]
    rig = Rig(tuple(capture.rig.cameras[c] for c in chosen)) if chosen else capture.rig
    return replace(
        capture, rig=rig, pixels=capture.pixels[chosen], scores=capture.scores[chosen],
        devices={d.name: capture.devices[d.name] for d in kept},
        subject=replace(capture.subject, devices=tuple(kept)),
    )  # fmt: skip


def _ring(rng: np.random.Generator, count: int) -> Rig:
    cameras = []
    for k in range(count):
        angle = 2.0 * np.pi * (k + rng.uniform(-0.1, 0.1)) / count
        centre = np.array([RING * np.cos(angle), RING * np.sin(angle), rng.uniform(1.2, 2.6)])
        forward = np.array([0.0, 0.0, 1.0]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        matrix = np.array([[FOCAL, 0, SIZE[0] / 2 - 0.5], [0, FOCAL, SIZE[1] / 2 - 0.5], [0, 0, 1.0]])
        pose = Rigid(rotation, -rotation @ centre)
        cameras.append(Camera(f"cam{k:02d}", SIZE, Intrinsics(matrix, np.zeros(5)), pose))
    return Rig(tuple(cameras))


def _keypoints(rng: np.random.Generator, body: Body) -> tuple[Body, dict[str, tuple[int, Array]]]:
    """The body with the detector's offsets as they are known, and where its joints truly are on this
    person."""
    names = body.model.names
    known, true = {}, {}
    for name, (segment, offset) in body.keypoints.items():
        spread = TRUNK_KEYPOINT_SD if name in TRUNK_KEYPOINTS else KEYPOINT_SD
        place = offset + spread * rng.normal(size=3)
        known[name] = (names[segment], place)
        true[name] = (segment, place + OWN_KEYPOINT_SD * rng.normal(size=3))
    return body.with_keypoints(known), true
