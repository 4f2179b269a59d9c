"""`panoptic continuous`: motion as a function of time, from cameras that were never synchronised."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from panoptic_ros.cli.offsets import add_saved_option
from panoptic_ros.running.arguments import output_file, within


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument(
        "capture",
        nargs="?",
        type=Path,
        metavar="CAPTURE_DIR",
        help="capture folder with 2D people or images, or results of `panoptic run`",
    )
    parser.add_argument(
        "--bag",
        action="append",
        default=[],
        type=Path,
        help="rosbag2 with detections or images; repeatable",
    )
    parser.add_argument("--detections", type=Path, help="2D people, detections.json(.gz), with --rig")
    parser.add_argument("--rig", type=Path, help="calibration, instead of that of the capture or bag")
    parser.add_argument(
        "--clocks", action="store_true", help="estimate clock offsets and drifts of the cameras"
    )
    add_saved_option(parser)
    parser.add_argument(
        "--rolling-shutter", action="store_true", help="estimate the line delays of the cameras"
    )
    parser.add_argument(
        "--trusted-camera",
        default="",
        metavar="NAME",
        help="camera with right timestamps and line delay; default: the clocks of most cameras if they "
        "agree, else offsets have mean 0",
    )
    instants = parser.add_mutually_exclusive_group()
    instants.add_argument(
        "--rate",
        type=within(float, 0.1, 10000.0),
        default=100.0,
        metavar="HZ",
        help="instants per second of the result, from the first view on; default 100",
    )
    instants.add_argument(
        "--at", type=Path, metavar="FILE", help="CSV file with the instants of the result, column stamp_ns"
    )
    parser.add_argument(
        "--lag",
        type=within(float, 0.0, 1.0),
        metavar="SECONDS",
        help="give what the online form would have said: each instant k / rate from the views up to SECONDS "
        "later (0: prediction); default: the whole recording",
    )
    parser.add_argument(
        "--capture-views",
        type=within(int, 2, 1000),
        metavar="N",
        help="cameras whose fields of view must contain a person; with fewer, the person is a bystander; "
        "default 3, or 2 where at most 3 cameras look at one place",
    )
    parser.add_argument(
        "--preset",
        choices=("elhayek-2012",),
        help="method of a paper: polynomials of joint angles in overlapping segments (Elhayek et al. 2012); "
        "default: curves of joints",
    )
    parser.add_argument(
        "--subject",
        type=Path,
        metavar="FILE",
        help="subject.json: fit curves of joint angles to this person, whose bones keep their lengths; with "
        "--preset: its skeleton; default: no body model",
    )
    fitted = parser.add_mutually_exclusive_group()
    fitted.add_argument(
        "--images",
        type=Path,
        metavar="FOLDER",
        help="with --preset: capture folder whose images are fitted, as in the paper, instead of 2D joints",
    )
    fitted.add_argument(
        "--score-maps",
        action="store_true",
        help="with --preset: fit the score maps of a bag, or of a detector on images, instead of 2D joints",
    )
    parser.add_argument("--skeleton", default="auto", help="skeleton model; auto: that of the file's joints")
    parser.add_argument(
        "--clocks-out", type=output_file, metavar="FILE", help="file for clocks and line delays, as JSON"
    )
    parser.add_argument(
        "--curves", type=output_file, metavar="FILE", help="file for the curves, as NumPy's .npz"
    )
    parser.add_argument(
        "--out", type=output_file, required=True, metavar="S", help="skeletons.json(.gz) to write"
    )
    parser.add_argument("--quiet", action="store_true", help="print no summary")


def run(args: argparse.Namespace) -> int:
    """Solve a recording and write the people at all instants."""
    from panoptic_ros.io.clock_files import write_camera_times  # imported here to keep --help fast
    from panoptic_ros.io.curve_files import write_curves
    from panoptic_ros.io.plain_formats import write_skeletons
    from panoptic_ros.running.continuous import (
        check_instants,
        check_outputs,
        read_continuous_task,
        read_instants,
        solve_continuous,
        without_wrong_stamps,
    )
    from panoptic_ros.running.continuous_online import check_online, solve_online
    from panoptic_ros.running.continuous_preset import check_preset, solve_preset
    from panoptic_ros.running.known_clocks import whole_clocks, with_saved_clocks
    from panoptic_ros.view.clock_lines import camera_time_lines
    from panoptic_ros.view.progress import PassBar

    check_outputs({"--out": args.out, "--clocks-out": args.clocks_out, "--curves": args.curves})
    if args.lag is not None:
        check_online(vars(args))
    check_preset(vars(args))
    stamps = read_instants(args.at) if args.at else None
    with PassBar("views") as bar:
        task = read_continuous_task(
            args.rig,
            args.detections,
            (args.clocks, args.rolling_shutter, args.trusted_camera, args.capture_views),
            args.skeleton,
            capture=args.capture,
            bags=args.bag,
            maps=args.score_maps,
            progress=bar.show,
        )
    known = None
    if args.offsets:
        task, known = with_saved_clocks(task, args.offsets)
    task = without_wrong_stamps(task)
    if args.lag is not None:
        with PassBar("continuous") as bar:
            result = solve_online(task, args.lag, args.rate, bar.show)
        for line in (*task.notices, *result.notices):
            print(f"warning: {line}", file=sys.stderr)
        write_skeletons(args.out, task.joint_names, result.sets)
        if not args.quiet:
            print(f"{args.out}: {len(result.sets)} instants, {result.people} people")
        return 0
    with PassBar("continuous") as bar:
        if args.preset:
            motion = solve_preset(task, args.subject, args.images, args.score_maps, bar.show)
        else:
            motion = solve_continuous(task, bar.show, args.subject)
    motion = motion if known is None else whole_clocks(motion, known)
    told = [] if stamps is None else check_instants(stamps, motion)
    for line in (*task.notices, *told):
        print(f"warning: {line}", file=sys.stderr)
    for notice in motion.notices:
        print(f"{notice.severity}: {notice.text}", file=sys.stderr)
    instants = motion.at_rate(args.rate) if stamps is None else stamps
    write_skeletons(args.out, task.joint_names, motion.sets(instants))
    if args.clocks_out:
        write_camera_times(args.clocks_out, motion)
    if args.curves:
        write_curves(args.curves, task.joint_names, motion)
    if not args.quiet:
        if known is not None:
            print("\n".join(known.told(motion.cameras)))
        print(f"{args.out}: {len(instants)} instants, {len({person.id for person in motion.people})} people")
        if args.clocks or args.rolling_shutter:
            print("\n".join(camera_time_lines(motion, args.clocks, args.rolling_shutter)))
    return 0
