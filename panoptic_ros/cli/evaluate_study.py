"""`panoptic evaluate --study NAME`: how accuracy depends on the number and kind of cameras of a rig."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from panoptic_ros.bench.studies.takes import Takes
from panoptic_ros.cli.options import output_folder
from panoptic_ros.cli.studies_without_rig import WITHOUT_RIG
from panoptic_ros.errors import UsageError
from panoptic_ros.running.plans.parameters import read_parameters
from panoptic_ros.running.plans.presets import read_preset
from panoptic_ros.running.studies import rigs as studies
from panoptic_ros.view.progress import PassBar
from panoptic_ros.view.study_table import study_table, time_table

PAPER, NOTHING = "panoptic-studio", "none"
DEFAULTS = {  # numbers of people, of cameras, and of frames
    "cameras": ("2,3,4,5,6,7", "480,240,160,80,40,20,10", 12),
    "nodes": ("2,3,4,5,6,7", "480", 12),
    "resolution": ("2,5", "19", 5),
    "time": ("5", "480", 5),
}


def add_study_arguments(parser: argparse.ArgumentParser) -> None:
    """Options that only studies have."""
    group = parser.add_argument_group("studies, in place of TRUTH and RESULT")
    group.add_argument(
        "--study",
        choices=(*studies.STUDIES, *WITHOUT_RIG),
        help="simulate people in a rig: PCK by number of cameras; node and skeleton accuracy; rendered HD, "
        "VGA and QVGA images; time for a minute of capture. Without --rig: kinematics: bodies beside the "
        "paper's solver, -inputs: by cameras and IMUs; terms: each left out; alignment: heading and clock "
        "of IMUs; devices: IMUs that are worn otherwise than said; captures: unknown headings and clocks, "
        "bystanders, people who leave; identity: who stays who, and whom few views see; child: a child "
        "whom adults hide, rendered (--scenes usual or hard); refine: smoothing "
        "of a capture with truth, without and with the motion of the surface (--capture); refine-faults: of "
        "true joints with noise, outliers and gaps (--seeds); steady: limb lengths and accelerations of a "
        "capture without truth, the same (--capture, demo or demo-single); fill: how bodies fit, and joints "
        "that few views see with and without them (--capture, also results of a run, with TRUTH if it is "
        "elsewhere); walkout: people whom two cameras, then one see, of a capture, or simulated (--seeds)",
    )
    group.add_argument("--rig", type=Path, help="calibration of the cameras, e.g. of the Panoptic Studio")
    group.add_argument(
        "--capture",
        type=Path,
        metavar="DIR",
        action="append",
        default=[],
        help="refine, refine-faults, fill, walkout, kinematics: capture folder with its truth; the last: "
        "repeatable",
    )
    group.add_argument(
        "--depth",
        choices=("none", "given", "kinect"),
        default="given",
        help="refine: the capture's depth maps besides: not at all, as they are (default), or, for simulated "
        "ones, with the noise of a sensor",
    )
    group.add_argument("--out", type=output_folder, metavar="DIR", help="folder for NAME.json and NAME.png")
    group.add_argument(
        "--people", default="", metavar="N,N", help="default 2,3,4,5,6,7 (resolution: 2,5; time: 5)"
    )
    group.add_argument(
        "--cameras", default="", metavar="N,N", help="default 480,240,160,80,40,20,10 (resolution: 19)"
    )
    group.add_argument(
        "--frames",
        type=int,
        metavar="N",
        help="per number of people; default 12 (resolution, time: 5); "
        "identity: trials of each kind, default 100; child: takes, default 20",
    )
    group.add_argument(
        "--person",
        type=int,
        metavar="ID",
        action="append",
        default=[],
        help="fill: score only this person of the truth, on whom nothing was measured; repeatable",
    )
    group.add_argument("--seed", type=int, default=0, metavar="N", help="of the simulation")
    group.add_argument("--seeds", default="", metavar="FROM:TO", help="of it; studies that take several")
    group.add_argument("--scenes", default="", metavar="NAME,NAME", help="of bodies; captures: also drawn")
    group.add_argument(
        "--noise",
        type=float,
        default=0.012,
        metavar="SHARE",
        help="standard deviation of 2D joints, a share of the diagonal of the person's box (default 0.012)",
    )
    group.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="STAGE.NAME=VALUE",
        dest="settings",
        help="a parameter of voting or assembly, for every method",
    )
    group.add_argument(
        "--preset",
        default=PAPER,
        metavar="NAME",
        help=f"is put beside the default: a preset or a YAML file (default {PAPER}); {NOTHING} = nothing",
    )


def run_study(args: argparse.Namespace) -> int:
    """Simulate, solve, score, print a table, write the plot and the numbers."""
    if args.study in WITHOUT_RIG:
        return WITHOUT_RIG[args.study](args)
    if args.rig is None or args.out is None:
        raise UsageError(f"--study {args.study} needs --rig FILE and --out DIR")
    if not 0.0 < args.noise < 0.1:
        raise UsageError(f"--noise {args.noise} is no share of a person's size; write e.g. 0.012")
    request = _request(args)
    with PassBar(args.study) as bar:
        result = studies.run_study(request, bar.show)
    files = studies.write_study(args.out, result)
    table = time_table if args.study == "time" else study_table
    print(json.dumps(result, indent=1) if args.json else "\n".join(table(result)))
    if not args.json:
        print(f"\nwritten: {', '.join(str(path) for path in files)}")
    return 0


def _request(args: argparse.Namespace) -> studies.StudyRequest:
    people, cameras, frames = DEFAULTS[args.study]
    takes = Takes(_numbers(args.people or people, "--people"), args.frames or frames, args.seed, args.noise)
    return studies.StudyRequest(
        args.study,
        args.rig,
        takes,
        _numbers(args.cameras or cameras, "--cameras"),
        read_parameters(None, args.settings),
        read_preset("" if args.preset == NOTHING else args.preset),
    )


def _numbers(text: str, option: str) -> tuple[int, ...]:
    try:
        numbers = tuple(int(word) for word in text.split(","))
    except ValueError:
        numbers = (0,)
    if min(numbers) < 1:
        raise UsageError(f"{option} {text!r} is no list of whole numbers from 1, e.g. 2,5,7")
    return numbers
