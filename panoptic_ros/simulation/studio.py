"""Simulated people in a given rig, for studies of real camera arrangements."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.geometry import Rigid
from panoptic_ros.simulation.degradation import NOISY, Degradation
from panoptic_ros.simulation.scenes import SimulatedScene
from panoptic_ros.simulation.timing import Timing

Array = np.ndarray
ACTIVITIES = ("walk", "turn", "talk", "reach", "crouch", "wave", "talk")
RATE = 25.0  # Hz; frame rate


@dataclass(frozen=True, eq=False)
class GivenRig:
    """Rig plan that returns a given rig."""

    rig: Rig

    def build(self, rng: np.random.Generator) -> Rig:
        """Return the cameras."""
        return self.rig

    def __repr__(self) -> str:  # seeds derive from this text
        return f"GivenRig({self.rig.names})"


def study_scene(rig: Rig, people: int, area: float, faults: Degradation) -> SimulatedScene:
    """Return a scene of `people` persons who move within `area` m of the middle of a rig."""
    activities = tuple(np.resize(ACTIVITIES, people).tolist())
    plan = GivenRig(centred(rig))
    return SimulatedScene("study", activities, plan, area=area, degradation=faults, timing=Timing(rate=RATE))


def relative_noise(share: float) -> Degradation:
    """Return all faults of a detector, with noise proportional to the diagonal of a person's box.

    Networks see people scaled to about one size, so their errors grow with the person's size in the image.
    The detector limits the growth to people of 0.4 to 3 times 250 px.

    Args:
        share: Standard deviation of the noise / diagonal of the box.
    """
    return replace(NOISY, noise_px=250.0 * share, size_px=250.0, outlier_px=20.0)


def centred(rig: Rig) -> Rig:
    """Return the rig in a world whose origin lies under the point that the cameras look at.

    Heights (z) are unchanged.
    """
    centres = np.array([camera.centre for camera in rig.cameras])
    axes = np.array([camera.cam_from_world.rotation[2] for camera in rig.cameras])
    aside = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    # prior for the focus; it decides where all cameras look in the same direction
    ahead = (centres + 2.0 * axes).mean(axis=0)
    normal = aside.sum(axis=0) + 1e-3 * len(rig) * np.eye(3)
    focus = np.linalg.solve(normal, np.einsum("cij,cj->i", aside, centres) + 1e-3 * len(rig) * ahead)
    shift = Rigid(np.eye(3), np.array([focus[0], focus[1], 0.0]))  # old world from new
    return Rig(
        tuple(replace(c, cam_from_world=c.cam_from_world.compose(shift)) for c in rig.cameras), rig.frame_id
    )


def scaled(camera: Camera, factor: float) -> Camera:
    """Return the same camera with images of `factor` times the width and height."""
    shift = 0.5 * factor - 0.5
    change = np.array([[factor, 0.0, shift], [0.0, factor, shift], [0.0, 0.0, 1.0]])
    lens = camera.intrinsics
    width, height = (round(side * factor) for side in camera.image_size)
    return replace(camera, image_size=(width, height), intrinsics=replace(lens, matrix=change @ lens.matrix))


def nearest_pairs(first: Rig, second: Rig, count: int) -> tuple[Rig, Rig]:
    """Return `count` cameras of each rig, paired one to one by smallest distance.

    Pairs are chosen greedily, the closest pair first.
    """
    ours, theirs = (np.array([c.centre for c in rig.cameras]) for rig in (first, second))
    gaps = np.linalg.norm(ours[:, None] - theirs[None], axis=-1)
    pairs: list[tuple[int, int]] = []
    for flat in np.argsort(gaps, axis=None, kind="stable"):
        i, k = divmod(int(flat), len(theirs))
        if i not in {a for a, _ in pairs} and k not in {b for _, b in pairs}:
            pairs.append((i, k))
        if len(pairs) == count:
            break
    names = [(first.names[i], second.names[k]) for i, k in pairs]
    return first.subset(a for a, _ in names), second.subset(b for _, b in names)
