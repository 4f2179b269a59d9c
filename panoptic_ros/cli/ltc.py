"""`panoptic ltc`: decode and generate linear timecode."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from panoptic_ros.io.files import write_json
from panoptic_ros.view.timecode_table import FORMAT, readings_document, readings_table

RATES = ("23.976", "24", "25", "29.97", "29.97df", "30")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    decode = actions.add_parser("decode", help="read the timecode of a WAV file or a video")
    decode.add_argument(
        "file", type=Path, metavar="FILE", help="WAV file, or any file with sound that FFmpeg reads"
    )
    decode.add_argument(
        "--json", type=Path, metavar="OUT", help=f"file to write, {FORMAT}; - = standard output"
    )
    decode.add_argument(
        "--channel", type=int, default=0, help="channel with the timecode, counted from 0 (default 0)"
    )
    encode = actions.add_parser("encode", help="write a WAV file with timecode")
    encode.add_argument("out", type=Path, metavar="OUT.wav")
    encode.add_argument(
        "--start",
        default="00:00:00:00",
        metavar="HH:MM:SS:FF",
        help="first label; HH:MM:SS;FF means drop-frame",
    )
    encode.add_argument("--rate", default="25", choices=RATES, help="frames per second (default 25)")
    encode.add_argument("--seconds", type=float, default=10.0, help="length of the file (default 10)")
    encode.add_argument("--sample-rate", type=int, default=48000, help="sampling rate in Hz (default 48000)")
    encode.add_argument(
        "--user-bits", default="00000000", metavar="HEX", help="user bits as 8 hex digits, group 8 first"
    )
    encode.add_argument(
        "--reverse", action="store_true", help="write the timecode of a tape that runs backwards"
    )


def run(args: argparse.Namespace) -> int:
    """Decode or encode timecode."""
    return _decode(args) if args.action == "decode" else _encode(args)


def _decode(args: argparse.Namespace) -> int:
    from panoptic_ros.running.ltc import decode_file  # imported here to keep --help fast

    sample_rate, readings = decode_file(args.file, args.channel)
    if not readings:
        print(f"no timecode found in {args.file}", file=sys.stderr)
    document = readings_document(sample_rate, readings)
    if args.json == Path("-"):
        print(json.dumps(document, indent=1))
    elif args.json is not None:
        write_json(args.json, document, indent=1)
    elif readings:
        print(readings_table(sample_rate, readings))
    return 0


def _encode(args: argparse.Namespace) -> int:
    from panoptic_ros.running.ltc import encode_file

    words, first, last = encode_file(
        args.out,
        args.start,
        args.rate,
        seconds=args.seconds,
        sample_rate=args.sample_rate,
        user_bits=args.user_bits,
        reverse=args.reverse,
    )
    print(f"{args.out}: {words} words, {first} to {last}")
    return 0
