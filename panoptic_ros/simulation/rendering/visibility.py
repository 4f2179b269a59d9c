"""Which joints an image really shows."""
from __future__ import annotations

import numpy as np

from panoptic_ros.domain import Camera
from panoptic_ros.simulation.rendering.renderer import RenderedView

Array = np.ndarray


def visible_joints(view: RenderedView, camera: Camera, joints: Array, slack: float = 0.16) -> Array:
    """Which joints (P, J, 3) m of the take's people are visible, (P, J).

    The joint's pixel belongs to its person, and the surface there is at most `slack` m in front of
    the joint, which lies inside of the limb.
    """
    pixels, seen = camera.project(joints)
    seen = seen & camera.contains(pixels)
    height, width = view.depth.shape
    columns = np.clip(np.rint(np.nan_to_num(pixels[..., 0])), 0, width - 1).astype(int)
    rows = np.clip(np.rint(np.nan_to_num(pixels[..., 1])), 0, height - 1).astype(int)
    own = view.people[rows, columns] == np.arange(1, len(joints) + 1)[:, None]
    depth = camera.cam_from_world.apply(joints)[..., 2]
    visible: Array = seen & own & (view.depth[rows, columns] > depth - slack)
    return visible
