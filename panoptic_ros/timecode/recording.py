"""Decode the timecode of a whole recording.

Every word of a signal gets the frame rate of the signal's last word.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import TimecodeReading
from panoptic_ros.errors import DataError
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.decoder import LtcDecoder
from panoptic_ros.timecode.follow.reading import Word
from panoptic_ros.timecode.label.counting import with_rate

Array = np.ndarray
PIECE_SECONDS = 1.0


def decode_recording(
    config: TimecodeConfig, device: str, sample_rate: int, samples: Array, stamp_ns: int = 0
) -> list[TimecodeReading]:
    """Decode the timecode of a whole recording.

    Args:
        samples: (N,) samples of one channel; the first sample is at `stamp_ns`.

    Returns: all readings, in recording order.

    Raises:
        DataError: a sample is not finite.
    """
    if not np.isfinite(samples).all():
        raise DataError(f"audio of {device} has samples that are not finite")
    decoder = LtcDecoder(config, sample_rate)
    piece = int(PIECE_SECONDS * sample_rate)
    words: list[Word] = []
    for first in range(0, len(samples), piece):
        words += decoder.push(samples[first : first + piece])
    words += decoder.finish()
    rates = {word.signal: word.timecode.rate for word in words}
    readings = []
    for word in words:
        stamp = max(0, stamp_ns + round(word.start / sample_rate * 1e9))
        label = with_rate(word.timecode, rates[word.signal])
        readings.append(
            TimecodeReading(device, stamp, label, word.start, word.std, word.reverse, word.user_bits)
        )
    return readings
