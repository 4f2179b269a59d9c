"""Convert 2D poses of another software stack in bags (rpt_msgs/Poses) to this project's messages."""

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
    """Data of a camera that rpt_msgs/Poses lacks.

    Args:
        image_size: (width, height) px.
        skeleton: name of the working skeleton, or its file.
    """

    image_size: tuple[int, int]
    skeleton: str

    @classmethod
    def from_words(cls, words: Mapping[str, Any]) -> ForeignPeople:
        """Build from a plain dictionary, the inverse of `_asdict`."""
        width, height = words["image_size"]
        return cls((width, height), words["skeleton"])

    def model(self, bag: BagReader, topic: str) -> SkeletonModel:
        """Return the skeleton model; the joints of the topic's first message must fill it.

        Raises:
            DataError: if the message cannot be read, or its joints do not fill the skeleton.
        """
        ((_, _, data, _),) = bag.first(topic)
        return skeleton_of_poses(_poses(data, bag.connection(topic)).joint_names, self.skeleton)

    def detections(self, data: bytes, connection: Connection, camera: str, number: int) -> tuple[bytes, Any]:
        """Convert a Poses message to ViewDetections; return its CDR bytes and the message.

        Args:
            connection: topic with the message definition from the bag.
            number: number of the message, used as frame number.

        Raises:
            DataError: if the bag has no definition, or the poses are not 2D poses of an image.
        """
        poses = _poses(data, connection)
        view = view_of_poses(poses, camera, self.image_size, number, self.skeleton)
        message = to_message(view, bag_messages())
        return bytes(bag_typestore().serialize_cdr(message, message.__msgtype__)), message


def _poses(data: bytes, connection: Connection) -> Any:
    """Decode a Poses message with the definition that the bag stores."""
    types = types_of(KIND, connection.definition)
    if types is None:
        raise DataError(f"the bag keeps no definition of {KIND}, without which it cannot be read")
    return decode_cdr(data, KIND, types)
