"""`panoptic record`: record a live graph to a self-contained bag."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from panoptic_ros.errors import UsageError
from panoptic_ros.io.output import lossy_output
from panoptic_ros.running.arguments import within
from panoptic_ros.running.processes.shared_memory import prepare_shared_memory


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument(
        "--out",
        type=Path,
        metavar="BAG",
        help="bag to write; with --standby, a folder for bags named by their time",
    )
    parser.add_argument(
        "--topic",
        action="append",
        default=[],
        metavar="PATTERN",
        help="record only topics that match, e.g. '/cam*/image_raw', instead of all topics that a run "
        "uses and publishes; repeatable",
    )
    parser.add_argument("--no-images", action="store_true", help="leave out images and depth maps")
    parser.add_argument("--rig", type=Path, help="calibration for the bag, if no /rig is published")
    parser.add_argument(
        "--duration", type=within(float, 0.1, 1e9), metavar="S", help="end after this number of seconds"
    )
    parser.add_argument(
        "--budget",
        type=within(float, 0.001, 1e6),
        default=0.0,
        metavar="GB",
        help="end when the messages take this number of GB",
    )
    parser.add_argument(
        "--keep-free",
        type=within(float, 0, 1e6),
        default=1.0,
        metavar="GB",
        help="end when less than this is free on the disk; default 1",
    )
    parser.add_argument(
        "--split",
        metavar="30m|2GB",
        help="continue in another bag, BAG/000, BAG/001, ..., after this time (s, m, h) or size (MB, GB)",
    )
    parser.add_argument("--standby", action="store_true", help="wait for --start and --stop, on every host")
    parser.add_argument("--start", action="store_true", help="start the recorders of all hosts")
    parser.add_argument("--stop", action="store_true", help="stop the recorders of all hosts")


def run(args: argparse.Namespace) -> int:
    """Record, or ask the recorders of all hosts to start or stop."""
    if sum((args.start, args.stop, args.out is not None)) != 1:
        raise UsageError("give one of --out BAG, --start and --stop; --standby goes with --out FOLDER")
    prepare_shared_memory()  # before the import of ROS, which terminates if shared memory is full
    if args.start or args.stop:
        return _ask(args.start)
    # imported here to keep --help fast
    from panoptic_ros.io.bag_split import split_of
    from panoptic_ros.running.recordings.options import RecordOptions, Selection
    from panoptic_ros.running.recordings.record import record, stand_by

    options = RecordOptions(
        Selection(args.topic, not args.no_images),
        args.duration,
        args.budget,
        args.keep_free,
        args.rig,
        split_of(args.split) if args.split else None,
    )
    with lossy_output():
        if args.standby:
            stand_by(args.out, options, _tell)
            return 0
        _print(record(args.out, options, _tell))
    return 0


def _tell(line: str) -> None:
    print(line, flush=True)


def _ask(start: bool) -> int:
    """Ask the recorders of all hosts to start or stop; return exit code 2 if a host did not."""
    from panoptic_ros.running.recordings.control import ask_all

    answers = ask_all(start)
    for host, _, text in answers:
        print(f"{host}: {text}")
    return 0 if all(done for _, done, _ in answers) else 2


def _print(recorded: Any) -> None:
    rows = sorted(recorded.counters.items())
    width = max([len(topic) for topic, _ in rows] or [5])
    print(f"{'topic':{width}}  messages      Hz  missing  longest gap s        MB")
    for topic, counter in rows:
        print(
            f"{topic:{width}}  {counter.count:8d}  {counter.rate:6.2f}  {counter.missing:7d}  "
            f"{counter.longest_s:13.3f}  {counter.size / 1e6:8.2f}"
        )
    for topic, count in sorted(recorded.dropped.items()):
        print(f"the disk was too slow for {count} messages on {topic}")
    if recorded.ended_by:
        print(f"ended: {recorded.ended_by}")
    print(f"recorded {recorded.path}")
