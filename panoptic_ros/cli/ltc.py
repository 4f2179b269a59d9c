"""`panoptic ltc`: decode and make linear timecode."""
from __future__ import annotations

import argparse
import datetime
import json
import re
import sys
from pathlib import Path
from typing import Any

from panoptic_ros.domain import FrameRate, Timecode, TimecodeReading
from panoptic_ros.errors import UsageError
from panoptic_ros.io.files import write_json
from panoptic_ros.io.user_bits import date_of
from panoptic_ros.io.wav import read_wav, write_wav
from panoptic_ros.simulation.ltc_signal import encode_ltc, timecode_rate
from panoptic_ros.timecode import TimecodeConfig, decode_recording

FORMAT = "panoptic-ltc-1"
RATES = ("23.976", "24", "25", "29.97", "29.97df", "30")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the verb."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    decode = actions.add_parser("decode", help="read the timecode of a WAV file")
    decode.add_argument("file", type=Path, metavar="FILE.wav")
    decode.add_argument("--json", type=Path, metavar="OUT", help=f"write {FORMAT}; - for standard output")
    decode.add_argument("--channel", type=int, default=0, help="counted from 0 (default 0)")
    encode = actions.add_parser("encode", help="make a WAV file with timecode")
    encode.add_argument("out", type=Path, metavar="OUT.wav")
    encode.add_argument(
        "--start", default="00:00:00:00", metavar="HH:MM:SS:FF",
        help="first label; HH:MM:SS;FF for drop-frame",
    )  # fmt: skip
    encode.add_argument("--rate", default="25", choices=RATES, help="frames per second (default 25)")
    encode.add_argument("--seconds", type=float, default=10.0, help="length (default 10)")
    encode.add_argument("--sample-rate", type=int, default=48000, help="Hz (default 48000)")
    encode.add_argument("--user-bits", default="00000000", metavar="HEX", help="8 hex digits, group 8 first")
    encode.add_argument("--reverse", action="store_true", help="as of a tape that runs backwards")


def run(args: argparse.Namespace) -> int:
    """Decode or encode."""
    return _decode(args) if args.action == "decode" else _encode(args)


def _decode(args: argparse.Namespace) -> int:
    sample_rate, readings = _readings(args.file, args.channel)
    if not readings:
        print(f"no timecode found in {args.file}", file=sys.stderr)
    document = _document(sample_rate, readings)
    if args.json == Path("-"):
        print(json.dumps(document, indent=1))
    elif args.json is not None:
        write_json(args.json, document, indent=1)
    elif readings:
        print(_table(sample_rate, readings))
    return 0


def _readings(path: Path, channel: int) -> tuple[int, list[TimecodeReading]]:
    """Sample rate and all readings of a file."""
    sample_rate, samples = read_wav(path, channel)
    return sample_rate, decode_recording(TimecodeConfig(), path.stem, sample_rate, samples)


def _document(sample_rate: int, readings: list[TimecodeReading]) -> dict[str, Any]:
    rate = float(readings[-1].timecode.rate.exact) if readings else None
    frames = [
        {"timecode": str(r.timecode), "start_sample": r.start_sample, "std_samples": r.std_samples,
         "reverse": r.reverse, "user_bits": f"{r.user_bits:08x}"}
        for r in readings
    ]  # fmt: skip
    return {"format": FORMAT, "rate_hz": sample_rate, "frame_rate": rate, "frames": frames}


def _table(sample_rate: int, readings: list[TimecodeReading]) -> str:
    lines = [f"{'timecode':11}  {'start_sample':>14}  {'seconds':>12}  {'std us':>7}  user bits"]
    for r in readings:
        seconds, std = r.start_sample / sample_rate, 1e6 * r.std_samples / sample_rate
        back = "  reverse" if r.reverse else ""
        lines.append(
            f"{r.timecode!s:11}  {r.start_sample:14.3f}  {seconds:12.7f}  {std:7.3f}  {r.user_bits:08x}{back}"
        )
    rate = readings[-1].timecode.rate
    drop = " drop-frame" if rate.drop_frame else ""
    lines.append(f"{len(readings)} words at {float(rate.exact):.5g} Hz{drop}")
    found = date_of(readings[-1].user_bits)
    if found is not None:
        zone = "" if found.zone is None else f", zone {_zone(found.zone)}"
        lines.append(f"as a date (SMPTE ST 309) the user bits say {found.date.isoformat()}{zone}")
    return "\n".join(lines)


def _zone(zone: datetime.timedelta) -> str:
    minutes = round(zone.total_seconds() / 60.0)
    return f"{'-' if minutes < 0 else '+'}{abs(minutes) // 60:02d}:{abs(minutes) % 60:02d}"


def _encode(args: argparse.Namespace) -> int:
    rate = timecode_rate(args.rate)
    start = parse_timecode(args.start, rate)
    if not re.fullmatch(r"[0-9a-fA-F]{8}", args.user_bits):
        raise UsageError(f"--user-bits {args.user_bits!r} are not 8 hex digits")
    if not (0.0 < args.seconds <= 36000.0 and 4000 <= args.sample_rate <= 400_000):
        raise UsageError(f"cannot make {args.seconds} s of timecode at {args.sample_rate} Hz")
    words = max(1, round(args.seconds * float(start.rate.exact)))
    signal = encode_ltc(
        start, words, args.sample_rate, user_bits=int(args.user_bits, 16), reverse=args.reverse
    )
    write_wav(args.out, args.sample_rate, signal.samples)
    print(f"{args.out}: {words} words, {signal.labels[0]} to {signal.labels[-1]}")
    return 0


def parse_timecode(text: str, rate: FrameRate) -> Timecode:
    """A label as written; a semicolon before the frames means drop-frame.

    Raises:
        UsageError: if it is no label.
        ClockError: if the rate has no such label.
    """
    match = re.fullmatch(r"(\d\d):(\d\d):(\d\d)([:;])(\d\d)", text)
    if match is None:
        raise UsageError(f"{text!r} is no timecode; write HH:MM:SS:FF")
    if match.group(4) == ";":
        rate = FrameRate(rate.nominal, rate.exact, True)
    hours, minutes, seconds, frames = (int(match.group(i)) for i in (1, 2, 3, 5))
    return Timecode(hours, minutes, seconds, frames, rate)
