"""Clocks of cameras from the motion of people, for the verbs that solve recorded captures."""
from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import DetectionSet
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.clocks_from_motion import find_clocks
from panoptic_ros.io.clock_offsets import write_clocks
from panoptic_ros.offsets import CameraClocks, regroup
from panoptic_ros.params import Config
from panoptic_ros.running.saved_offsets import saved_lines, saved_offsets
from panoptic_ros.stage import StageContext
from panoptic_ros.view.progress import PassBar


def add_saved_option(parser: argparse.ArgumentParser) -> None:
    """Offsets that were found before."""
    parser.add_argument(
        "--offsets", type=Path, metavar="FILE",
        help="add these offsets, found before, to the stamps; for latencies that last (see docs/offsets.md)",
    )  # fmt: skip


def add_offset_options(parser: argparse.ArgumentParser) -> None:
    """The options of a verb that solves a recording."""
    add_saved_option(parser)
    parser.add_argument(
        "--offsets-from-motion", action="store_true",
        help="find the cameras' clock offsets and drifts from the motion of people, and correct the stamps",
    )  # fmt: skip
    parser.add_argument(
        "--offsets-out", type=Path, metavar="FILE",
        help="write the offsets, with standard deviations, as JSON",
    )  # fmt: skip
    parser.add_argument(
        "--trusted-camera", default="", metavar="NAME",
        help="its stamps are right; default: those of most cameras if they agree, else offsets have mean 0",
    )  # fmt: skip


def correct(
    sets: Sequence[DetectionSet], context: StageContext, configs: Mapping[str, Config], args: Any
) -> list[DetectionSet]:
    """The sets with corrected stamps, if that is asked for; prints and writes what was found.

    Raises:
        UsageError: on options that do not go together.
    """
    if args.offsets and args.offsets_from_motion:
        raise UsageError("give --offsets FILE or --offsets-from-motion, which finds them anew, not both")
    if not args.offsets_from_motion:
        if args.offsets_out or args.trusted_camera:
            raise UsageError("--offsets-out and --trusted-camera need --offsets-from-motion")
        return list(sets) if args.offsets is None else _moved(sets, context, args)
    with PassBar("clocks from motion") as bar:
        found = find_clocks(sets, context, configs, args.trusted_camera, bar.show)
    if not args.quiet:
        print("\n".join(clock_lines(found.clocks)))
    if args.offsets_out:
        write_clocks(args.offsets_out, found.clocks)
    return found.sets


def _moved(sets: Sequence[DetectionSet], context: StageContext, args: Any) -> list[DetectionSet]:
    """The sets grouped anew by stamps plus saved offsets."""
    saved = saved_offsets(args.offsets, context.rig.names)
    if not args.quiet:
        print("\n".join(saved_lines(saved, context.rig.names)))
    frames = Counter(view.camera for item in sets for view in item.views)
    corrections = {
        name: np.full(count, 1e9 * saved[name].offset_s if name in saved else 0.0)
        for name, count in frames.items()
    }
    return regroup(sets, corrections)


def clock_lines(clocks: CameraClocks) -> list[str]:
    """What was found, in words."""
    width = max(len(name) for name in clocks.cameras)
    lines = ["clocks from motion (to be added to the stamps):"]
    for c, name in enumerate(clocks.cameras):
        offset, deviation = 1e3 * clocks.offsets[c], 1e3 * clocks.deviations[c]
        drift, wobble = 1e6 * clocks.drifts[c], 1e6 * clocks.drift_deviations[c]
        if not clocks.known[c]:
            text = f"not known (within {deviation:.0f} ms at best): too little moves in its view; stamps kept"
        elif clocks.applied[c]:
            text = f"{offset:+8.2f} ms +- {deviation:.2f}   drift {drift:+4.0f} ppm +- {wobble:.0f}"
        else:
            text = f"{offset:+8.2f} ms +- {deviation:.2f}   no more than chance; stamps kept"
        lines.append(f"  {name:<{width}}  {text}")
    for name, far in zip(clocks.cameras, clocks.strays):
        if far > 0.0:
            lines.append(f"  {name} strays from this by up to {1e3 * far:.0f} ms: does its clock jump?")
    if not clocks.known.any():
        lines.append("  nothing moves enough to compare the clocks; let somebody walk about for 5 s")
    if clocks.bias > 0.0:
        bias = f"{1e3 * clocks.bias:.0f} mm"
        lines.append(f"  2D joints are {bias} off for seconds on end; the deviations allow for it")
    if not clocks.converged:
        lines.append(f"  the estimate still moved after {clocks.iterations} iterations; trust it less")
    return lines
