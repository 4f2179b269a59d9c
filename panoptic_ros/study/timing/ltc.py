"""The studies of timecode: recall, errors of labels and word starts, latency and speed, compared with libltc.

The clips have exact ground truth (`simulation.ltc_channel`). Times are in microseconds unless a column names
another unit. `bound` is the Cramer-Rao bound for one word with known bits, at the noise of the clip. `honest`
is the RMS of (error - mean error of the clip) / stated standard deviation; 1 = the stated values are right.
The mean error is subtracted because a delay common to all words causes it.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict
from typing import Any

import numpy as np

from panoptic_ros.domain import AudioBlock, TimecodeReading
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation.timecode_bench import DecodedWord, TimedSignal, timecode_table
from panoptic_ros.running.arguments import within
from panoptic_ros.simulation.ltc_signal import LtcSignal
from panoptic_ros.stage import Progress
from panoptic_ros.study.options import add_seeds
from panoptic_ros.study.study import Case, Column, Result, Row, Study
from panoptic_ros.study.timing.libltc import load_libltc
from panoptic_ros.study.timing.ltc_conditions import CONDITIONS, Condition, clip, noise_bound_us
from panoptic_ros.study.timing.ltc_robustness import COUNTS, robustness
from panoptic_ros.study.timing.ltc_sounds import sounds
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.recording import decode_recording
from panoptic_ros.timecode.stage import TimecodeStage

Array = np.ndarray
BLOCK = 1024
LIVE_SECONDS = 0.01  # s, length of the blocks in the latency measurement
CLIPS, WORDS = 4, 300
SPEED_SECONDS = 60.0  # s of timecode; long, so that the search at the start has little weight
LINE_WORDS = 600  # words, 20 s


class Ltc(Study):
    """Recall, wrong labels, start errors, latency and speed under each condition, compared with libltc."""

    columns = (
        Column("condition", "condition"),
        Column("words", "words"),
        Column("recall", "recall %", ".2f", 100.0),
        Column("wrong", "wrong"),
        Column("twice", "twice"),
        Column("bias_us", "bias us", ".3f"),
        Column("std_us", "std", ".3f"),
        Column("bound_us", "bound", ".3f"),
        Column("scatter", "honest", ".2f"),
        Column("start_s", "start s", ".2f"),
        Column("latency_s", "delay s", ".2f"),
        Column("libltc_recall", "libltc: recall %", ".2f", 100.0),
        Column("libltc_wrong", "wrong"),
        Column("libltc_bias_us", "bias us", ".1f"),
        Column("libltc_std_us", "std", ".1f"),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--only", metavar="TEXT", default="", help="only conditions whose names contain this text"
        )
        parser.add_argument("--no-libltc", action="store_true", help="do not search for libltc")
        for name, default, text in (
            ("--clips", CLIPS, "number of clips of each condition"),
            ("--words", WORDS, "number of words of each clip"),
        ):
            parser.add_argument(
                name,
                type=within(int, 1, 10**6),
                default=default,
                metavar="N",
                help=f"{text}; default {default}",
            )
        add_seeds(parser, "1")

    def cases(self) -> list[Case]:
        """See `Study`."""
        found = [Case(c.name, c) for c in CONDITIONS if self.options.only in c.name]
        if not found:
            raise UsageError(f"--only {self.options.only}: no condition has this in its name")
        return found

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        given, condition = self.options, case.request
        libltc = None if given.no_libltc else load_libltc()
        _decode(clip(CONDITIONS[0], 0, 40).samples, 48000)  # compile the decoder
        signals = [clip(condition, given.seeds.start + k, given.words) for k in range(given.clips)]
        (row,) = timecode_table(_decode, [(condition.name, signals)])
        out = {**asdict(row), "recall": row.recall, "bound_us": noise_bound_us(condition)}
        out["start_s"], out["latency_s"] = _latency(signals[0])
        if libltc is not None:
            (theirs,) = timecode_table(libltc, [(condition.name, signals)])
            other = {**asdict(theirs), "recall": theirs.recall}
            out |= {f"libltc_{key}": value for key, value in other.items() if key != "condition"}
        return [out]

    def summary(self, rows: list[Row]) -> dict[str, Any]:
        """Fit a line and measure the speed, unless --only selects conditions; see `Study`."""
        if self.options.only:
            return {}
        seed = self.options.seeds.start
        return {
            "line": [_line_fit(rate, seed) for rate in (48000, 16000)],
            "speed": [_speed(rate) for rate in (48000, 16000)],
        }

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        yield from super().lines(result)
        if not any("libltc_recall" in row for row in result["rows"]):
            yield "without libltc (Debian, Ubuntu: package libltc11) there is nothing to compare with"
        for r in result.get("line", []):
            yield (
                f"{r['rate_hz']} Hz: line through 20 s of words at 20 dB {r['middle_us']:+.3f} us off "
                f"at its middle, {r['slope_ppm']:+.4f} ppm"
            )
        for r in result.get("speed", []):
            yield (
                f"{r['rate_hz']} Hz: offline {r['following_x']:.0f} x, searching {r['searching_x']:.1f} x "
                f"real time, two live channels {r['live_percent']:.1f} % of a core"
            )


class LtcSounds(Study):
    """Words that are read in sounds without timecode, half of the time at 48 and half at 16 kHz."""

    columns = (
        Column("rate_hz", "Hz"),
        Column("sound", "sound"),
        Column("seconds", "s", ".0f"),
        Column("words", "words"),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--seconds",
            type=within(float, 0.1, 1e6),
            default=60.0,
            metavar="S",
            help="length of the sound; default 60",
        )
        add_seeds(parser, "1")

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        rows: dict[tuple[int, str], Row] = {}
        for rate in (48000, 16000):
            for name, samples in sounds(0.5 * self.options.seconds, rate, self.options.seeds.start + rate):
                kind = {"rate_hz": rate, "sound": name, "seconds": 0.0, "words": 0}
                row = rows.setdefault((rate, name), kind)
                row["seconds"] += len(samples) / rate
                row["words"] += len(_decode(samples, rate))
        return list(rows.values())

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        yield from super().lines(result)
        seconds, words = (sum(row[key] for row in result["rows"]) for key in ("seconds", "words"))
        yield f"all sounds {seconds:.0f} s: {words} words read where there are none"


class LtcStarts(Study):
    """Timecode of 1.5 s after half a second of noise, silence, tones or clicks: is it decoded."""

    columns = (Column("starts", "starts"), Column("dead", "not decoded"), Column("wrong", "wrong labels"))

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--number",
            type=within(int, 1, 10**7),
            default=100,
            metavar="N",
            help="number of starts; default 100",
        )
        add_seeds(parser, "1")

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        return [_starts(self.options.number, self.options.seeds.start)]


class LtcImpairments(Study):
    """Clips with random combinations of impairments: exceptions, unusable deviations and wrong labels."""

    columns = (Column("decoded", "decoded as"), *(Column(name, name) for name in COUNTS))

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--number",
            type=within(int, 1, 10**7),
            default=200,
            metavar="N",
            help="number of clips; default 200",
        )
        add_seeds(parser, "1")

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        sums = robustness(self.options.number, self.options.seeds.start, progress=progress)
        return [{"decoded": way} | row for way, row in sums.items()]

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        yield from super().lines(result)
        for row in result["rows"]:
            for found in row["findings"]:
                yield f"{row['decoded']}, clip {found['seed']} ({', '.join(found['kinds'])}): {found['what']}"


def _decode(samples: Array, rate: int) -> list[DecodedWord]:
    return [_word(r) for _, r in _readings(samples, rate, BLOCK)]


def _word(reading: TimecodeReading) -> DecodedWord:
    return DecodedWord(str(reading.timecode), reading.start_sample, reading.std_samples)


def _readings(samples: Array, rate: int, block: int) -> Iterable[tuple[int, TimecodeReading]]:
    """Yield the number of samples fed so far and the reading."""
    stage = TimecodeStage(TimecodeConfig())
    for first in range(0, len(samples), block):
        stamp = first * 1_000_000_000 // rate
        piece = AudioBlock("clip", stamp, first, rate, samples[first : first + block])
        for reading in stage.step(piece).outputs:
            yield first + block, reading
    for reading in stage.flush().outputs:
        yield len(samples), reading


def _line_fit(rate: int, seed: int) -> dict[str, Any]:
    """Fit a line through 20 s of words with 20 dB of noise.

    Returns:
        error at the middle of the line (us), and slope error (ppm).
    """
    signal = clip(Condition("line", rate, {"snr_db": 20.0}), seed, LINE_WORDS)
    readings = decode_recording(TimecodeConfig(), "clip", rate, signal.samples)
    starts = np.array([reading.start_sample for reading in readings])
    nearest = np.abs(signal.starts[:, None] - starts).argmin(axis=0)
    errors, at = starts - signal.starts[nearest], starts - starts.mean()
    slope = float(at @ errors / (at @ at))
    return {"rate_hz": rate, "middle_us": 1e6 / rate * float(errors.mean()), "slope_ppm": 1e6 * slope}


def _latency(signal: TimedSignal) -> tuple[float, float]:
    """Measure the latency of live decoding.

    Returns:
        seconds from the start of the signal to the first reading, and the longest delay (s) after the end of
        a word.
    """
    rate, starts = signal.sample_rate, np.sort(signal.starts)
    length = float(np.median(np.diff(starts)))
    come = list(_readings(signal.samples, rate, int(LIVE_SECONDS * rate)))
    if not come:
        return float("nan"), float("nan")
    first = come[0][0]
    reverse = come[0][1].reverse
    waits = [at - r.start_sample - (0.0 if reverse else length) for at, r in come if at > first + rate]
    begin = starts[0] - (length if reverse else 0.0)
    return float(first - begin) / rate, float(max(waits, default=np.nan)) / rate


def _speed(rate: int) -> dict[str, Any]:
    """Measure the decoding speed by processor time.

    Returns:
        multiples of real time, offline and while searching in noise, and percent of a core for two live
        channels.
    """
    clean = clip(Condition("speed", rate, {"snr_db": 20.0}), 5, int(30 * SPEED_SECONDS)).samples
    noise = np.random.default_rng(1).normal(0.0, 0.1, int(0.2 * SPEED_SECONDS * rate)).astype(np.float32)
    offline = _cpu_share(lambda: decode_recording(TimecodeConfig(), "clip", rate, clean), len(clean) / rate)
    live = _cpu_share(lambda: _decode(clean, rate), len(clean) / rate)
    searching = _cpu_share(lambda: _decode(noise, rate), len(noise) / rate)
    return {
        "rate_hz": rate,
        "following_x": 1.0 / offline,
        "searching_x": 1.0 / searching,
        "live_percent": 200.0 * live,
    }


def _cpu_share(work: Callable[[], object], seconds: float) -> float:
    """Return the processor seconds per second of audio, the minimum of three runs."""
    shares = []
    for _ in range(3):
        since = time.process_time()
        work()
        shares.append((time.process_time() - since) / seconds)
    return min(shares)


def _starts(number: int, seed: int) -> dict[str, Any]:
    """Decode 1.5 s of timecode after 0.5 s of noise, silence, tones or clicks; count failures."""
    dead, wrong = 0, 0
    for k in range(number):
        rng = np.random.default_rng([seed, k])
        rate = (48000, 16000)[k % 2]
        signal = clip(Condition("start", rate, {"snr_db": 60.0}), seed + k, 45)
        samples = signal.samples.copy()
        first = int(signal.starts[0])
        level = 0.25 * 10.0 ** (-rng.uniform(0.0, 40.0) / 20.0)
        time_s = np.arange(first) / rate
        kind = k // 2 % 4
        if kind == 0:
            samples[:first] = level * rng.standard_normal(first)
        elif kind == 1:
            samples[:first] = 0.0
        elif kind == 2:
            samples[:first] = level * sum(np.sin(2 * np.pi * f * time_s) for f in rng.uniform(100, 3000, 4))
        else:
            samples[rng.integers(0, first, 30)] = rng.choice([-1.0, 1.0], 30)
        (row,) = timecode_table(_decode, [("start", [_with(signal, samples)])])
        dead += int(row.recall < 0.5)
        wrong += row.wrong
    return {"starts": number, "dead": dead, "wrong": wrong}


def _with(signal: LtcSignal, samples: Array) -> LtcSignal:
    samples = np.clip(samples, -1.0, 1.0).astype(np.float32)
    return LtcSignal(samples, signal.sample_rate, signal.labels, signal.starts)
