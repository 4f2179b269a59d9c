"""`panoptic continuous`: motion as a function of time, from cameras that were never synchronised."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from panoptic_ros.running.arguments import output_file, within

if TYPE_CHECKING:
    from panoptic_ros.continuous.motion_result import ContinuousMotion


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument("--rig", type=Path, required=True, help="calibration, in any format that `rig` reads")
    parser.add_argument("--detections", type=Path, required=True, help="2D people, detections.json(.gz)")
    parser.add_argument(
        "--clocks", action="store_true", help="estimate clock offsets and drifts of the cameras"
    )
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
    parser.add_argument(
        "--preset", choices=("elhayek-2012",), help="method of a paper, as a reference for comparisons"
    )
    parser.add_argument(
        "--images", type=Path, metavar="FOLDER", help="with --preset: capture folder whose images are used too"
    )
    parser.add_argument(
        "--images-only", action="store_true", help="with --images: 2D people serve for the first pose only"
    )
    parser.add_argument("--quiet", action="store_true", help="print no summary")


def run(args: argparse.Namespace) -> int:
    """Solve a file and write the people at all instants."""
    from panoptic_ros.continuous.config import ContinuousConfig  # imported here to keep --help fast
    from panoptic_ros.io.clock_files import write_camera_times
    from panoptic_ros.io.curve_files import write_curves
    from panoptic_ros.io.plain_formats import write_skeletons
    from panoptic_ros.running.continuous import read_continuous_task, read_instants, solve_continuous
    from panoptic_ros.running.continuous_preset import solve_preset
    from panoptic_ros.view.progress import PassBar

    stamps = read_instants(args.at) if args.at else None
    config = ContinuousConfig(args.clocks, args.rolling_shutter, args.trusted_camera)
    task = read_continuous_task(args.rig, args.detections, config, args.skeleton)
    for line in task.notices:
        print(f"warning: {line}", file=sys.stderr)
    with PassBar("continuous") as bar:
        if args.preset:
            motion = solve_preset(task, args.images, args.images_only, bar.show)
        else:
            motion = solve_continuous(task, bar.show)
    instants = motion.at_rate(args.rate) if stamps is None else stamps
    write_skeletons(args.out, task.joint_names, motion.sets(instants))
    if args.clocks_out:
        write_camera_times(args.clocks_out, motion)
    if args.curves:
        write_curves(args.curves, task.joint_names, motion)
    if not args.quiet:
        print(f"{args.out}: {len(instants)} instants, {len(motion.people)} people")
        if config.clocks or config.rolling_shutter:
            print("\n".join(clock_lines(motion)))
    return 0


def clock_lines(motion: ContinuousMotion) -> list[str]:
    """Return one line per camera: clock offset, drift and line delay with standard deviations."""
    lines = []
    deviations = motion.clocks.deviations
    for c, name in enumerate(motion.cameras):
        (offset, drift, line), (offset_sd, drift_sd, line_sd) = motion.clocks.values[:, c], deviations[:, c]
        lines.append(
            f"{name}: {1e3 * offset:+.2f} ms +- {1e3 * offset_sd:.2f}, {1e6 * drift:+.0f} ppm +- "
            f"{1e6 * drift_sd:.0f}, {1e6 * line:.1f} us per row +- {1e6 * line_sd:.1f}"
        )
    return lines
