"""Rigid parts of a body, from the names of a skeleton's joints.

The joints of the torso form one part, those of the head another. Every other bone between shoulder and wrist
or between hip and ankle is a part of its own. Sizes are those of an adult (Winter 2009, table 4.1, and
anthropometry of girths). They serve only to start the search for the surface.
"""

from __future__ import annotations

from typing import NamedTuple

from panoptic_ros.domain.skeleton import SkeletonModel

TORSO_WORDS = ("neck", "shoulder", "hip", "bodycenter")
HEAD_WORDS = ("nose", "eye", "ear", "head")
# radius and length in m of limbs between joints with these names
LIMBS = {
    ("shoulder", "elbow"): (0.05, 0.29),
    ("elbow", "wrist"): (0.04, 0.26),
    ("hip", "knee"): (0.075, 0.43),
    ("knee", "ankle"): (0.05, 0.42),
}
TORSO_RADIUS, HEAD_RADIUS, HEAD_LENGTH = 0.12, 0.09, 0.2  # m


class Part(NamedTuple):
    """One rigid part of the body.

    Args:
        name: Name of the part.
        joints: Its joints; a limb has the two that span it.
        radius: m.
        length: m, 0 = unknown.
    """

    name: str
    joints: tuple[int, ...]
    radius: float
    length: float

    @property
    def is_limb(self) -> bool:
        """Return whether the part is a limb, spanned by two joints."""
        return self.name not in ("torso", "head")


def rigid_parts(skeleton: SkeletonModel) -> tuple[Part, ...]:
    """Return the parts of a skeleton: torso, head and limbs, as far as the skeleton has their joints."""
    names = [name.lower() for name in skeleton.joint_names]
    torso = tuple(j for j, name in enumerate(names) if any(word in name for word in TORSO_WORDS))
    head = tuple(j for j, name in enumerate(names) if any(word in name for word in HEAD_WORDS))
    found = []
    if len(torso) >= 3:
        found.append(Part("torso", torso, TORSO_RADIUS, 0.0))
    if head:
        found.append(Part("head", head, HEAD_RADIUS, 0.0))
    for a, b in skeleton.bones:
        for (upper, lower), (radius, length) in LIMBS.items():
            for one, other in ((a, b), (b, a)):
                if upper in names[one] and lower in names[other] and _side(names[one]) == _side(names[other]):
                    name = f"{skeleton.joint_names[one]}-{skeleton.joint_names[other]}"
                    found.append(Part(name, (one, other), radius, length))
    return tuple(found)


def _side(name: str) -> str:
    return "l" if name.startswith("l") else "r"
