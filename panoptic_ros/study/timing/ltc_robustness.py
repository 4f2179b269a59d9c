"""Robustness of the timecode decoder: exceptions, unusable deviations and wrong labels on impaired clips.

Clips combine random impairments of a timecode signal, with the true labels and starts of their words. A clip
is one to three pieces of tape, spliced with or without silence, or a sound without timecode. Each piece has a
label, speed, direction, wow, flutter and channel of its own. Further impairments apply to the whole clip:
noise, dropouts, gain control, crosstalk, sample rate conversion, clipping, quantisation and cuts.

Each clip is decoded as a recording and as a live stream of blocks. A reading is correct if a word with its
label lies within half a word of its start. A reading with a label of the clip's crosstalk does not count as
wrong.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import resample_poly

from panoptic_ros.domain import AudioBlock, Timecode, TimecodeReading
from panoptic_ros.simulation.ltc_channel import ChannelDistortion, play_ltc
from panoptic_ros.simulation.ltc_signal import timecode_rate
from panoptic_ros.stage import Progress, each, untold
from panoptic_ros.study.timing.ltc_sounds import KINDS
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.recording import decode_recording
from panoptic_ros.timecode.stage import TimecodeStage

SAMPLE_RATES = (8000, 11025, 16000, 22050, 32000, 44100, 48000, 88200, 96000, 192000)  # Hz
FRAME_RATES = ("23.976", "24", "25", "29.97", "29.97df", "30")
LABELS = 2_000_000  # frames, range of the first label: less than a day at 24 frames/s
NO_TIMECODE = 0.15  # share of the clips without timecode
LEVEL = 0.25  # peak of a piece before its impairments; full scale is 1
SILENCE_SECONDS = 0.1  # s, around a sound without timecode
Change = Callable[["ImpairedClip", np.random.Generator], "ImpairedClip"]
Array = np.ndarray
# arguments: samples (N,) float32, sample rate in Hz
Decode = Callable[[Array, int], Sequence[TimecodeReading]]
BLOCK = 1024  # samples of a live block
SECONDS = 2.0  # s of timecode per clip
COUNTS = ("clips", "exceptions", "unusable", "wrong", "right", "sent")


@dataclass(frozen=True, slots=True, eq=False)
class ImpairedClip:
    """A clip with its ground truth.

    Args:
        samples: (N,) float64, full scale is 1.
        sample_rate: Hz.
        labels: one per word that is at least partly in the clip.
        starts: (W,) samples, first edge of bit 0 of each word.
        lengths: (W,) samples, length of each word.
        kinds: names of the impairments, in order of application.
        faint: labels of a crosstalk, which a decoder reads where the clip itself is silent.
    """

    samples: Array
    sample_rate: int
    labels: tuple[Timecode, ...]
    starts: Array
    lengths: Array
    kinds: tuple[str, ...]
    faint: tuple[Timecode, ...] = ()


def impaired_clip(seed: int, seconds: float = 4.0) -> ImpairedClip:
    """Make one clip; the seed determines all choices.

    Args:
        seconds: approximate length of the timecode in it.
    """
    rng = np.random.default_rng([seed, 7])
    rate = int(rng.choice(SAMPLE_RATES))
    if rng.random() < NO_TIMECODE:
        clip = _sound(rng, rate, seconds)
    else:
        count = int(rng.choice([1, 1, 2, 3]))
        clip = _joined([_piece(rng, rate, seconds / count) for _ in range(count)], rng)
    for name, (share, change) in CHANGES.items():
        if rng.random() < share:
            clip = change(clip, rng)
            clip = replace(clip, kinds=(*clip.kinds, name))
    return clip


def _piece(rng: np.random.Generator, sample_rate: int, seconds: float) -> ImpairedClip:
    """Play a piece of tape through a separate channel."""
    rate = timecode_rate(str(rng.choice(FRAME_RATES)))
    kinds = [f"{sample_rate} Hz"]
    speed = 1.0 + 1e-4 * rng.uniform(-1.0, 1.0)
    if rng.random() < 0.3:
        kinds.append("speed")
        speed = float(np.exp(rng.uniform(np.log(0.25), np.log(4.0)) * rng.choice([0.15, 1.0])))
    options: dict[str, tuple[float, dict[str, Any]]] = {
        "wow": (0.25, {"wow": rng.uniform(0.0, 0.05), "wow_hz": float(np.exp(rng.uniform(-2.3, 0.7)))}),
        "flutter": (
            0.3,
            {"flutter": rng.uniform(0.0, 0.03), "flutter_hz": float(np.exp(rng.uniform(0.7, 3.0)))},
        ),
        "ramp": (0.1, {"ramp": rng.uniform(0.0, 0.3)}),
        "jitter": (0.15, {"jitter_s": 10.0 ** rng.uniform(-6.5, -4.5)}),
        "low pass": (0.2, {"low_pass_hz": rng.uniform(1800.0, 8000.0)}),
        "high pass": (0.2, {"high_pass_hz": 10.0 ** rng.uniform(0.5, 3.3)}),
        "echo": (0.15, {"echo_s": rng.uniform(0.05, 0.8), "direct_db": rng.uniform(3.0, 25.0)}),
    }
    given: dict[str, Any] = {}
    for name, (share, fields) in options.items():
        if rng.random() < share:
            kinds.append(name)
            given |= fields
    channel = ChannelDistortion(speed=speed, amplitude=LEVEL, seed=int(rng.integers(2**31)), **given)
    words = max(2, int(seconds * float(rate.exact) * speed))
    start = Timecode.from_frame_count(int(rng.integers(LABELS)), rate)
    user, backward = int(rng.integers(2**32)), bool(rng.random() < 0.2)
    if backward:
        kinds.append("reverse")
    lead = rng.uniform(0.0, 0.6)
    signal = play_ltc(start, words, sample_rate, channel, lead=lead, user_bits=user, reverse=backward)
    lengths = np.abs(np.diff(signal.starts))
    samples, starts = signal.samples.astype(np.float64), signal.starts
    if rng.random() < 0.1:
        kinds.append("played backwards")
        samples, starts = samples[::-1], len(samples) - 1.0 - starts
    lengths = np.append(lengths, lengths[-1])
    return ImpairedClip(samples, sample_rate, signal.labels, starts, lengths, tuple(kinds))


def _sound(rng: np.random.Generator, rate: int, seconds: float) -> ImpairedClip:
    """Make a sound without timecode, or silence."""
    count = int(seconds * rate)
    time = np.arange(count) / rate
    tone = np.sin(2.0 * np.pi * rng.uniform(50.0, 4000.0) * time)
    plain = {"sine": tone, "square": np.sign(tone), "silence": np.zeros(count), "constant": np.ones(count)}
    name = str(rng.choice([*KINDS, *plain]))
    samples = plain[name] if name in plain else KINDS[name](rng, count, rate)
    samples = LEVEL * samples / max(1e-9, float(np.abs(samples).max()))
    quiet = np.zeros(int(SILENCE_SECONDS * rate))
    samples = np.concatenate([quiet, samples, quiet])
    return ImpairedClip(samples, rate, (), np.empty(0), np.empty(0), (f"{rate} Hz", name))


def _joined(pieces: list[ImpairedClip], rng: np.random.Generator) -> ImpairedClip:
    """Join pieces; the splice is inside a word, at the end of the piece, or after silence."""
    parts: list[Array] = []
    starts: list[Array] = []
    place, kinds = 0, [*pieces[0].kinds]
    for number, piece in enumerate(pieces):
        samples = piece.samples
        if number + 1 < len(pieces):
            how = str(rng.choice(["splice", "silence", "end"]))
            if how == "splice":
                samples = samples[: int(rng.uniform(0.6, 1.0) * len(samples))]
            elif how == "silence":
                samples = np.append(samples, np.zeros(int(rng.uniform(0.01, 0.5) * piece.sample_rate)))
            kinds += [how, *pieces[number + 1].kinds[1:]]
        parts.append(samples)
        starts.append(piece.starts + place)
        place += len(samples)
    clip = ImpairedClip(
        np.concatenate(parts),
        pieces[0].sample_rate,
        tuple(label for piece in pieces for label in piece.labels),
        np.concatenate(starts),
        np.concatenate([piece.lengths for piece in pieces]),
        tuple(kinds),
    )
    return clip


def _rms(samples: Array) -> float:
    return max(1e-6, float(np.sqrt(np.mean(samples**2))) if len(samples) else 0.0)


def _with(clip: ImpairedClip, samples: Array) -> ImpairedClip:
    return replace(clip, samples=samples)


def _noise(clip: ImpairedClip, rng: np.random.Generator) -> ImpairedClip:
    """Add white noise 0 to 40 dB below the signal."""
    level = _rms(clip.samples) * 10.0 ** (-rng.uniform(0.0, 40.0) / 20.0)
    return _with(clip, clip.samples + level * rng.standard_normal(len(clip.samples)))


def _hum(clip: ImpairedClip, rng: np.random.Generator) -> ImpairedClip:
    """Add mains hum with harmonics, -20 to +6 dB relative to the signal."""
    time = np.arange(len(clip.samples)) / clip.sample_rate
    level = _rms(clip.samples) * 10.0 ** (rng.uniform(-20.0, 6.0) / 20.0)
    base = float(rng.choice([50.0, 60.0]))
    hum = sum(np.sin(2.0 * np.pi * k * base * time + rng.uniform(0.0, 6.28)) / k for k in (1, 2, 3))
    return _with(clip, clip.samples + level * np.asarray(hum))


def _dropouts(clip: ImpairedClip, rng: np.random.Generator) -> ImpairedClip:
    """Attenuate sections of 1 to 300 ms, fully or partly."""
    samples = clip.samples.copy()
    for _ in range(int(rng.integers(1, 9))):
        first = int(rng.integers(max(1, len(samples))))
        length = int(10.0 ** rng.uniform(-3.0, -0.5) * clip.sample_rate)
        samples[first : first + length] *= rng.choice([0.0, 0.05, 0.3])
    return _with(clip, samples)


def _gain(clip: ImpairedClip, rng: np.random.Generator) -> ImpairedClip:
    """Vary the gain like a pumping gain control, up to 12 dB either way, 0.2 to 8 Hz."""
    time = np.arange(len(clip.samples)) / clip.sample_rate
    swing = rng.uniform(0.0, 12.0) * np.sin(2.0 * np.pi * rng.uniform(0.2, 8.0) * time)
    return _with(clip, clip.samples * 10.0 ** (swing / 20.0))


def _crosstalk(clip: ImpairedClip, rng: np.random.Generator) -> ImpairedClip:
    """Add another timecode, 12 to 40 dB below."""
    other = _piece(rng, clip.sample_rate, len(clip.samples) / clip.sample_rate)
    faint = np.resize(other.samples, len(clip.samples)) * 10.0 ** (-rng.uniform(12.0, 40.0) / 20.0)
    return replace(clip, samples=clip.samples + faint, faint=other.labels)


def _clicks(clip: ImpairedClip, rng: np.random.Generator) -> ImpairedClip:
    """Add bursts of a few samples."""
    samples = clip.samples.copy()
    for at in rng.integers(0, max(1, len(samples)), int(rng.integers(1, 60))):
        samples[at : at + int(rng.integers(1, 8))] += rng.uniform(-1.0, 1.0)
    return _with(clip, samples)


def _lost(clip: ImpairedClip, rng: np.random.Generator) -> ImpairedClip:
    """Delete one to three blocks of 1 to 4000 samples, like a recorder that drops samples."""
    for _ in range(int(rng.integers(1, 4))):
        if len(clip.samples) < 10_000:
            break
        first, length = int(rng.integers(len(clip.samples) - 5000)), int(rng.integers(1, 4000))
        samples = np.delete(clip.samples, slice(first, first + length))
        ends = clip.starts - length * (clip.starts >= first + length)
        clip = replace(clip, samples=samples, starts=np.where(ends >= first, np.maximum(ends, first), ends))
    return clip


def _converted(clip: ImpairedClip, rng: np.random.Generator) -> ImpairedClip:
    """Convert to another sample rate, with or without conversion back."""
    factor = rng.choice([(1, 2), (2, 1), (147, 160), (160, 147), (2, 3), (3, 2)])
    up, down = int(factor[0]), int(factor[1])
    samples, rate = resample_poly(clip.samples, up, down), clip.sample_rate * up // down
    if not 8000 <= rate <= 192_000 or rng.random() < 0.5:
        back = resample_poly(samples, down, up)[: len(clip.samples)]
        return _with(clip, back)
    ratio = up / down
    return replace(
        clip, samples=samples, sample_rate=rate, starts=clip.starts * ratio, lengths=clip.lengths * ratio
    )


def _level(clip: ImpairedClip, rng: np.random.Generator) -> ImpairedClip:
    """Change the level by -60 to +20 dB."""
    return _with(clip, clip.samples * 10.0 ** (rng.uniform(-60.0, 20.0) / 20.0))


def _offset(clip: ImpairedClip, rng: np.random.Generator) -> ImpairedClip:
    """Add a constant offset of up to the peak, either sign."""
    return _with(clip, clip.samples + rng.uniform(-1.0, 1.0) * float(np.abs(clip.samples).max(initial=0.0)))


def _inverted(clip: ImpairedClip, rng: np.random.Generator) -> ImpairedClip:
    """Invert the polarity."""
    return _with(clip, -clip.samples)


def _clipped(clip: ImpairedClip, rng: np.random.Generator) -> ImpairedClip:
    """Clip at 3 to 90 % of the peak."""
    limit = rng.uniform(0.03, 0.9) * float(np.abs(clip.samples).max(initial=0.0))
    return _with(clip, np.clip(clip.samples, -limit, limit))


def _square(clip: ImpairedClip, rng: np.random.Generator) -> ImpairedClip:
    """Keep only the signs, so that edges lie at whole samples."""
    return _with(clip, LEVEL * np.sign(clip.samples))


def _resolution(clip: ImpairedClip, rng: np.random.Generator) -> ImpairedClip:
    """Quantise to 8, 16 or 24 bits and clip at full scale."""
    scale = 2.0 ** (int(rng.choice([8, 8, 16, 24])) - 1)
    return _with(clip, np.clip(np.round(clip.samples * scale), -scale, scale - 1.0) / scale)


def _cut(clip: ImpairedClip, rng: np.random.Generator) -> ImpairedClip:
    """Cut off both ends, so that the first and last words are incomplete."""
    count = len(clip.samples)
    first, last = int(rng.uniform(0.0, 0.4) * count), int(rng.uniform(0.6, 1.0) * count)
    return replace(clip, samples=clip.samples[first:last], starts=clip.starts - first)


CHANGES: dict[str, tuple[float, Change]] = {  # value: (share of the clips, impairment)
    "gain": (0.15, _gain),
    "crosstalk": (0.15, _crosstalk),
    "dropouts": (0.2, _dropouts),
    "lost samples": (0.1, _lost),
    "inverted": (0.2, _inverted),
    "converted": (0.15, _converted),
    "hum": (0.2, _hum),
    "noise": (0.5, _noise),
    "clicks": (0.15, _clicks),
    "level": (0.25, _level),
    "clipped": (0.15, _clipped),
    "square": (0.08, _square),
    "offset": (0.15, _offset),
    "bits": (0.3, _resolution),
    "cut": (0.15, _cut),
}


@dataclass(frozen=True, slots=True)
class ClipOutcome:
    """Readings of one clip compared with its ground truth.

    Args:
        sent: Number of words that are at least partly in the clip.
        right: Number of these words that were read.
        wrong: Number of readings with another label, or at a place without a word, except those with a label
            of the crosstalk.
        unusable: Number of readings whose start or deviation is not finite, or whose deviation is not
            positive.
        error: Exception with its place in the source; "" = none.
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


