"""Records from messages, by the topic that they come on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import depth_frame_from_message, frame_from_message, from_message
from panoptic_ros.io.messages.bodies import read_imu
from panoptic_ros.nodes.audio_common import AudioDataReader

Decoder = Callable[[Any, int], Any]  # (message, how many came before it): the record


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
