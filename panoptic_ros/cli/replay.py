"""`panoptic replay`: replay a bag onto the live graph."""

from __future__ import annotations

import argparse
from pathlib import Path

from panoptic_ros.running.arguments import within
from panoptic_ros.running.processes.shared_memory import prepare_shared_memory


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument("bag", nargs="+", type=Path, metavar="BAG", help="a rosbag2; several bags are merged")
    parser.add_argument(
        "--from",
        dest="begin",
        default="",
        metavar="TOPIC",
        help="publish only what later stages of the graph need from this topic on: image, detections, "
        "detection_sets, associations, proposals, poses, skeletons_raw, or the stage that publishes it",
    )
    parser.add_argument(
        "--topic",
        action="append",
        default=[],
        metavar="PATTERN",
        help="publish only topics that match, e.g. '/cam*/detections'; repeatable",
    )
    parser.add_argument(
        "--rate",
        type=within(float, 0.01, 100),
        default=1.0,
        metavar="X",
        help="seconds of the bag per second of replay; default 1",
    )
    parser.add_argument("--clock", action="store_true", help="publish /clock, for nodes with use_sim_time")
    parser.add_argument(
        "--start",
        type=within(float, 0, 1e9),
        default=0.0,
        metavar="S",
        help="seconds to leave out at the beginning of the bag",
    )
    parser.add_argument(
        "--duration", type=within(float, 0.01, 1e9), metavar="S", help="seconds of the bag to replay"
    )
    parser.add_argument("--namespace", default="", metavar="NAME", help="prefix of all topics, e.g. /hall")
    parser.add_argument(
        "--loops",
        type=within(int, 0, 1_000_000),
        default=1,
        metavar="N",
        help="number of repetitions, with continuous timestamps; 0: until Ctrl-C",
    )
    parser.add_argument(
        "--wait",
        type=within(float, 0, 3600),
        default=0.0,
        metavar="S",
        help="longest wait for a subscriber, in seconds",
    )


def run(args: argparse.Namespace) -> int:
    """Replay the bags to the end."""
    prepare_shared_memory()  # must precede the import of ROS
    # imported here to keep --help fast
    from panoptic_ros.running.recordings.replay import ReplayOptions, replay

    options = ReplayOptions(
        args.rate,
        args.begin,
        args.topic,
        args.start,
        args.duration,
        args.clock,
        args.namespace,
        int(args.loops),
        args.wait,
    )
    done = replay(args.bag, options, lambda line: print(line, flush=True))
    print(f"replayed {done.count} messages on {len(done.topics)} topics")
    return 0
