"""Decodes and encodes linear timecode (LTC) in WAV files and videos."""

from __future__ import annotations

import re
from pathlib import Path

from panoptic_ros.capture.sound import read_sound
from panoptic_ros.domain import FrameRate, Timecode, TimecodeReading
from panoptic_ros.errors import UsageError
from panoptic_ros.io.wav import write_wav
from panoptic_ros.simulation.ltc_signal import encode_ltc, timecode_rate
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.recording import decode_recording


def decode_file(path: Path, channel: int = 0) -> tuple[int, list[TimecodeReading]]:
    """Return the sample rate, Hz, and all timecode readings of a channel.

    Args:
        path: WAV file, or another file with a sound track.
        channel: index of the channel.

    Raises:
        UserError: if the file cannot be read, or has no such channel.
    """
    sample_rate, samples = read_sound(path, channel)
    return sample_rate, decode_recording(TimecodeConfig(), path.stem, sample_rate, samples)


def encode_file(
    path: Path,
    start: str,
    rate: str,
    *,
    seconds: float,
    sample_rate: int = 48000,
    user_bits: str = "00000000",
    reverse: bool = False,
) -> tuple[int, Timecode, Timecode]:
    """Write a WAV file with timecode; return the number of words, the first label and the last label.

    Args:
        start: first label, HH:MM:SS:FF, or HH:MM:SS;FF for drop-frame.
        rate: frames per second: 23.976, 24, 25, 29.97, 29.97df (drop-frame) or 30.
        seconds: length, s.
        sample_rate: Hz.
        user_bits: 8 hex digits, group 8 first.
        reverse: write the signal of a tape that runs backwards.

    Raises:
        UsageError: on impossible values.
        ClockError: if the rate has no such label.
        EnvironmentProblem: if the file cannot be written.
    """
    first = parse_timecode(start, timecode_rate(rate))
    if not re.fullmatch(r"[0-9a-fA-F]{8}", user_bits):
        raise UsageError(f"--user-bits {user_bits!r} are not 8 hex digits")
    if not (0.0 < seconds <= 36000.0 and 4000 <= sample_rate <= 400_000):
        raise UsageError(f"cannot make {seconds} s of timecode at {sample_rate} Hz")
    words = max(1, round(seconds * float(first.rate.exact)))
    signal = encode_ltc(first, words, sample_rate, user_bits=int(user_bits, 16), reverse=reverse)
    write_wav(path, sample_rate, signal.samples)
    return words, signal.labels[0], signal.labels[-1]


def parse_timecode(text: str, rate: FrameRate) -> Timecode:
    """Parse a timecode label. A semicolon before the frames means drop-frame.

    Raises:
        UsageError: if the text is not a label.
        ClockError: if the rate has no such label.
    """
    match = re.fullmatch(r"(\d\d):(\d\d):(\d\d)([:;])(\d\d)", text)
    if match is None:
        raise UsageError(f"{text!r} is not a timecode; write HH:MM:SS:FF")
    if match.group(4) == ";":
        rate = FrameRate(rate.nominal, rate.exact, True)
    hours, minutes, seconds, frames = (int(match.group(i)) for i in (1, 2, 3, 5))
    return Timecode(hours, minutes, seconds, frames, rate)
