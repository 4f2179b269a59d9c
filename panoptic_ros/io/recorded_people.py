"""Read recorded 2D poses from plain files, in the joints of a skeleton model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from panoptic_ros.domain import DetectionSet, Rig, SkeletonModel
from panoptic_ros.io.plain_formats import PlainDetections, read_detections
from panoptic_ros.io.skeletons import DEFAULT_SKELETON, fullest_skeleton, map_joints, skeleton_of

AUTO = "auto"  # skeleton option: the one that uses most joints of the file; panoptic19 for COCO joints


@dataclass(frozen=True)
class RecordedPeople:
    """2D poses of several cameras.

    Args:
        sets: in order of time.
        joint_names: names of the skeleton's joints. They follow the file's spelling if the skeleton was
            chosen automatically.
        left_out: joints of the file that the skeleton does not use.
    """

    skeleton: SkeletonModel
    sets: Sequence[DetectionSet]
    joint_names: tuple[str, ...]
    left_out: tuple[str, ...] = ()

    def told(self) -> list[str]:
        """Return a notice if joints of the file are left out."""
        if not self.left_out:
            return []
        joints = ", ".join(self.left_out)
        return [f"joints that are not in skeleton {self.skeleton.name} are left out: {joints}"]


def read_people(detections: Path, rig: Rig, skeleton: str = AUTO, any_order: bool = False) -> RecordedPeople:
    """Read the 2D poses of a plain file.

    Args:
        rig: the cameras that are used; the cameras in `rig.left_out` may occur in the file.
        skeleton: name or YAML file, or `AUTO`.
        any_order: accept timestamps that decrease.

    Raises:
        UserError: on any error that the user can correct.
    """
    people = read_detections(detections)
    model, joint_map = map_joints(_choose(people) if skeleton == AUTO else skeleton, people.joint_names)
    sets = list(people.sets(rig, joint_map, model.hash, any_order=any_order))
    names = _own_names(people, model.joint_names) if skeleton == AUTO else model.joint_names
    used = {k for source in joint_map.sources for k in source}
    left_out = tuple(name for k, name in enumerate(people.joint_names) if k not in used)
    return RecordedPeople(model, sets, names, left_out)


def _choose(detections: PlainDetections) -> str:
    """Return the installed skeleton that the joints of the file fill and that uses most of them.

    The default is panoptic19. It also replaces coco17, because it adds joints derived from COCO's.
    """
    names = detections.joint_names
    found = skeleton_of(names) or fullest_skeleton(names)
    return DEFAULT_SKELETON if found in (None, "coco17") else found


def _own_names(detections: PlainDetections, joints: tuple[str, ...]) -> tuple[str, ...]:
    """Return the joint names of the automatically chosen skeleton.

    They have the spelling of the file if its joints map one to one.
    """
    _, mapping = map_joints(_choose(detections), detections.joint_names)
    return tuple(
        detections.joint_names[s[0]]
        if len(s) == 1 and len(mapping.sources) == len(detections.joint_names)
        else joint
        for joint, s in zip(joints, mapping.sources)
    )
