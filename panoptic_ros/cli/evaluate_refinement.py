"""`panoptic evaluate --study refine`, `fill` and `walkout`: what the surface and bodies are worth to
skeletons, and people whom few views see."""

from __future__ import annotations

import argparse
import json

from panoptic_ros.cli.options import seed_range
from panoptic_ros.errors import UsageError
from panoptic_ros.io.files import known, write_json
from panoptic_ros.running.plans.parameters import read_parameters
from panoptic_ros.view.progress import PassBar

REFINEMENT_STUDIES = ("refine", "refine-faults")


def run_steady(args: argparse.Namespace) -> int:
    """Run a capture without truth, print how steady people are, write the numbers."""
    from panoptic_ros.running.studies.steady import steady_lines, study_steadiness  # numba is slow to load

    if len(args.capture) != 1:
        raise UsageError("--study steady needs one --capture DIR, a capture folder, demo or demo-single")
    cameras = args.cameras.split(",") if args.cameras else []
    with PassBar(args.study) as bar:
        result = study_steadiness(args.capture[0], cameras, read_parameters(None, args.settings), bar.show)
    if args.out is not None:
        write_json(args.out / "steady.json", known(result))
    print(json.dumps(known(result), indent=1) if args.json else "\n".join(steady_lines(result)))
    return 0


def run_refinement(args: argparse.Namespace) -> int:
    """Run a capture once, smooth it in every way, print a table, write the numbers."""
    from panoptic_ros.running.studies import refine, refine_faults  # numba is slow to load

    if len(args.capture) != 1:
        raise UsageError(f"--study {args.study} needs one --capture DIR, a capture folder with its truth")
    cameras = args.cameras.split(",") if args.cameras else []
    settings = read_parameters(None, args.settings)
    with PassBar(args.study) as bar:
        if args.study == "refine":
            result = refine.study_refinement(
                args.capture[0], cameras, settings, args.depth, args.seed, bar.show
            )
            lines = refine.study_lines(result)
        else:
            result = refine_faults.study_faults(
                args.capture[0], cameras, settings, args.depth, seed_range(args), bar.show
            )
            lines = refine_faults.fault_lines(result)
    if args.out is not None:
        write_json(args.out / f"{args.study}.json", known(result))
    print(json.dumps(known(result), indent=1) if args.json else "\n".join(lines))
    return 0


def run_fill(args: argparse.Namespace) -> int:
    """Solve a capture with and without bodies, print a table, write the numbers."""
    from panoptic_ros.running.studies.fill import fill_lines, study_fill  # numba is slow to load

    if len(args.capture) != 1:
        raise UsageError("--study fill needs one --capture DIR, a capture folder or the results of a run")
    cameras = args.cameras.split(",") if args.cameras else []
    with PassBar(args.study) as bar:
        parameters = read_parameters(None, args.settings)
        result = study_fill(args.capture[0], cameras, parameters, bar.show, args.truth, args.person)
    if args.out is not None:
        write_json(args.out / "fill.json", known(result))
    print(json.dumps(known(result), indent=1) if args.json else "\n".join(fill_lines(result)))
    return 0


def run_walkout(args: argparse.Namespace) -> int:
    """Take cameras away from people, print a table of errors and ellipsoids, write the numbers."""
    from panoptic_ros.running.studies.walk_out import study_walkout, walkout_lines  # numba is slow to load

    if len(args.capture) > 1:
        raise UsageError("--study walkout takes one --capture DIR, or none: then people are simulated")
    cameras, settings = args.cameras.split(",") if args.cameras else [], read_parameters(None, args.settings)
    folder = args.capture[0] if args.capture else None
    with PassBar(args.study) as bar:
        result = study_walkout(folder, cameras, settings, seed_range(args), bar.show, args.truth)
    if args.out is not None:
        write_json(args.out / "walkout.json", known(result))
    print(json.dumps(known(result), indent=1) if args.json else "\n".join(walkout_lines(result)))
    return 0
