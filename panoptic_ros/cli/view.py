"""`panoptic view`: show results, a bag, or the live graph in a browser page."""

from __future__ import annotations

import argparse
from pathlib import Path

from panoptic_ros.cli.options import add_page_options, open_page
from panoptic_ros.errors import UsageError
from panoptic_ros.running.processes.shared_memory import prepare_shared_memory


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument(
        "path",
        nargs="?",
        type=Path,
        metavar="RESULTS|BAG|FOLDER",
        help="results of `panoptic run` or `solve`, a bag, or a capture folder",
    )
    parser.add_argument("--live", action="store_true", help="show the running graph in this ROS domain")
    parser.add_argument("--namespace", default="", help="with --live: namespace of the graph")
    parser.add_argument("--rig", type=Path, help="calibration, for bags without /rig and skeletons.json")
    parser.add_argument("--skeleton", default="", help="skeleton model, for bags without /skeleton_model")
    parser.add_argument(
        "--truth", type=Path, metavar="FILE", help="true skeletons, e.g. truth.json.gz of a simulation"
    )
    add_page_options(parser)


def run(args: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C."""
    if bool(args.path) == args.live:
        raise UsageError("give the results of a run, a bag, a capture folder, or --live")
    if args.live and (args.rig or args.skeleton or args.truth):
        raise UsageError("--rig, --skeleton and --truth have no meaning with --live")

    def ready(address: str) -> None:
        open_page(address, not args.no_browser)

    if args.live:
        prepare_shared_memory()  # must precede the import of ROS
        from panoptic_ros.running.viewer.live import view_live  # needs ROS

        view_live(args.host, args.port, ready, args.namespace.strip("/"))
        return 0
    from panoptic_ros.running.viewer.recordings import open_recorded, view_recorded

    view_recorded(open_recorded(args.path, args.rig, args.skeleton, args.truth), args.host, args.port, ready)
    return 0
