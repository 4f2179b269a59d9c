"""`panoptic study NAME`: measure accuracy, time and memory of this code against baselines."""

from __future__ import annotations

import argparse
import json

from panoptic_ros.io.files import known, write_json
from panoptic_ros.study.names import PRINTED, STUDIES, parsed
from panoptic_ros.study.study import run_study
from panoptic_ros.view.progress import PassBar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb; each study has further options of its own."""
    parser.add_argument(
        "name", nargs="?", metavar="NAME", help="name of a study; without it, all studies are listed"
    )
    parser.add_argument(
        "rest",
        nargs=argparse.REMAINDER,
        metavar="OPTION",
        help="options of the study, see `panoptic study NAME --help`",
    )


def run(args: argparse.Namespace) -> int:
    """Run a study and print the result; without a name, list all studies."""
    if args.name is None:
        width = max(map(len, STUDIES))
        print("\n".join(f"{name:<{width}}  {about}" for name, (_, about) in STUDIES.items()))
        return 0
    study = parsed(args.name, args.rest)
    with PassBar(args.name) as bar:
        result = run_study(study, bar.show)
    if study.options.json == PRINTED:
        print(json.dumps(known(result), indent=1))
    else:
        if study.options.json is not None:
            write_json(study.options.json, known(result))
        print("\n".join(study.lines(result)))
    if getattr(study.options, "plot", None) is not None:
        study.plot(study.options.plot, result)
    return 0
