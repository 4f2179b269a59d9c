"""Which joints are hidden behind a body or under a table.

A body is a set of capsules round its bones. A joint is hidden if the segment from the camera to a
point just in front of it passes through a capsule.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.simulation.body import ADULT
from panoptic_ros.simulation.skeleton import JOINTS, J

Array = np.ndarray
OWN = 0.7  # capsules are thinner against joints of their own body
SKIN = 0.03  # m, joints are seen this much in front of their centre
TABLE_HEIGHT = 0.70  # m
BATCH = 16  # views at once, to bound the memory


@dataclass(frozen=True)
class Capsule:
    """Two ends as mixtures of joints, a radius (m, for an adult), and joints it never hides."""

    start: dict[str, float]
    end: dict[str, float]
    radius: float
    spares: tuple[str, ...] = ()


def _side(side: str) -> list[Capsule]:
    limbs = (
        ("Shoulder", "Elbow", 0.045),
        ("Elbow", "Wrist", 0.036),
        ("Hip", "Knee", 0.072),
        ("Knee", "Ankle", 0.050),
    )
    flank = Capsule(
        {side + "Shoulder": 0.75, "Neck": 0.25},
        {side + "Hip": 0.8, "BodyCenter": 0.2},
        0.085,
        ("Neck", "BodyCenter", side + "Shoulder", side + "Hip"),
    )
    return [flank] + [
        Capsule({side + a: 1.0}, {side + b: 1.0}, radius, (side + a, side + b)) for a, b, radius in limbs
    ]


CAPSULES = [  # trunk, head, and both sides
    Capsule(
        {"Neck": 0.9, "BodyCenter": 0.1},
        {"BodyCenter": 1.0},
        0.120,
        ("Neck", "BodyCenter", "lHip", "rHip"),
    ),
    Capsule({"lEar": 0.5, "rEar": 0.5}, {"lEar": 0.65, "rEar": 0.65, "Neck": -0.3}, 0.095),
    *_side("l"),
    *_side("r"),
]


def _mixture(ends: list[dict[str, float]]) -> Array:
    """Weights (K, 19) of joints for one end of the K capsules."""
    weights = np.zeros((len(ends), len(JOINTS)))
    for row, end in zip(weights, ends):
        for name, weight in end.items():
            row[J[name]] = weight
    return weights


_START = _mixture([capsule.start for capsule in CAPSULES])
_END = _mixture([capsule.end for capsule in CAPSULES])
_RADIUS = np.array([capsule.radius for capsule in CAPSULES])
_SPARED = np.array([[name in capsule.spares for capsule in CAPSULES] for name in JOINTS])  # (19, K)


def hidden_joints(centres: Array, joints: Array, present: Array, heights: Array, table: float) -> Array:
    """Which joints (C, P, 19) cannot be seen.

    Args:
        centres: (C, 3) m, of the cameras.
        joints: (C, P, 19, 3) m, at each camera's instant.
        present: (C, P) who is there; others hide nothing.
        heights: (P,) m, of the people.
        table: radius (m) of a round table over the origin, 0 = none.
    """
    cameras, people = present.shape
    points = joints.reshape(cameras, -1, 3)
    towards = centres[:, None] - points
    seen = points + SKIN * towards / np.linalg.norm(towards, axis=-1, keepdims=True)
    starts = (_START @ joints).reshape(cameras, -1, 3)
    ends = (_END @ joints).reshape(cameras, -1, 3)
    radii = _radii(people, heights)
    blocks = np.repeat(present, len(CAPSULES), axis=1)[:, None, :]
    hidden = np.empty(points.shape[:2], bool)
    for first in range(0, cameras, BATCH):
        part = slice(first, first + BATCH)
        distances = segment_distances(centres[part], seen[part], starts[part], ends[part])
        hidden[part] = ((distances < radii) & blocks[part]).any(-1)
    if table > 0.0:
        hidden |= under_table(centres, points, table)
    return hidden.reshape(cameras, people, len(JOINTS))


def _radii(people: int, heights: Array) -> Array:
    """Radius (P * 19, P * K) m of every capsule against every joint, 0 = never hides it."""
    radius = np.tile(np.outer(heights / ADULT, _RADIUS).ravel(), (people * len(JOINTS), 1))
    for k in range(people):
        rows = slice(k * len(JOINTS), (k + 1) * len(JOINTS))
        columns = slice(k * len(CAPSULES), (k + 1) * len(CAPSULES))
        radius[rows, columns] = np.where(_SPARED, 0.0, OWN * radius[rows, columns])
    return radius


def segment_distances(origins: Array, points: Array, starts: Array, ends: Array) -> Array:
    """Distances (C, N, K) m between the segments origin-point and the segments start-end.

    origins (C, 3), points (C, N, 3), starts and ends (C, K, 3). The closest points of two segments
    are where the two infinite lines are closest, clamped to one segment, then to the other.
    """
    sight, axis = points - origins[:, None], ends - starts
    offset = origins[:, None] - starts  # (C, K, 3)
    sight2 = (sight * sight).sum(-1)[:, :, None]
    axis2 = np.maximum((axis * axis).sum(-1), 1e-12)[:, None, :]
    axis_offset = (axis * offset).sum(-1)[:, None, :]
    offset2 = (offset * offset).sum(-1)[:, None, :]
    cross = sight @ axis.swapaxes(1, 2)
    sight_offset = sight @ offset.swapaxes(1, 2)
    parallel = np.maximum(sight2 * axis2 - cross * cross, 1e-12)
    u = np.clip((cross * axis_offset - sight_offset * axis2) / parallel, 0.0, 1.0)
    w = np.clip((cross * u + axis_offset) / axis2, 0.0, 1.0)
    u = np.clip((cross * w - sight_offset) / sight2, 0.0, 1.0)
    squared = offset2 + u * u * sight2 + w * w * axis2
    squared += 2.0 * (u * sight_offset - w * axis_offset - u * w * cross)
    distances: Array = np.sqrt(np.maximum(squared, 0.0))
    return distances


def under_table(centres: Array, points: Array, radius: float) -> Array:
    """Which points (C, N) lie behind the table top, a disc over the origin, for each camera."""
    drop = points[..., 2] - centres[:, None, 2]
    share = (TABLE_HEIGHT - centres[:, None, 2]) / np.where(drop == 0.0, 1e-9, drop)
    crossing = centres[:, None, :2] + share[..., None] * (points - centres[:, None])[..., :2]
    hidden: Array = (share > 0.0) & (share < 1.0) & (np.linalg.norm(crossing, axis=-1) < radius)
    return hidden
