"""One instant, ready for the kernels."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import DetectionSet, Evidence
from panoptic_ros.solving.cameras import Cameras, Observations
from panoptic_ros.solving.evidence import RigArrays
from panoptic_ros.solving.sight import Sight, sight_of, views_of_people

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The 2D people of one instant and the V cameras that saw them.

    Args:
        evidence: the 2D people.
        precision: (D, J) 1 / standard deviation on the normalised plane, 0 = missing.
        mirror: (J,) the joint on the other side.
        cams: where the views were. centres: (V, 3) m, of the cameras in the world.
        focals: (V,) px. sight: how far the views see.
    """

    evidence: Evidence
    precision: Array
    mirror: Array
    cams: Cameras
    centres: Array
    focals: Array
    sight: Sight

    @property
    def observations(self) -> Observations:
        """The same for kernels that solve joints."""
        evidence = self.evidence
        return Observations(evidence.plane, self.precision, evidence.view, evidence.starts, self.cams)


def scene_of(
    detections: DetectionSet, evidence: Evidence, precision: Array, mirror: Array, arrays: RigArrays
) -> Scene:
    """The scene of a detection set and its evidence."""
    rows = evidence.cameras
    cams = Cameras(arrays.rotations[rows], arrays.translations[rows], evidence.delays)
    views = [detections.views[slot] for slot in evidence.slots]
    sight = sight_of(arrays.boxes[rows], [arrays.cameras[row] for row in rows], views)
    return Scene(evidence, precision, mirror, cams, arrays.centres[rows], arrays.focals[rows], sight)


def even_precision(evidence: Evidence, arrays: RigArrays, noise: float) -> Array:
    """Precisions (D, J) of 2D joints that all have one noise, as a share of the image's diagonal."""
    cameras = evidence.cameras[evidence.view]
    scale = arrays.focals[cameras] / (noise * arrays.diagonals[cameras])
    precision: Array = np.where(evidence.scores > 0.0, scale[:, None] * evidence.magnification, 0.0)
    return precision


def seeing_views(scene: Scene, positions: Array) -> Array:
    """Which views (P, V) have at least half of the joints (P, J, 3) of a person in sight."""
    seeing: Array = views_of_people(
        positions, scene.cams.rotations, scene.cams.translations, scene.sight
    )  # fmt: skip
    return seeing
