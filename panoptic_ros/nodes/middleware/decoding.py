"""Records from messages, by the topic that they come on.

audio_common_msgs/AudioDataStamped as audio blocks, where that package is installed (it has no wheel).
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from panoptic_ros.domain import AudioBlock, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import depth_frame_from_message, frame_from_message, from_message, stamp_of
from panoptic_ros.io.messages.encodings import shown_by
from panoptic_ros.io.messages.sensors import imu_of_numbers, read_imu
from panoptic_ros.nodes.middleware.packets import numbers_of, stamp_in

TOPIC = "{device}/audio_stamped"
GAP_S = 0.25  # a stamp so much later than the samples so far tells that some were lost
SECOND = 1_000_000_000


def audio_common_class() -> Any | None:
    """The message's class, None where the package is not installed."""
    try:
        return importlib.import_module("audio_common_msgs.msg").AudioDataStamped
    except ImportError:
        return None


class AudioDataReader:
    """Turns the messages of one device into blocks. They carry 16-bit little-endian samples without a count.

    Args:
        sample_rate, channels: of the device, as the messages do not tell.
    """

    def __init__(self, device: str, sample_rate: int, channels: int):
        self._device = device
        self._rate = sample_rate
        self._channels = channels
        self._next = 0
        self._expected_ns: int | None = None

    def block(self, message: Any) -> AudioBlock:
        """The block of a message, with all channels.

        Raises:
            DataError: if its length is no whole number of samples.
        """
        data = bytes(message.audio.data)
        width = 2 * self._channels
        if len(data) % width:
            raise DataError(
                f"audio of {self._device}: {len(data)} bytes are no whole number of 16-bit samples of "
                f"{self._channels} channels; set audio_channels"
            )
        stamp = stamp_of(message.header)
        samples = np.frombuffer(data, "<i2").reshape(-1, self._channels).astype(np.float32) / 32768.0
        if self._expected_ns is not None and stamp - self._expected_ns > GAP_S * SECOND:
            self._next += round((stamp - self._expected_ns) / SECOND * self._rate)
        block = AudioBlock(self._device, stamp, self._next, self._rate, samples)
        self._next += len(samples)
        self._expected_ns = stamp + round(SECOND * len(samples) / self._rate)
        return block


Decoder = Callable[[Any, int], Any]  # (message, how many came before it): the record
PackedDecoder = Callable[[bytes], Any]  # bytes of a message: the record; None: take the message itself
IMU_NUMBERS = 37  # of a sensor_msgs/Imu
LOOKS = 30  # images, of which one at least has details; cameras begin with dark ones


def decoder_of(
    topic: str,
    owner: str,
    audio_rate: int,
    audio_channels: int,
    encoding: str = "",
    tell: Callable[[str], None] | None = None,
) -> Decoder:
    """What makes records of the messages of a topic of a camera or device.

    Args:
        topic: key of `TOPICS`.
        audio_rate, audio_channels: of messages that do not tell, Hz.
        encoding: of raw images, in place of what their messages say.
        tell: called once with a line, where the first raw images show another encoding than they state, or
            one is assumed; all are taken so. None: images are taken as they state.
    """
    record = TOPICS[topic].record
    if record == "ViewFrame":
        return _Images(owner, encoding, tell)
    if record == "DepthFrame":
        return lambda message, number: depth_frame_from_message(message, owner, number)
    if record == "ImuSample":
        return lambda message, number: read_imu(message, owner)
    if topic == "audio_common":
        reader = AudioDataReader(owner, audio_rate, audio_channels)
        return lambda message, number: reader.block(message)
    return lambda message, number: from_message(message, record)


class _Images:
    """Frames of a camera; see `decoder_of`."""

    def __init__(self, owner: str, encoding: str, tell: Callable[[str], None] | None):
        self._owner, self._encoding, self._tell = owner, encoding, tell
        self._looks = 0 if encoding or tell is None else LOOKS

    def __call__(self, message: Any, number: int) -> ViewFrame:
        if self._looks and hasattr(message, "encoding"):
            self._look(message)
        return frame_from_message(message, self._owner, number, self._encoding)

    def _look(self, message: Any) -> None:
        """Look at the encoding that an image shows."""
        self._looks -= 1
        with suppress(DataError):  # which the frame raises again
            shown = shown_by(message, f"image of camera {self._owner}")
            if shown is not None:
                self._looks, self._encoding = 0, shown.encoding
                if shown.told and self._tell is not None:
                    self._tell(shown.told)


def packed_decoder_of(topic: str, owner: str) -> PackedDecoder | None:
    """What makes records of the bytes of messages, for topics of which there are thousands a second."""
    if TOPICS[topic].record != "ImuSample":
        return None

    def sample(data: bytes) -> Any:
        numbers = numbers_of(data, IMU_NUMBERS)
        return None if numbers is None else imu_of_numbers(numbers, stamp_in(data), owner)

    return sample
