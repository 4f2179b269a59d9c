"""Studies of bodies: `panoptic evaluate --study kinematics` and its kind."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from typing import TYPE_CHECKING

from panoptic_ros.cli.options import seed_range
from panoptic_ros.errors import UsageError
from panoptic_ros.io.files import known, write_bytes, write_json
from panoptic_ros.view.progress import PassBar

if TYPE_CHECKING:
    from panoptic_ros.running.studies.bodies.cases import BodyCase

BODY_STUDIES = ("kinematics", "kinematics-inputs", "terms", "alignment", "devices", "captures")


def run_bodies(args: argparse.Namespace) -> int:
    """Solve captures in several ways, print a table, write the numbers and the plot."""
    from panoptic_ros.running.studies.bodies import (  # numba is slow to load
        alignment,
        captures,
        devices,
        goals,
        inputs,
        terms,
    )

    cases, number = _cases(args)
    with PassBar(args.study) as bar:
        if args.study == "devices":
            result = devices.study_devices(seed_range(args), args.settings, bar.show)
            lines = devices.device_lines(result)
        elif args.study == "captures":
            result = captures.study_captures(cases, number, args.settings, bar.show)
            lines = captures.capture_lines(result)
        elif args.study == "alignment":
            result = alignment.study_alignment(cases, number, args.settings, bar.show)
            lines = alignment.alignment_lines(result)
        elif args.study == "terms":
            result = terms.study_terms(cases, number, args.settings, bar.show)
            lines = terms.term_lines(result)
        elif args.study == "kinematics":
            result = goals.study_goals(cases, number, args.settings, bar.show)
            lines = goals.goal_lines(result)
        else:
            cameras = [int(word) for word in args.cameras.split(",")] if args.cameras else inputs.CAMERAS
            result = inputs.study_inputs(cases, number, cameras, args.settings, bar.show)
            lines = inputs.input_lines(result)
    result |= {"folders": True} if args.capture else {}
    if args.out is not None:
        write_json(args.out / f"{args.study}.json", known(result))
        if args.study == "kinematics-inputs":
            from panoptic_ros.running.studies.bodies.statistics import origin
            from panoptic_ros.view.body_study_plot import body_study_plot

            picture = body_study_plot(result["rows"], "ours", origin(result))
            write_bytes(args.out / f"{args.study}.png", picture)
        if args.study == "terms":
            from panoptic_ros.view.term_study_plot import term_study_plot

            write_bytes(args.out / f"{args.study}.png", term_study_plot(result["rows"], terms.FULL))
    print(json.dumps(known(result), indent=1) if args.json else "\n".join(lines))
    return 0


def _cases(args: argparse.Namespace) -> tuple[Iterator[BodyCase], int]:
    """Captures one by one, and how many: those in folders, or simulated ones of all scenes and seeds."""
    from panoptic_ros.running.simulations.body_scenes import BODY_SCENES, OTHER_BODY_SCENES
    from panoptic_ros.running.studies.bodies.cases import read_case, simulated_case

    if args.capture:
        return map(read_case, args.capture), len(args.capture)
    known = BODY_SCENES | OTHER_BODY_SCENES
    usual = OTHER_BODY_SCENES if args.study == "captures" else BODY_SCENES
    if args.study == "captures" and args.scenes == "drawn":
        from panoptic_ros.running.studies.bodies.drawn import drawn_case

        return map(drawn_case, seed_range(args)), len(seed_range(args))
    seeds, scenes = seed_range(args), args.scenes.split(",") if args.scenes else list(usual)
    unknown = [name for name in scenes if name not in known]
    if unknown:
        raise UsageError(f"there is no scene {unknown[0]!r}; there are {', '.join(known)}")
    pairs = [(name, seed) for seed in seeds for name in scenes]
    return (simulated_case(*pair) for pair in pairs), len(pairs)
