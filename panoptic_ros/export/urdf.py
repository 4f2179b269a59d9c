"""Write a body as URDF: three successive revolute joints for every joint, named like its joint angles."""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain.body_names import joint_names, link_names
from panoptic_ros.domain.body_shape import BodyShape, Capsule

Array = np.ndarray
AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
STRONG, QUICK = 1000.0, 20.0  # limits that URDF requires: effort N m, velocity rad/s


def urdf_text(shape: BodyShape, offsets: Array, body: str, colour: tuple[float, float, float]) -> str:
    """Return the URDF of a body; its joint angles are those of `SegmentModel.joint_angles`.

    Args:
        offsets: (S, 3) m, joints in the frames of their parents.
        body: its REP-155 id, e.g. "p4".
        colour: red, green, blue, 0 to 1.
    """
    model = shape.model
    links, angles = link_names(model, body), joint_names(model, body)
    own: dict[int, list[Capsule]] = {}
    for capsule in shape.capsules(offsets):
        own.setdefault(capsule.segment, []).append(capsule)
    colours = " ".join(f"{value:.3f}" for value in colour)
    lines = [
        '<?xml version="1.0"?>',
        f'<robot name="human_{body}">',
        f'  <material name="skin"><color rgba="{colours} 1"/></material>',
    ]
    for s, link in enumerate(links):
        lines += _link(link, own.get(s, []))
        if s == 0:
            continue
        above, place = links[model.parents[s]], offsets[s]
        for k, axis in enumerate(model.orders[s]):
            joint = angles[3 * (s - 1) + k]
            below = link if k == 2 else f"hinge_{joint}"
            lines += [] if k == 2 else [f'  <link name="{below}"/>']
            lines += [
                f'  <joint name="{joint}" type="revolute">',
                f'    <parent link="{above}"/>',
                f'    <child link="{below}"/>',
                f'    <origin xyz="{_numbers(place)}" rpy="0 0 0"/>',
                f'    <axis xyz="{AXES[axis]}"/>',
                f'    <limit lower="{-np.pi:.6f}" upper="{np.pi:.6f}" effort="{STRONG:g}" '
                f'velocity="{QUICK:g}"/>',
                "  </joint>",
            ]
            above, place = below, np.zeros(3)
    return "\n".join([*lines, "</robot>"]) + "\n"


def _link(name: str, capsules: list[Capsule]) -> list[str]:
    """Return a link; a capsule becomes two spheres and a cylinder, because URDF has no capsules."""
    if not capsules:
        return [f'  <link name="{name}"/>']
    lines = [f'  <link name="{name}">']
    for capsule in capsules:
        arm = capsule.end - capsule.begin
        length = float(np.linalg.norm(arm))
        for place, radius in zip((capsule.begin, capsule.end), capsule.radii):
            lines += _visual(place, np.zeros(3), f'<sphere radius="{radius:.5f}"/>')
        if length > 1e-6:
            x, y, z = arm / length
            # rotation from z to the capsule axis: roll -asin(y), then pitch atan2(x, z)
            turn = np.array([-np.arcsin(np.clip(y, -1, 1)), np.arctan2(x, z), 0.0])
            radius = 0.5 * sum(capsule.radii)
            middle = 0.5 * (capsule.begin + capsule.end)
            lines += _visual(middle, turn, f'<cylinder radius="{radius:.5f}" length="{length:.5f}"/>')
    return [*lines, "  </link>"]


def _visual(place: Array, turn: Array, form: str) -> list[str]:
    origin = f'<origin xyz="{_numbers(place)}" rpy="{_numbers(turn)}"/>'
    return [f'    <visual>{origin}<geometry>{form}</geometry><material name="skin"/></visual>']


def _numbers(values: Array) -> str:
    return " ".join(f"{value:.9g}" for value in values)
