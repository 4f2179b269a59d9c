"""Landmarks of simulated people beyond the 19 joints: face, hands and feet, by their shared names.

The names come from the vocabulary that skeleton files share (`config/skeletons`), so any of these skeletons
can be simulated, e.g. `landmarks(person, t)["left_big_toe"]`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain import DetectionSet, Rig, SkeletonModel, ViewDetections
from panoptic_ros.errors import UsageError
from panoptic_ros.simulation.people import SimulatedPerson
from panoptic_ros.simulation.skeleton import JOINTS, SIDES
from panoptic_ros.simulation.timing import to_stamp

Array = np.ndarray
FINGERS = ("thumb", "forefinger", "middle_finger", "ring_finger", "pinky_finger")
# m; distances of a finger's joints from the wrist along the forearm
FINGER_REACH = (0.045, 0.085, 0.110, 0.130)
FINGER_GAP = 0.02  # m between fingers
# offsets from the ankle: forward, outward, m
FOOT = {"big_toe": (0.17, -0.02), "small_toe": (0.14, 0.05), "heel": (-0.05, 0.0)}
SOLE = 0.05  # m below the ankle
MISS = 0.05  # probability that a joint is missing
SCORE = (0.6, 0.95)


def landmarks(person: SimulatedPerson, t: Array) -> dict[str, Array]:
    """Return positions (T, 3) m of every landmark at times (T,) s, by its name in the vocabulary."""
    posture = person.posture(t)
    joints = dict(zip(JOINTS, posture.joints.swapaxes(0, 1)))
    found = {"nose": joints["Nose"], "neck": joints["Neck"], "mid_hip": joints["BodyCenter"]}
    for short, sign in SIDES:
        side = "left" if sign > 0.0 else "right"
        for name in ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle", "Eye", "Ear"):
            found[f"{side}_{name.lower()}"] = joints[short + name]
        found |= _hand(side, sign, joints[short + "Elbow"], joints[short + "Wrist"], posture.chest)
        for name, (forward, outward) in FOOT.items():
            offset = np.array([forward, sign * outward, -SOLE])
            found[f"{side}_{name}"] = joints[short + "Ankle"] + posture.pelvis @ offset
        for name, out in (("eye_inner", 0.02), ("eye_outer", 0.047)):
            found[f"{side}_{name}"] = joints["Neck"] + posture.head @ np.array([0.105, sign * out, 0.195])
        found[f"{side}_mouth"] = joints["Neck"] + posture.head @ np.array([0.112, sign * 0.026, 0.125])
    for number, place in enumerate(_face()):
        found[f"face-{number}"] = joints["Neck"] + posture.head @ (person.body.head * place)
    return found


def _hand(side: str, sign: float, elbow: Array, wrist: Array, chest: Array) -> dict[str, Array]:
    """Return the joints of a flat hand that extends the forearm, with the thumb on the inner side."""
    along = (wrist - elbow) / np.linalg.norm(wrist - elbow, axis=-1, keepdims=True)
    across = np.cross(along, chest[..., 0])
    across *= sign / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-3)
    found = {f"{side}_hand_root": wrist + 0.01 * along}
    for number, finger in enumerate(FINGERS):
        aside = (number - 2) * FINGER_GAP * across
        for joint, reach in enumerate(FINGER_REACH, start=1):
            found[f"{side}_{finger}{joint}"] = wrist + reach * along + aside
    found |= {
        f"{side}_{name}": found[f"{side}_{finger}"]
        for name, finger in (("thumb", "thumb4"), ("index", "forefinger4"), ("pinky", "pinky_finger4"))
    }
    return found


def _face() -> Array:
    """Return the face points (68, 3) m in head axes from the neck; points 0 to 7 are on the right."""
    turn = np.linspace(0.0, np.pi, 17)
    jaw = np.column_stack([0.03 + 0.075 * np.sin(turn), -0.07 * np.cos(turn), 0.19 - 0.12 * np.sin(turn)])
    arch = [0.210, 0.220, 0.223, 0.220, 0.215]
    brow = np.column_stack([np.full(5, 0.11), np.linspace(-0.055, -0.015, 5), arch])
    bridge = np.column_stack([np.linspace(0.115, 0.13, 4), np.zeros(4), np.linspace(0.195, 0.165, 4)])
    nostrils = np.column_stack([np.full(5, 0.115), np.linspace(-0.014, 0.014, 5), np.full(5, 0.155)])
    eye = np.array([(-14, 0), (-5, 5), (5, 5), (14, 0), (5, -5), (-5, -5)]) * 1e-3
    right_eye = np.column_stack([np.full(6, 0.105), eye[:, 0] - 0.033, eye[:, 1] + 0.195])
    flip = np.array([1.0, -1.0, 1.0])
    left_eye = (right_eye * flip)[[3, 2, 1, 0, 5, 4]]
    lips = (
        np.array(
            [
                (-26, 0),
                (-17, 8),
                (-7, 11),
                (0, 9),
                (7, 11),
                (17, 8),
                (26, 0),
                (17, -9),
                (7, -13),
                (0, -14),
                (-7, -13),
                (-17, -9),
                (-20, 0),
                (-8, 3),
                (0, 3),
                (8, 3),
                (20, 0),
                (8, -4),
                (0, -4),
                (-8, -4),
            ]
        )
        * 1e-3
    )
    mouth = np.column_stack([np.full(20, 0.112), lips[:, 0], lips[:, 1] + 0.125])
    left_brow = (brow * flip)[::-1]
    return np.concatenate([jaw, brow, left_brow, bridge, nostrils, right_eye, left_eye, mouth])


def named_joints(person: SimulatedPerson, t: Array, names: Sequence[str]) -> Array:
    """Return positions (T, J, 3) m of landmarks by their names in the vocabulary.

    Raises:
        UsageError: If simulated people lack such a landmark.
    """
    known = landmarks(person, t)
    missing = [name for name in names if name not in known]
    if missing:
        raise UsageError(f"simulated people have no {', '.join(missing[:5])}")
    return np.stack([known[name] for name in names], axis=1)


def project_joints(
    rig: Rig, skeleton: SkeletonModel, joints: Array, index: int, seconds: float, noise_px: float, seed: int
) -> DetectionSet:
    """Return the detections of joints (P, J, 3) m in all views, with noise and missing joints.

    People do not hide each other.
    """
    rng = np.random.default_rng([seed, index])
    views = []
    for camera in rig.cameras:
        pixels, seen = camera.project(joints)
        pixels = pixels + noise_px * rng.standard_normal(pixels.shape)
        found = seen & camera.contains(pixels) & (rng.random(seen.shape) >= MISS)
        scores = np.where(found, rng.uniform(*SCORE, seen.shape), 0.0)
        views.append(
            ViewDetections(
                camera.name,
                to_stamp(seconds),
                index,
                camera.image_size,
                skeleton.hash,
                np.where(found[..., None], pixels, np.nan),
                scores,
                scores.mean(axis=1),
            )
        )
    return DetectionSet(index, to_stamp(seconds), skeleton.hash, tuple(views))
