"""Studies of `panoptic evaluate` that bring their own cameras."""

from __future__ import annotations

import argparse
import json

from panoptic_ros.cli.evaluate_bodies import BODY_STUDIES, run_bodies
from panoptic_ros.cli.evaluate_refinement import (
    REFINEMENT_STUDIES,
    run_fill,
    run_refinement,
    run_steady,
    run_walkout,
)
from panoptic_ros.io.files import known, write_json
from panoptic_ros.running.plans.parameters import read_parameters
from panoptic_ros.view.progress import PassBar


def _run_identity(args: argparse.Namespace) -> int:
    """Who stays who."""
    from panoptic_ros.bench.identity_study import study_identity
    from panoptic_ros.view.identity_table import identity_lines

    settings = read_parameters(None, args.settings)
    with PassBar(args.study) as bar:
        result = study_identity(args.frames or 100, args.seed, settings, bar.show)
    if args.out is not None:
        write_json(args.out / "identity.json", known(result))
    print(json.dumps(known(result), indent=1) if args.json else "\n".join(identity_lines(result)))
    return 0


def _run_child(args: argparse.Namespace) -> int:
    """A child whom adults hide, in rendered takes."""
    from panoptic_ros.bench.hidden_child import study_child
    from panoptic_ros.view.identity_table import child_lines

    settings = read_parameters(None, args.settings)
    with PassBar(args.study) as bar:
        result = study_child(args.frames or 20, args.seed, args.scenes or "usual", settings, bar.show)
    if args.out is not None:
        write_json(args.out / "child.json", known(result))
    print(json.dumps(known(result), indent=1) if args.json else "\n".join(child_lines(result)))
    return 0


WITHOUT_RIG = {
    **dict.fromkeys(BODY_STUDIES, run_bodies),
    "identity": _run_identity,
    "child": _run_child,
    **dict.fromkeys(REFINEMENT_STUDIES, run_refinement),
    "fill": run_fill,
    "walkout": run_walkout,
    "steady": run_steady,
}
