"""Bodies of constant limb lengths, and how they follow what a motion prescribes.

Body axes: x forward, y left, z up. Arms and legs are two-bone chains that reach for a target
(inverse kinematics), so limb lengths are exact whatever the motion asks for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.simulation.skeleton import JOINTS, SIDES, J

Array = np.ndarray
ADULT = 1.75  # m, height that the offsets of the head are stated for
REACH_SHARPNESS = 40.0  # how late a limb notices that its target is out of reach
HEAD_POINTS = {  # relative to the neck, m, in the head's axes
    "Nose": (0.128, 0.0, 0.165),
    "lEye": (0.105, 0.033, 0.195),
    "rEye": (0.105, -0.033, 0.195),
    "lEar": (0.022, 0.068, 0.173),
    "rEar": (0.022, -0.068, 0.173),
}
_SHARES = {  # of the height
    "torso": 0.287,
    "shoulder": 0.104,
    "upper_arm": 0.170,
    "forearm": 0.147,
    "hip": 0.055,
    "thigh": 0.245,
    "shank": 0.238,
    "ankle": 0.055,
}


@dataclass(frozen=True)
class Body:
    """Lengths of one person, m."""

    height: float
    torso: float  # BodyCenter to Neck
    shoulder: float  # half of the width
    upper_arm: float
    forearm: float
    hip: float  # half of the width
    thigh: float
    shank: float
    ankle: float  # its height over the floor
    head: float  # scale of the head, 1 = adult

    @classmethod
    def draw(cls, rng: np.random.Generator, height: float) -> Body:
        """A person of this height, each length varied by about 3 %; children have larger heads."""
        vary = np.clip(rng.normal(1.0, 0.03, len(_SHARES)), 0.93, 1.07)
        lengths = {name: float(height * share * v) for (name, share), v in zip(_SHARES.items(), vary)}
        head = (height / ADULT) ** 0.4 * rng.uniform(0.97, 1.03)
        return cls(height=float(height), head=float(head), **lengths)

    @property
    def leg(self) -> float:
        """Hip to ankle, stretched, m."""
        return self.thigh + self.shank

    @property
    def arm(self) -> float:
        """Shoulder to wrist, stretched, m."""
        return self.upper_arm + self.forearm

    @property
    def seat(self) -> float:
        """Height of BodyCenter when sitting on a chair, m."""
        return min(0.53, self.ankle + 1.02 * self.shank)


@dataclass(frozen=True, eq=False)
class LowerBody:
    """What the legs and the trunk are to do at T instants."""

    pelvis: Array  # (T, 3) BodyCenter, m
    heading: Array  # (T,) rad
    lean: Array  # (T,) trunk forward, rad
    ankles: Array  # (T, 2, 3) targets left, right, m
    steps: Array  # (T,) gait cycles so far


@dataclass(frozen=True, eq=False)
class UpperBody:
    """What the arms and the head are to do at T instants."""

    hands: Array  # (T, 2, 3) wrists from the shoulders: forward, outward, up, in arm lengths
    twist: Array  # (T,) chest against pelvis, rad
    head_turn: Array  # (T,) head against chest, rad
    head_nod: Array  # (T,) down positive, rad


@dataclass(frozen=True, eq=False)
class Posture:
    """Joints (T, 19, 3) m and the rotations (T, 3, 3) world from body part."""

    joints: Array
    pelvis: Array
    chest: Array
    head: Array


def assume_posture(body: Body, lower: LowerBody, upper: UpperBody) -> Posture:
    """The posture of a body that does as it is told, as far as its limbs reach."""
    pelvis = axes_of(lower.heading, np.zeros_like(lower.heading))
    chest = axes_of(lower.heading + upper.twist, lower.lean)
    facing = lower.heading + upper.twist + upper.head_turn
    head = axes_of(facing, 0.3 * lower.lean + upper.head_nod)
    joints = np.empty((len(lower.heading), len(JOINTS), 3))
    neck = lower.pelvis + body.torso * chest[..., 2]
    joints[:, J["BodyCenter"]], joints[:, J["Neck"]] = lower.pelvis, neck
    for name, offset in HEAD_POINTS.items():
        joints[:, J[name]] = neck + head @ (body.head * np.array(offset))
    for k, (side, sign) in enumerate(SIDES):
        shoulder = neck + chest @ np.array([0.0, sign * body.shoulder, -0.004 * body.height])
        hand = body.arm * upper.hands[:, k] * np.array([1.0, sign, 1.0])
        elbow, wrist = reach(
            shoulder,
            shoulder + (chest @ hand[..., None])[..., 0],
            chest @ np.array([-0.6, 0.4 * sign, -0.5]),
            body.upper_arm,
            body.forearm,
        )
        hip = lower.pelvis + pelvis @ np.array([0.0, sign * body.hip, 0.0])
        forward = pelvis @ np.array([0.8, 0.1 * sign, 0.6])
        knee, ankle = reach(hip, lower.ankles[:, k], forward, body.thigh, body.shank)
        limbs = (
            ("Shoulder", shoulder),
            ("Elbow", elbow),
            ("Wrist", wrist),
            ("Hip", hip),
            ("Knee", knee),
            ("Ankle", ankle),
        )
        for name, points in limbs:
            joints[:, J[side + name]] = points
    return Posture(joints, pelvis, chest, head)


def axes_of(heading: Array, pitch: Array) -> Array:
    """Rotations (T, 3, 3) with columns forward, left, up; a positive pitch looks down."""
    ch, sh, cp, sp = np.cos(heading), np.sin(heading), np.cos(pitch), np.sin(pitch)
    level = np.zeros_like(ch)
    columns = ([ch * cp, sh * cp, -sp], [-sh, ch, level], [ch * sp, sh * sp, cp])
    return np.stack([np.stack(column, axis=-1) for column in columns], axis=-1)


def reach(start: Array, target: Array, pole: Array, first: float, second: float) -> tuple[Array, Array]:
    """Middle and end joint (T, 3) of a limb with bones `first` and `second` m from `start` to `target`.

    The middle joint bends towards `pole`. Where the target is out of reach, too far or too near, the
    limb ends at the limit in its direction, smoothly in time.
    """
    line = target - start
    distance = np.maximum(np.linalg.norm(line, axis=-1, keepdims=True), 1e-6)
    direction = line / distance
    far, near, p = 0.995 * (first + second), 1.01 * abs(first - second), REACH_SHARPNESS
    span = ((distance**-p + far**-p) ** -1.0 + near**p) ** (1.0 / p)  # a smooth minimum and maximum
    along = 0.5 * (span + (first * first - second * second) / span)
    across = pole - (pole * direction).sum(-1, keepdims=True) * direction
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    middle = start + along * direction + np.sqrt(np.maximum(first**2 - along**2, 0.0)) * across
    return middle, start + span * direction
