"""Timecode decoding: recall, wrong labels, errors of the starts, latency and speed, with libltc beside it.

Clips are made with exact truth (`simulation.ltc_channel`). Times are in microseconds unless named otherwise;
`bound` is that of Cramer and Rao for one word, known bits and the noise of the clip; `honest` is the standard
deviation of errors over stated deviations, without their mean, which a delay common to all words makes.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict
from typing import Any

import numpy as np

from panoptic_ros.bench import ltc_robustness
from panoptic_ros.bench.libltc import load_libltc
from panoptic_ros.bench.ltc_conditions import CONDITIONS, Condition, clip, noise_bound_us
from panoptic_ros.bench.ltc_sounds import sounds
from panoptic_ros.domain import AudioBlock, TimecodeReading
from panoptic_ros.evaluation.timecode_bench import DecodedWord, TimedSignal, timecode_table
from panoptic_ros.simulation.ltc_signal import LtcSignal
from panoptic_ros.stage import Progress, each, untold
from panoptic_ros.timecode import TimecodeConfig, TimecodeStage, decode_recording

Array = np.ndarray
BLOCK = 1024
LIVE_SECONDS = 0.01  # of the blocks for which latency is measured
QUICK_CLIPS, QUICK_WORDS, CLIPS, WORDS = 1, 90, 4, 300
SPEED_SECONDS = 60.0  # of timecode, so that finding it at the start counts little
LINE_WORDS = 600  # of 20 s


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the bench."""
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_WORDS} words per condition")
    parser.add_argument("--only", metavar="TEXT", default="", help="conditions whose names contain this")
    parser.add_argument("--no-libltc", action="store_true", help="do not look for libltc")
    parser.add_argument(
        "--false-codes",
        type=float,
        default=0.0,
        metavar="SECONDS",
        help="only play sounds without timecode, half of the time at 48 and half at 16 kHz",
    )
    parser.add_argument(
        "--starts",
        type=int,
        default=0,
        metavar="N",
        help="only count the starts after noise, silence, tones or clicks that are never decoded",
    )
    parser.add_argument(
        "--impairments",
        type=int,
        default=0,
        metavar="N",
        help="only decode clips with random combinations of impairments; counts exceptions and wrong labels",
    )
    parser.add_argument("--seed", type=int, default=1, help="of the clips (default 1)")


def measure(args: argparse.Namespace, progress: Progress = untold) -> dict[str, Any]:
    """Everything that was asked for."""
    if args.false_codes > 0.0:
        return {"false_codes": _false_codes(args.false_codes, args.seed)}
    if args.starts > 0:
        return {"starts": _starts(args.starts, args.seed)}
    if args.impairments > 0:
        return {"impairments": ltc_robustness.robustness(args.impairments, args.seed, progress=progress)}
    clips, words = (QUICK_CLIPS, QUICK_WORDS) if args.quick else (CLIPS, WORDS)
    libltc = None if args.no_libltc else load_libltc()
    _decode(clip(CONDITIONS[0], 0, 40).samples, 48000)  # compiled from here on
    rows = []
    conditions = [condition for condition in CONDITIONS if args.only in condition.name]
    for condition in each(conditions, len(conditions), progress, "conditions"):
        signals = [clip(condition, args.seed + k, words) for k in range(clips)]
        rows.append(_row(condition, signals, libltc))
    result: dict[str, Any] = {"libltc": libltc is not None, "conditions": rows}
    if not args.only:
        result["line"] = [_line_fit(rate, args.seed) for rate in (48000, 16000)]
        result["speed"] = [_speed(rate) for rate in (48000, 16000)]
    return result


def _row(condition: Condition, signals: list[LtcSignal], libltc: Any) -> dict[str, Any]:
    (row,) = timecode_table(_decode, [(condition.name, signals)])
    out = {**asdict(row), "recall": row.recall, "bound_us": noise_bound_us(condition)}
    out["start_s"], out["latency_s"] = _latency(signals[0])
    if libltc is not None:
        (theirs,) = timecode_table(libltc, [(condition.name, signals)])
        out["libltc"] = {**asdict(theirs), "recall": theirs.recall}
    return out


def _decode(samples: Array, rate: int) -> list[DecodedWord]:
    return [_word(r) for _, r in _readings(samples, rate, BLOCK)]


def _word(reading: TimecodeReading) -> DecodedWord:
    return DecodedWord(str(reading.timecode), reading.start_sample, reading.std_samples)


def _readings(samples: Array, rate: int, block: int) -> Iterable[tuple[int, TimecodeReading]]:
    """Readings, and how many samples had come by then."""
    stage = TimecodeStage(TimecodeConfig())
    for first in range(0, len(samples), block):
        stamp = first * 1_000_000_000 // rate
        piece = AudioBlock("clip", stamp, first, rate, samples[first : first + block])
        for reading in stage.step(piece).outputs:
            yield first + block, reading
    for reading in stage.flush().outputs:
        yield len(samples), reading


