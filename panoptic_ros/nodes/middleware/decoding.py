"""Records from messages, by the topic that they come on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import depth_frame_from_message, frame_from_message, from_message
from panoptic_ros.io.messages.bodies import imu_of_numbers, read_imu
from panoptic_ros.nodes.middleware.audio_common import AudioDataReader
from panoptic_ros.nodes.middleware.packets import numbers_of, stamp_in

Decoder = Callable[[Any, int], Any]  # (message, how many came before it): the record
PackedDecoder = Callable[[bytes], Any]  # bytes of a message: the record; None: take the message itself
IMU_NUMBERS = 37  # of a sensor_msgs/Imu


def decoder_of(
    topic: str, owner: str, audio_rate: int, audio_channels: int, encoding: str = ""
) -> Decoder:
    """What makes records of the messages of a topic of a camera or device.

    Args:
        topic: key of `TOPICS`.
        audio_rate, audio_channels: of messages that do not tell, Hz.
        encoding: of raw images, in place of what their messages say.
    """
    record = TOPICS[topic].record
    if record == "ViewFrame":
        return lambda message, number: frame_from_message(message, owner, number, encoding)
    if record == "DepthFrame":
        return lambda message, number: depth_frame_from_message(message, owner, number)
    if record == "ImuSample":
        return lambda message, number: read_imu(message, owner)
    if topic == "audio_common":
        reader = AudioDataReader(owner, audio_rate, audio_channels)
        return lambda message, number: reader.block(message)
    return lambda message, number: from_message(message, record)


def packed_decoder_of(topic: str, owner: str) -> PackedDecoder | None:
    """What makes records of the bytes of messages, for topics of which there are thousands a second."""
    if TOPICS[topic].record != "ImuSample":
        return None

    def sample(data: bytes) -> Any:
        numbers = numbers_of(data, IMU_NUMBERS)
        return None if numbers is None else imu_of_numbers(numbers, stamp_in(data), owner)

    return sample
