"""`panoptic sync report`: the clocks of a capture, what is wrong with them, and what to do."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from panoptic_ros.cli.options import output_folder
from panoptic_ros.view.sync_table import sync_table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the action."""
    parser.add_argument(
        "source",
        type=Path,
        metavar="BAG|CAPTURE_DIR",
        help="a bag, a capture folder, or a file: timestamps.csv, sync tables, WAV or video with timecode",
    )
    parser.add_argument("--json", action="store_true", help="print JSON in place of a table")
    parser.add_argument(
        "--out", type=output_folder, metavar="DIR", help="write sync_report.json and sync.png there"
    )


def run(args: argparse.Namespace) -> int:
    """Exit code 2 if there is a warning: the user can mend it."""
    from panoptic_ros.running.sync_report.report import (  # only now: --help must be quick
        report_clocks,
        write_report,
    )

    report = report_clocks(args.source)
    print(json.dumps(report.document, indent=1) if args.json else "\n".join(sync_table(report.document)))
    if args.out is not None:
        write_report(args.out, report)
    return 2 if report.warned else 0
