"""Shapes of a person from posture and appearance. Lengths are those of an adult, scaled to the body.

Some shapes are shifted relative to the joints. Networks learn from photographs whose annotators mark visible
positions. The shifts make such networks place a joint where the simulation has it, within a centimetre.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.simulation.body import ADULT, BodyLengths, Posture
from panoptic_ros.simulation.rendering.shapes import Material, ShapeBuilder, Shapes
from panoptic_ros.simulation.rendering.wardrobe import Appearance
from panoptic_ros.simulation.skeleton import SIDES, J

Array = np.ndarray
SKULL = np.array([0.033, 0.0, 0.170])  # m; centre of the head relative to the neck, in head axes
ELBOW_TIP = 0.015  # m; distance of the elbow tip beyond the elbow joint
TRUNK = (  # (from and to along the spine in m, radii in m, flatness, whether it is the shirt)
    (-0.03, 0.14, (0.150, 0.138), 0.72, False),
    (0.04, 0.16, (0.148, 0.142), 0.74, True),
    (0.12, 0.34, (0.140, 0.157), 0.68, True),
)


def figure(body: BodyLengths, posture: Posture, look: Appearance, person: int) -> Shapes:
    """Return the shapes of a person at the T instants of the posture."""
    build = ShapeBuilder(person, body.height / ADULT)
    cloth = Material.STRIPES if look.stripes else Material.CLOTH
    _trunk(build, posture, look, cloth)
    for k, (side, _) in enumerate(SIDES):
        _arm(build, posture, look, cloth, side)
        _leg(build, body, posture, look, k, side)
    _head(build, body, posture, look)
    return build.shapes()


def _trunk(build: ShapeBuilder, posture: Posture, look: Appearance, cloth: Material) -> None:
    joints, s = posture.joints, build.scale
    up = s * posture.chest[..., 2]
    hips, neck = joints[:, J["BodyCenter"]], joints[:, J["Neck"]]
    for low, high, (below, above), flat, shirt in TRUNK:
        build.add(
            hips + low * up,
            hips + high * up,
            (below * look.girth, above * look.girth),
            look.shirt if shirt else look.trousers,
            cloth if shirt else Material.CLOTH,
            posture.chest,
            (flat, 1.0, 1.0),
        )
    left, right = joints[:, J["lShoulder"]], joints[:, J["rShoulder"]]
    build.add(left - 0.03 * up, right - 0.03 * up, (0.066, 0.066), look.shirt, cloth)
    for shoulder in (left, right):
        build.add(neck + 0.01 * up, shoulder - 0.005 * up, (0.062, 0.050), look.shirt, cloth)


def _arm(build: ShapeBuilder, posture: Posture, look: Appearance, cloth: Material, side: str) -> None:
    shoulder, elbow, wrist = (posture.joints[:, J[side + n]] for n in ("Shoulder", "Elbow", "Wrist"))
    start = shoulder - 0.020 * build.scale * posture.chest[..., 2]
    tip = elbow + ELBOW_TIP * build.scale * _unit(elbow - shoulder)
    build.add(start, tip, (0.060 * look.girth, 0.047), look.shirt, cloth)
    sleeve = (look.shirt, cloth) if look.long_sleeves else (look.skin, Material.PLAIN)
    build.add(tip, wrist, (0.046, 0.034), *sleeve)
    reach = build.scale * _unit(wrist - elbow)
    build.add(wrist + 0.02 * reach, wrist + 0.085 * reach, (0.032, 0.038), look.skin)


def _leg(
    build: ShapeBuilder, body: BodyLengths, posture: Posture, look: Appearance, k: int, side: str
) -> None:
    hip, knee, ankle = (posture.joints[:, J[side + n]] for n in ("Hip", "Knee", "Ankle"))
    build.add(hip, knee, (0.090 * look.girth, 0.062), look.trousers, Material.CLOTH)
    s, down = build.scale, np.array([0.0, 0.0, -1.0])
    build.add(knee, ankle + 0.015 * s * down, (0.062, 0.042), look.trousers, Material.CLOTH)
    along = foot_direction(body, posture, knee, ankle)
    heel, toe = ankle + s * (0.056 * down - 0.045 * along), ankle + s * (0.062 * down + 0.145 * along)
    build.add(heel, toe, (0.041, 0.034), look.shoes)


def foot_direction(body: BodyLengths, posture: Posture, knee: Array, ankle: Array) -> Array:
    """Return unit vectors (T, 3) from heel to toe: level on the floor, tilted with the shank when lifted."""
    forward = posture.pelvis[..., 0]
    shank = _unit(ankle - knee)
    lifted = 0.8 * np.clip((ankle[:, 2:] - body.ankle) / 0.06, 0.0, 1.0)
    along = forward - lifted * (forward * shank).sum(-1, keepdims=True) * shank
    return _unit(along)


def _head(build: ShapeBuilder, body: BodyLengths, posture: Posture, look: Appearance) -> None:
    joints, axes, s = posture.joints, posture.head, body.head
    neck, up = joints[:, J["Neck"]], posture.chest[..., 2]
    centre = neck + axes @ (s * SKULL)
    ratio = s / build.scale  # cancels the body scale, because the head has a scale of its own
    build.add(neck - 0.03 * s * up, centre, (0.054, 0.050), 0.93 * look.skin)
    build.add(
        centre, centre, (0.100 * ratio, 0.100 * ratio), look.skin, Material.FACE, axes, (0.98, 0.78, 1.22)
    )
    back = centre + axes @ (s * np.array([-0.018, 0.0, 0.018]))
    build.add(back, back, (0.100 * ratio, 0.100 * ratio), look.hair, Material.HAIR, axes, (1.0, 0.83, 1.24))
    if look.long_hair:
        nape = centre + axes @ (s * np.array([-0.065, 0.0, -0.02]))
        ends = centre + axes @ (s * np.array([-0.085, 0.0, -0.19]))
        build.add(nape, ends, (0.062 * ratio, 0.040 * ratio), look.hair)
    nose = joints[:, J["Nose"]]
    bridge = nose + axes @ (s * np.array([-0.010, 0.0, 0.010]))
    tip = nose + axes @ (s * np.array([0.003, 0.0, -0.022]))
    build.add(bridge, tip, (0.010 * ratio, 0.017 * ratio), look.skin)
    for side, sign in SIDES:
        ear = joints[:, J[side + "Ear"]] + axes @ (s * np.array([-0.008, 0.014 * sign, 0.0]))
        build.add(ear, ear + 0.012 * s * up, (0.016 * ratio, 0.020 * ratio), 0.9 * look.skin)


def _unit(vectors: Array) -> Array:
    """Return the vectors (T, 3) scaled to length 1."""
    directions: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return directions
