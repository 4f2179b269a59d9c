"""Robustness of the decoder: exceptions, unusable deviations and wrong labels in randomly impaired clips.

Each clip is decoded as a recording and as a live stream of blocks. A reading is wrong unless a word of its
label lies within half a word of its start, or a crosstalk of the clip has that label.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from panoptic_ros.domain import AudioBlock, TimecodeReading
from panoptic_ros.stage import Progress, each, untold
from panoptic_ros.study.timing.ltc_impairments import Impaired, impaired_clip
from panoptic_ros.timecode import TimecodeConfig, TimecodeStage, decode_recording

Array = np.ndarray
Decode = Callable[[Array, int], Sequence[TimecodeReading]]  # samples (N,) float32 and their rate
BLOCK = 1024  # samples of a live block
SECONDS = 2.0  # of timecode per clip
COUNTS = ("clips", "exceptions", "unusable", "wrong", "right", "sent")


@dataclass(frozen=True, slots=True)
class Outcome:
    """The readings of one clip against its truth.

    Args:
        sent: words of which some part is in the clip.
        right: of them, words that were read.
        wrong: readings with another label or where no word is.
        unusable: readings whose start or deviation is not finite, or whose deviation is not positive.
        error: the exception with its place in the source; "" if there was none.
    """

    sent: int
    right: int = 0
    wrong: int = 0
    unusable: int = 0
    error: str = ""


def recorded(samples: Array, rate: int) -> Sequence[TimecodeReading]:
    """Decode a clip as a whole, as `panoptic ltc decode` does."""
    return decode_recording(TimecodeConfig(), "clip", rate, samples)


def live(samples: Array, rate: int) -> Sequence[TimecodeReading]:
    """Decode a clip block by block, as the stage does."""
    stage = TimecodeStage(TimecodeConfig())
    readings: list[TimecodeReading] = []
    for first in range(0, len(samples), BLOCK):
        block = AudioBlock("clip", first * 1_000_000_000 // rate, first, rate, samples[first : first + BLOCK])
        readings += stage.step(block).outputs
    return [*readings, *stage.flush().outputs]


WAYS: dict[str, Decode] = {"recorded": recorded, "live": live}


def outcome(clip: Impaired, decode: Decode) -> Outcome:
    """Decode a clip and compare its readings with its truth; an exception is part of the outcome."""
    try:
        readings = decode(clip.samples.astype(np.float32), clip.sample_rate)
    except Exception as error:  # any exception is the finding here
        place = traceback.extract_tb(error.__traceback__)[-1]
        told = f"{type(error).__name__}: {error} ({place.filename.rpartition('/')[2]}:{place.lineno})"
        return Outcome(len(clip.labels), error=told)
    return judged(clip, readings)


def judged(clip: Impaired, readings: Iterable[TimecodeReading]) -> Outcome:
    """Compare readings with the truth of their clip."""
    labels = [_plain(label) for label in clip.labels]
    faint = {_plain(label) for label in clip.faint}
    right: set[int] = set()
    wrong = unusable = 0
    for reading in readings:
        usable = np.isfinite(reading.start_sample) and np.isfinite(reading.std_samples)
        unusable += not (usable and reading.std_samples > 0.0)
        near = np.flatnonzero(np.abs(clip.starts - reading.start_sample) < 0.5 * clip.lengths)
        same = [int(k) for k in near if labels[k] == _plain(reading.timecode)]
        right |= set(same[:1])
        wrong += not same and _plain(reading.timecode) not in faint
    return Outcome(len(labels), len(right), wrong, unusable)


def _plain(label: object) -> str:
    """Return a label without the mark of drop-frame."""
    return str(label).replace(";", ":")


def robustness(
    number: int, seed: int, seconds: float = SECONDS, progress: Progress = untold
) -> dict[str, Any]:
    """Decode clips and sum their outcomes for each way of decoding.

    Args:
        number: of the clips. seed: of the first; the others count on.
        seconds: about the length of the timecode in a clip.

    Returns: by the way, the sums, and the clips with a finding by their seeds.
    """
    sums: dict[str, dict[str, Any]] = {
        way: {**dict.fromkeys(COUNTS, 0), "clips": number, "findings": []} for way in WAYS
    }
    for k in each(range(seed, seed + number), number, progress, "clips"):
        clip = impaired_clip(k, seconds)
        for way, decode in WAYS.items():
            found, row = outcome(clip, decode), sums[way]
            row["exceptions"] += bool(found.error)
            for name in ("sent", "right", "wrong", "unusable"):
                row[name] += getattr(found, name)
            if found.error or found.wrong or found.unusable:
                text = found.error or f"{found.wrong} wrong, {found.unusable} unusable of {found.sent} words"
                row["findings"].append({"seed": k, "kinds": clip.kinds, "what": text})
    return sums