def outcome(clip: ImpairedClip, decode: Decode) -> ClipOutcome:
    """Decode a clip and compare its readings with the truth; an exception is part of the outcome."""
    try:
        readings = decode(clip.samples.astype(np.float32), clip.sample_rate)
    except Exception as error:  # any exception is a finding here
        place = traceback.extract_tb(error.__traceback__)[-1]
        told = f"{type(error).__name__}: {error} ({place.filename.rpartition('/')[2]}:{place.lineno})"
        return ClipOutcome(len(clip.labels), error=told)
    return judged(clip, readings)


def judged(clip: ImpairedClip, readings: Iterable[TimecodeReading]) -> ClipOutcome:
    """Compare readings with the ground truth of their clip."""
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
    return ClipOutcome(len(labels), len(right), wrong, unusable)


def _plain(label: object) -> str:
    """Return a label without the drop-frame separator."""
    return str(label).replace(";", ":")


def robustness(
    number: int, seed: int, seconds: float = SECONDS, progress: Progress = untold
) -> dict[str, Any]:
    """Decode clips and sum their outcomes for each decoding method.

    Args:
        number: number of clips.
        seed: seed of the first clip; the seeds of the others follow.
        seconds: approximate length of the timecode in a clip.

    Returns:
        by method: the sums, and the clips with a finding by their seeds.
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