def _line_fit(rate: int, seed: int) -> dict[str, Any]:
    """Errors of the line through 20 s of words with 20 dB of noise: at its middle, us, and its slope."""
    signal = clip(Condition("line", rate, {"snr_db": 20.0}), seed, LINE_WORDS)
    readings = decode_recording(TimecodeConfig(), "clip", rate, signal.samples)
    starts = np.array([reading.start_sample for reading in readings])
    nearest = np.abs(signal.starts[:, None] - starts).argmin(axis=0)
    errors, at = starts - signal.starts[nearest], starts - starts.mean()
    slope = float(at @ errors / (at @ at))
    return {"rate_hz": rate, "middle_us": 1e6 / rate * float(errors.mean()), "slope_ppm": 1e6 * slope}


def _latency(signal: TimedSignal) -> tuple[float, float]:
    """Seconds from the signal's start to the first reading; the longest wait for a word that has ended."""
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
    """By CPU time: times real time offline and searching in noise; percent of a core for two channels."""
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
    """CPU seconds per second of audio, the least of some runs."""
    shares = []
    for _ in range(3):
        since = time.process_time()
        work()
        shares.append((time.process_time() - since) / seconds)
    return min(shares)


def _false_codes(seconds: float, seed: int) -> list[dict[str, Any]]:
    rows: dict[tuple[int, str], dict[str, Any]] = {}
    for rate in (48000, 16000):
        for name, samples in sounds(0.5 * seconds, rate, seed + rate):
            row = rows.setdefault((rate, name), {"rate_hz": rate, "sound": name, "seconds": 0.0, "words": 0})
            row["seconds"] += len(samples) / rate
            row["words"] += len(_decode(samples, rate))
    return list(rows.values())


def _starts(number: int, seed: int) -> dict[str, Any]:
    """Timecode of 1.5 s after half a second of something else."""
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


def lines(result: dict[str, Any]) -> list[str]:
    """The tables as text."""
    if "false_codes" in result:
        rows = result["false_codes"]
        out = [
            f"{r['rate_hz']:>6} Hz  {r['sound']:<15}{r['seconds']:>9.0f} s{r['words']:>6} words" for r in rows
        ]
        total = sum(r["seconds"] for r in rows), sum(r["words"] for r in rows)
        return [*out, f"all sounds {total[0]:.0f} s: {total[1]} words read where there are none"]
    if "impairments" in result:
        return ltc_robustness.lines(result["impairments"])
    if "starts" in result:
        r = result["starts"]
        return [f"{r['dead']} of {r['starts']} starts not decoded, {r['wrong']} wrong labels"]
    width = max([len(row["condition"]) for row in result["conditions"]] + [9])
    head = f"{'condition':<{width}}{'words':>6}{'recall':>8}{'wrong':>6}{'twice':>6}{'bias':>9}{'std':>9}"
    head += f"{'bound':>8}{'honest':>8}{'start s':>9}{'delay s':>9}"
    if result["libltc"]:
        head += f" | libltc{'recall':>8}{'wrong':>6}{'bias':>9}{'std':>9}"
    out = [head] + [_line(row, width) for row in result["conditions"]]
    if not result["libltc"]:
        out.append("without libltc (Debian, Ubuntu: package libltc11) there is nothing to compare with")
    for r in result.get("line", []):
        out.append(
            f"{r['rate_hz']} Hz: line through 20 s of words at 20 dB {r['middle_us']:+.3f} us off "
            f"at its middle, {r['slope_ppm']:+.4f} ppm"
        )
    for r in result.get("speed", []):
        follow, search = r["following_x"], r["searching_x"]
        out.append(
            f"{r['rate_hz']} Hz: offline {follow:.0f} x, searching {search:.1f} x real time, "
            f"two live channels {r['live_percent']:.1f} % of a core"
        )
    return out


def _line(row: dict[str, Any], width: int) -> str:
    text = f"{row['condition']:<{width}}{row['words']:>6}{100 * row['recall']:>8.2f}"
    text += f"{row['wrong']:>6}{row['twice']:>6}" + _cells((row["bias_us"], 9, 3), (row["std_us"], 9, 3))
    text += _cells((row["bound_us"], 8, 3), (row["scatter"], 8, 2))
    text += _cells((row["start_s"], 9, 2), (row["latency_s"], 9, 2))
    if "libltc" in row:
        r = row["libltc"]
        text += f" |       {100 * r['recall']:>8.2f}{r['wrong']:>6}"
        text += _cells((r["bias_us"], 9, 1), (r["std_us"], 9, 1))
    return text


def _cells(*cells: tuple[float, int, int]) -> str:
    return "".join(f"{'-':>{w}}" if np.isnan(v) else f"{v:>{w}.{d}f}" for v, w, d in cells)
