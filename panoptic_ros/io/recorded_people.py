"""2D people of a recording in the joints of a skeleton model, from plain files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from panoptic_ros.domain import DetectionSet, Rig, SkeletonModel
from panoptic_ros.io.plain_formats import PlainDetections, read_detections
from panoptic_ros.io.skeletons import DEFAULT_SKELETON, fullest_skeleton, map_joints, skeleton_of

AUTO = "auto"  # skeleton: that which takes most joints of the detections; panoptic19 for COCO's


@dataclass(frozen=True)
class RecordedPeople:
    """2D people of some cameras.

    Args:
        sets: in the order of time.
        joint_names: of the skeleton's joints, as the file spells them where the skeleton was chosen after it.
        left_out: joints of the file that no joint of the skeleton is made of.
    """

    skeleton: SkeletonModel
    sets: Sequence[DetectionSet]
    joint_names: tuple[str, ...]
    left_out: tuple[str, ...] = ()

    def told(self) -> list[str]:
        """Return a line if joints are left out."""
        if not self.left_out:
            return []
        joints = ", ".join(self.left_out)
        return [f"joints that are not in skeleton {self.skeleton.name} are left out: {joints}"]


def read_people(detections: Path, rig: Rig, skeleton: str = AUTO) -> RecordedPeople:
    """The 2D people of a plain file.

    Args:
        rig: the cameras that are used; those that it leaves out may occur in the file.
        skeleton: name or YAML file, or `AUTO`.

    Raises:
        UserError: on whatever the user can mend.
    """
    people = read_detections(detections)
    model, joint_map = map_joints(_choose(people) if skeleton == AUTO else skeleton, people.joint_names)
    sets = list(people.sets(rig, joint_map, model.hash))
    names = _own_names(people, model.joint_names) if skeleton == AUTO else model.joint_names
    used = {k for source in joint_map.sources for k in source}
    left_out = tuple(name for k, name in enumerate(people.joint_names) if k not in used)
    return RecordedPeople(model, sets, names, left_out)


def _choose(detections: PlainDetections) -> str:
    """Return the installed skeleton that the joints of the file fill and that uses most of them.

    Without one it is panoptic19. COCO's joints also give panoptic19, which adds joints derived from them.
    """
    names = detections.joint_names
    found = skeleton_of(names) or fullest_skeleton(names)
    return DEFAULT_SKELETON if found in (None, "coco17") else found


def _own_names(detections: PlainDetections, joints: tuple[str, ...]) -> tuple[str, ...]:
    """The joints as the detections spell them, where the skeleton was chosen after them."""
    _, mapping = map_joints(_choose(detections), detections.joint_names)
    return tuple(
        detections.joint_names[s[0]]
        if len(s) == 1 and len(mapping.sources) == len(detections.joint_names)
        else joint
        for joint, s in zip(joints, mapping.sources)
    )
