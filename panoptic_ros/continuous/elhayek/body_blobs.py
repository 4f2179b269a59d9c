"""Body of a person as blobs on the bones, coloured from images of a known pose (paper, 4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from panoptic_ros.continuous.elhayek.quad_tree import ImageBlobs
from panoptic_ros.continuous.elhayek.skeleton import HingeSkeleton
from panoptic_ros.domain.body_shape import BodyShape
from panoptic_ros.domain.rig_arrays import RigArrays

Array = np.ndarray
APART = 1.4  # distance of the blobs along a bone, in radii
WIDE = 1.2  # width of a capsule over its depth, above which it becomes two rows of blobs side by side
# Standard deviation of a blob in radii: with blobs so far apart, image blobs of its colour reach their
# self-similarity up to the surface, see `image_term.similarity`.
SIGMA = 0.6
COVERED = 0.8  # radii about the centre of a blob in front, within which it hides another blob
SAMPLED = 0.6  # radii about the centre of a blob, within which image blobs tell its colour
LEAST_SAMPLES = 2  # minimum number of views that tell the colour of a blob


class TimedBlobs(NamedTuple):
    """Blobs of one image, its time (s) and its camera."""

    time: float
    camera: int
    blobs: ImageBlobs


@dataclass(frozen=True, eq=False)
class BodyBlobs:
    """N blobs of a person.

    Args:
        segments: (N,) segment of the skeleton.
        offsets: (N, 3) m in its frame.
        radii: (N,) m.
        colours: (N, 3), see `quad_tree.colours_of`.
    """

    segments: Array
    offsets: Array
    radii: Array
    colours: Array


def body_blobs(skeleton: HingeSkeleton, shape: BodyShape) -> BodyBlobs:
    """Return the blobs of a person, without colours: spheres in a row in every capsule of the shape."""
    rows = []
    for capsule in shape.capsules(skeleton.offsets):
        radius, bone = 0.5 * sum(capsule.radii), capsule.end - capsule.begin
        count = max(2, round(float(np.linalg.norm(bone)) / (APART * radius)) + 1)
        aside = max(capsule.wide - 1.0, 0.0) * radius if capsule.wide > WIDE else 0.0
        for share in np.linspace(0.0, 1.0, count):
            own = capsule.radii[0] + share * (capsule.radii[1] - capsule.radii[0])
            for side in (-aside, aside) if aside else (0.0,):
                rows.append((capsule.segment, capsule.begin + share * bone + [0.0, side, 0.0], own))
    segments, offsets, radii = (np.array(column) for column in zip(*rows))
    return BodyBlobs(segments, offsets, radii, np.zeros((len(rows), 3)))


def coloured(
    body: BodyBlobs, skeleton: HingeSkeleton, poses: Array, images: Sequence[TimedBlobs], arrays: RigArrays
) -> BodyBlobs:
    """Return the blobs that some views show, with the median of the colours seen there.

    Args:
        poses: (T, D) poses at the times of the images (T).
    """
    points = skeleton.place(poses).points(body.segments, body.offsets)
    samples: list[list[Array]] = [[] for _ in body.radii]
    for place, (_, camera, blobs) in zip(points, images):
        local = place @ arrays.rotations[camera].T + arrays.translations[camera]
        for n in np.flatnonzero(_visible(local, body.radii)):
            gaps = np.linalg.norm(blobs.means - local[n, :2] / local[n, 2], axis=1)
            near = gaps < SAMPLED * body.radii[n] / local[n, 2]
            if near.any():
                samples[n].append(np.average(blobs.colours[near], axis=0, weights=blobs.sigmas[near] ** 2))
    known = np.array([len(own) >= LEAST_SAMPLES for own in samples])
    colours = np.array([np.median(own, axis=0) for own, good in zip(samples, known) if good]).reshape(-1, 3)
    return BodyBlobs(body.segments[known], body.offsets[known], body.radii[known], colours)


def _visible(local: Array, radii: Array) -> Array:
    """Return which spheres (N,) no other one hides.

    Args:
        local: (N, 3) m, centres in the camera's frame.
    """
    plane = local[:, :2] / local[:, 2:]
    gaps = np.linalg.norm(plane[:, None] - plane[None], axis=-1)
    over = gaps < COVERED * (radii / local[:, 2])[None]
    front = local[None, :, 2] + radii[None] < local[:, None, 2]
    found: Array = (local[:, 2] > 0.0) & ~(over & front).any(axis=1)
    return found
