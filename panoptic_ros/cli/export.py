"""`panoptic export`: write the results of a run as a file for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from panoptic_ros.running.arguments import output_file, within


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument(
        "path", type=Path, metavar="RESULTS|BAG", help="results of `panoptic run` or `solve`, or a bag"
    )
    parser.add_argument("--rig", type=Path, help="calibration, if there is none beside skeletons.json")
    parser.add_argument(
        "--out",
        type=output_file,
        required=True,
        metavar="FILE.html|.bvh|...",
        help="file to write. HTML: one page with all data and images. Bodies: .bvh, .glb (glTF "
        "animation), .trc and .mot (OpenSim), .urdf",
    )
    parser.add_argument(
        "--from",
        dest="begin",
        type=within(float, 0, 1e9),
        default=0.0,
        metavar="S",
        help="begin of the export, in seconds from the start",
    )
    parser.add_argument(
        "--to",
        dest="end",
        type=within(float, 0, 1e9),
        metavar="S",
        help="end of the export, in seconds from the start; default: the end",
    )
    parser.add_argument(
        "--segments",
        default="segments21",
        metavar="NAME",
        help="skeleton of the bodies: an installed one (default segments21), or a YAML file",
    )


def run(args: argparse.Namespace) -> int:
    """Write the file."""
    from panoptic_ros.running.export import ExportOptions, export
    from panoptic_ros.view.progress import PassBar

    with PassBar("export") as bar:
        wanted = ExportOptions(args.begin, args.end, args.segments, args.rig)
        files = export(args.path, args.out, wanted, bar.show)
    for file in files:
        page = "; it opens in any browser, without a network" if file.suffix == ".html" else ""
        print(f"{file}: {file.stat().st_size / 1e6:.1f} MB{page}")
    return 0
