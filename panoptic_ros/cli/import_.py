"""`panoptic import DATASET FOLDER --take SUBJECT/TAKE --out CAPTURE`: convert a public data set."""

from __future__ import annotations

import argparse
from pathlib import Path

from panoptic_ros.running.arguments import output_folder

DATASETS = ("total-capture", "human3.6m")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.add_argument("dataset", choices=DATASETS, help="data set in the folder")
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="folder with the unpacked archives")
    parser.add_argument(
        "--take", required=True, metavar="SUBJECT/TAKE", help="take to convert, e.g. s1/acting1, S9/Walking"
    )
    parser.add_argument(
        "--out", type=output_folder, required=True, metavar="CAPTURE", help="capture folder to write"
    )


def run(args: argparse.Namespace) -> int:
    """Import the take, and print a summary."""
    from panoptic_ros.running import importing  # imported here to keep --help fast

    reader = importing.import_total_capture if args.dataset == DATASETS[0] else importing.import_human36m
    print("\n".join(reader(args.folder, args.take, args.out)))
    return 0
