"""Decoders from ROS messages to records, selected by topic.

audio_common_msgs/AudioDataStamped is decoded to audio blocks where that package is installed (it has no
wheel).
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
GAP_S = 0.25  # s; a timestamp this much later than the sample count predicts means that samples were lost
SECOND = 1_000_000_000


def audio_common_class() -> Any | None:
    """Return the class AudioDataStamped; None if its package is not installed."""
    try:
        return importlib.import_module("audio_common_msgs.msg").AudioDataStamped
    except ImportError:
        return None


class AudioDataReader:
    """Decoder of audio messages of one device into blocks.

    The messages hold 16-bit little-endian samples without a sample count.

    Args:
        sample_rate, channels: of the device, Hz and count. The messages do not contain them.
    """

    def __init__(self, device: str, sample_rate: int, channels: int):
        self._device = device
        self._rate = sample_rate
        self._channels = channels
        self._next = 0
        self._expected_ns: int | None = None

    def block(self, message: Any) -> AudioBlock:
        """Return the audio block of a message, with all channels.

        Raises:
            DataError: if the data length is not a whole number of samples.
        """
        data = bytes(message.audio.data)
        width = 2 * self._channels
        if len(data) % width:
            raise DataError(
                f"audio of {self._device}: {len(data)} bytes are not a whole number of 16-bit samples of "
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


Decoder = Callable[[Any, int], Any]  # (message, number of earlier messages) -> record
# bytes of a message -> record; None: decode the message object instead
PackedDecoder = Callable[[bytes], Any]
IMU_NUMBERS = 37  # float64 values of a sensor_msgs/Imu behind its header
LOOKS = 30  # images whose encoding is checked; the first ones of a camera may be too dark for a check


def decoder_of(
    topic: str,
    owner: str,
    audio_rate: int,
    audio_channels: int,
    encoding: str = "",
    tell: Callable[[str], None] | None = None,
) -> Decoder:
    """Return the decoder for messages of a topic of a camera or device.

    Args:
        topic: Key of `TOPICS`.
        audio_rate, audio_channels: For audio messages that do not contain them, Hz and count.
        encoding: Encoding of raw images; overrides the one that the messages state.
        tell: Called once with a line if the first raw images have another encoding than they state, or if one
            is assumed. All images are then decoded with that encoding. None: images are decoded as they
            state.
    """
    record = TOPICS[topic].record
    if record == "ViewFrame":
        return _ImageDecoder(owner, encoding, tell)
    if record == "DepthFrame":
        return lambda message, number: depth_frame_from_message(message, owner, number)
    if record == "ImuSample":
        return lambda message, number: read_imu(message, owner)
    if topic == "audio_common":
        reader = AudioDataReader(owner, audio_rate, audio_channels)
        return lambda message, number: reader.block(message)
    return lambda message, number: from_message(message, record)


class _ImageDecoder:
    """Decoder of images of one camera; see `decoder_of`."""

    def __init__(self, owner: str, encoding: str, tell: Callable[[str], None] | None):
        self._owner, self._encoding, self._tell = owner, encoding, tell
        self._looks = 0 if encoding or tell is None else LOOKS

    def __call__(self, message: Any, number: int) -> ViewFrame:
        if self._looks and hasattr(message, "encoding"):
            self._look(message)
        return frame_from_message(message, self._owner, number, self._encoding)

    def _look(self, message: Any) -> None:
        """Detect the encoding of an image from its content, and report it once if it differs."""
        self._looks -= 1
        with suppress(DataError):  # ignored here: decoding the frame raises it again
            shown = shown_by(message, f"image of camera {self._owner}")
            if shown is not None:
                self._looks, self._encoding = 0, shown.encoding
                if shown.told and self._tell is not None:
                    self._tell(shown.told)


def packed_decoder_of(topic: str, owner: str) -> PackedDecoder | None:
    """Return a decoder that works on message bytes, for topics with thousands of messages per second.

    Returns:
        the decoder; None for topics other than IMUs.
    """
    if TOPICS[topic].record != "ImuSample":
        return None

    def sample(data: bytes) -> Any:
        numbers = numbers_of(data, IMU_NUMBERS)
        return None if numbers is None else imu_of_numbers(numbers, stamp_in(data), owner)

    return sample
