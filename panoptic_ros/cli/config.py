"""`panoptic config`: show all parameters, or write the files that are generated from them."""

from __future__ import annotations

import argparse
from pathlib import Path

from panoptic_ros.errors import UsageError
from panoptic_ros.io.files import write_bytes
from panoptic_ros.io.resources import share_folder
from panoptic_ros.running.generated_files import STAGES, generated_files
from panoptic_ros.study.pages import PAGE, results_page


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument(
        "action", choices=("show", "write"), help="print the parameters, or write the generated files"
    )
    parser.add_argument("stage", nargs="?", choices=STAGES, help="show this stage only")


def run(args: argparse.Namespace) -> int:
    """Show the parameters or write the files."""
    files = generated_files()
    if args.action == "show":
        shown = [f"config/{args.stage}.yaml"] if args.stage else ["docs/parameters.md"]
        print("\n".join(files[name] for name in shown))
        return 0
    root = share_folder()
    if not (root / "setup.py").is_file():
        raise UsageError(f"config write is for a checkout of the repository; {root} is an installation")
    files[PAGE] = results_page(root)
    for name, text in files.items():
        write_bytes(Path(root / name), text.encode())
        print(name)
    return 0
