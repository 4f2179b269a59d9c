"""2D people of another stack in bags, as messages of this one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from panoptic_ros.domain import SkeletonModel
from panoptic_ros.errors import DataError
from panoptic_ros.io.bag_connections import Connection, types_of
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.io.messages.family import bag_typestore, decode_cdr
from panoptic_ros.io.messages.rpt import KIND, skeleton_of_poses, view_of_poses


class ForeignPeople(NamedTuple):
    """What rpt_msgs/Poses of a camera do not say.

    Args:
        image_size: (width, height) px. skeleton: name of the working skeleton, or its file.
    """

    image_size: tuple[int, int]
    skeleton: str

    @classmethod
    def from_words(cls, words: Mapping[str, Any]) -> ForeignPeople:
        """Of plain words, as `_asdict` gives them."""
        width, height = words["image_size"]
        return cls((width, height), words["skeleton"])

    def model(self, bag: BagReader, topic: str) -> SkeletonModel:
        """The skeleton, as the joints of a topic's first message fill it.

        Raises:
            DataError: if that cannot be read, or its joints do not fill the skeleton.
        """
        ((_, _, data, _),) = bag.first(topic)
        return skeleton_of_poses(_poses(data, bag.connection(topic)).joint_names, self.skeleton)

    def detections(self, data: bytes, connection: Connection, camera: str, number: int) -> tuple[bytes, Any]:
        """CDR bytes of a ViewDetections, and the message, from those of a Poses.

        Args:
            connection: its topic, with the definition that the bag keeps. number: of the message.

        Raises:
            DataError: if the bag has no definition, or the people are not those of an image.
        """
        poses = _poses(data, connection)
        view = view_of_poses(poses, camera, self.image_size, number, self.skeleton)
        message = to_message(view, bag_messages())
        return bytes(bag_typestore().serialize_cdr(message, message.__msgtype__)), message


def _poses(data: bytes, connection: Connection) -> Any:
    """A message, by the definition that the bag keeps."""
    types = types_of(KIND, connection.definition)
    if types is None:
        raise DataError(f"the bag keeps no definition of {KIND}, without which it cannot be read")
    return decode_cdr(data, KIND, types)
