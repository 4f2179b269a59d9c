"""`panoptic warm-up`: compile all kernels in advance."""

from __future__ import annotations

import argparse
import time


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.add_argument(
        "--processes",
        type=int,
        metavar="N",
        help="number of processes; default: one per processor, at most 4",
    )


def run(args: argparse.Namespace) -> int:
    """Compile the missing modules and kernels."""
    from panoptic_ros.errors import UsageError
    from panoptic_ros.running.compiling.modules import compile_modules
    from panoptic_ros.running.compiling.warm_up import is_warm, warm_up  # numba is slow to import
    from panoptic_ros.view.progress import PassBar

    if args.processes is not None and args.processes < 1:
        raise UsageError(f"--processes {args.processes}: at least 1")
    if is_warm():
        print("all kernels are compiled")
        return 0
    began = time.monotonic()
    compile_modules()
    with PassBar("compiling") as bar:
        done = warm_up(bar.show, args.processes)
    seconds = time.monotonic() - began
    print(f"{done.kernels} kernels compiled in {seconds:.0f} s ({done.cpu_s:.0f} s of processor time)")
    return 0
