"""Bodies of constant limb lengths, posed by inverse kinematics.

Body axes: x forward, y left, z up. Arms and legs are two-bone chains that reach for a target by inverse
kinematics. So limb lengths stay exact for every motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.simulation.skeleton import JOINTS, SIDES, J

Array = np.ndarray
ADULT = 1.75  # m; body height for which the offsets of the head are stated
REACH_SHARPNESS = 40.0  # exponent of the smooth limit on a limb's reach; a larger value gives a sharper limit
HEAD_POINTS = {  # m; offsets from the neck in head axes
    "Nose": (0.128, 0.0, 0.165),
    "lEye": (0.105, 0.033, 0.195),
    "rEye": (0.105, -0.033, 0.195),
    "lEar": (0.022, 0.068, 0.173),
    "rEar": (0.022, -0.068, 0.173),
}
_SHARES = {  # segment lengths as fractions of the body height
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
class BodyLengths:
    """Segment lengths of one person, m."""

    height: float
    torso: float  # BodyCenter to Neck
    shoulder: float  # half of the shoulder width
    upper_arm: float
    forearm: float
    hip: float  # half of the hip width
    thigh: float
    shank: float
    ankle: float  # height of the ankle above the floor
    head: float  # scale of the head, 1 = adult

    @classmethod
    def draw(cls, rng: np.random.Generator, height: float) -> BodyLengths:
        """Draw the body of a person of this height (m), with each length varied by about 3 %.

        Children get relatively larger heads.
        """
        vary = np.clip(rng.normal(1.0, 0.03, len(_SHARES)), 0.93, 1.07)
        lengths = {name: float(height * share * v) for (name, share), v in zip(_SHARES.items(), vary)}
        head = (height / ADULT) ** 0.4 * rng.uniform(0.97, 1.03)
        return cls(height=float(height), head=float(head), **lengths)

    @property
    def leg(self) -> float:
        """Return the length of the stretched leg, hip to ankle, m."""
        return self.thigh + self.shank

    @property
    def arm(self) -> float:
        """Return the length of the stretched arm, shoulder to wrist, m."""
        return self.upper_arm + self.forearm

    @property
    def seat(self) -> float:
        """Return the height of BodyCenter when sitting on a chair, m."""
        return min(0.53, self.ankle + 1.02 * self.shank)


@dataclass(frozen=True, eq=False)
class LowerBody:
    """Target motion of legs and trunk at T instants."""

    pelvis: Array  # (T, 3) BodyCenter, m
    heading: Array  # (T,) rad
    lean: Array  # (T,) forward lean of the trunk, rad
    ankles: Array  # (T, 2, 3) ankle targets, left and right, m
    steps: Array  # (T,) number of gait cycles so far


@dataclass(frozen=True, eq=False)
class UpperBody:
    """Target motion of arms and head at T instants."""

    hands: Array  # (T, 2, 3) wrists relative to the shoulders: forward, outward, up, in arm lengths
    twist: Array  # (T,) rotation of the chest relative to the pelvis, rad
    head_turn: Array  # (T,) rotation of the head relative to the chest, rad
    head_nod: Array  # (T,) pitch of the head, positive downwards, rad


@dataclass(frozen=True, eq=False)
class Posture:
    """Joints (T, 19, 3) m and the rotations (T, 3, 3) of pelvis, chest and head, world from body part."""

    joints: Array
    pelvis: Array
    chest: Array
    head: Array


def assume_posture(body: BodyLengths, lower: LowerBody, upper: UpperBody) -> Posture:
    """Return the posture that follows the targets as far as the limbs reach."""
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
    """Return rotations (T, 3, 3) with columns forward, left, up; a positive pitch looks down."""
    ch, sh, cp, sp = np.cos(heading), np.sin(heading), np.cos(pitch), np.sin(pitch)
    level = np.zeros_like(ch)
    columns = ([ch * cp, sh * cp, -sp], [-sh, ch, level], [ch * sp, sh * sp, cp])
    return np.stack([np.stack(column, axis=-1) for column in columns], axis=-1)


def reach(start: Array, target: Array, pole: Array, first: float, second: float) -> tuple[Array, Array]:
    """Return the middle and end joints (T, 3) m of a limb from `start` to `target`.

    Its bones have the lengths `first` and `second`, m.

    The middle joint bends towards `pole`. If the target is too far or too near, the limb ends at its reach
    limit in the direction of the target. The limit is smooth in time.
    """
    line = target - start
    distance = np.maximum(np.linalg.norm(line, axis=-1, keepdims=True), 1e-6)
    direction = line / distance
    far, near, p = 0.995 * (first + second), 1.01 * abs(first - second), REACH_SHARPNESS
    span = ((distance**-p + far**-p) ** -1.0 + near**p) ** (1.0 / p)  # smooth minimum and maximum
    along = 0.5 * (span + (first * first - second * second) / span)
    across = pole - (pole * direction).sum(-1, keepdims=True) * direction
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    middle = start + along * direction + np.sqrt(np.maximum(first**2 - along**2, 0.0)) * across
    return middle, start + span * direction
