"""Studies of `panoptic evaluate` that bring their own cameras."""
from __future__ import annotations

import argparse
import json

from panoptic_ros.cli.evaluate_refinement import run_refinement
from panoptic_ros.io.files import write_bytes, write_json
from panoptic_ros.running.plans.parameters import read_parameters
from panoptic_ros.view.progress import PassBar


def _run_bodies(args: argparse.Namespace) -> int:
    """Bodies by cameras and IMUs."""
    from panoptic_ros.running.simulations.bodies import BODY_SCENES
    from panoptic_ros.running.studies.bodies import (  # numba is slow to load
        CAMERAS,
        METHODS,
        study_bodies,
        study_lines,
    )

    cameras = [int(word) for word in args.cameras.split(",")] if args.cameras else CAMERAS
    with PassBar(args.study) as bar:
        result = study_bodies(tuple(BODY_SCENES), args.seed, cameras, args.settings, bar.show)
    if args.out is not None:
        from panoptic_ros.view.body_study_plot import body_study_plot

        write_json(args.out / "kinematics.json", result)
        write_bytes(args.out / "kinematics.png", body_study_plot(result["rows"], METHODS[0]))
    print(json.dumps(result, indent=1) if args.json else "\n".join(study_lines(result)))
    return 0


def _run_identity(args: argparse.Namespace) -> int:
    """Who stays who."""
    from panoptic_ros.bench.identity import study_identity
    from panoptic_ros.view.identity_table import identity_lines

    settings = read_parameters(None, args.settings)
    with PassBar(args.study) as bar:
        result = study_identity(args.frames or 100, args.seed, settings, bar.show)
    if args.out is not None:
        write_json(args.out / "identity.json", result)
    print(json.dumps(result, indent=1) if args.json else "\n".join(identity_lines(result)))
    return 0


WITHOUT_RIG = {"kinematics": _run_bodies, "identity": _run_identity, "refine": run_refinement}
