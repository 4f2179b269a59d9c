"""audio_common_msgs/AudioDataStamped as audio blocks, where that package is installed (it has no wheel)."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from panoptic_ros.domain import AudioBlock
from panoptic_ros.errors import DataError
from panoptic_ros.io.messages import stamp_of

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
