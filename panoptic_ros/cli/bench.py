"""`panoptic bench NAME`: measure this machine and this code."""

from __future__ import annotations

import argparse
import importlib
import json
from types import ModuleType

from panoptic_ros.bench import BENCHES
from panoptic_ros.running.benches import (
    detection,
    faults,
    graph,
    kinematics,
    live,
    network,
    recording,
    soak,
    view,
)
from panoptic_ros.view.progress import PassBar

BENCHES_OF_RUNS = {  # of more than a stage
    "detection": detection,
    "graph": graph,
    "kinematics": kinematics,
    "live": live,
    "recording": recording,
    "view": view,
    "soak": soak,
    "network": network,
    "faults": faults,
}
TITLES = {**BENCHES, **{name: bench.ABOUT for name, bench in BENCHES_OF_RUNS.items()}}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the verb; those of the benches come from their modules."""
    names = parser.add_subparsers(dest="bench", metavar="NAME", required=True)
    for name, text in sorted(TITLES.items()):
        sub = names.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        sub.add_argument("--json", action="store_true", help="print JSON in place of a table")
        _bench(name).add_arguments(sub)


def run(args: argparse.Namespace) -> int:
    """Measure and print."""
    bench = _bench(args.bench)
    with PassBar(args.bench) as bar:
        result = bench.measure(args, bar.show)
    print(json.dumps(result, indent=1) if args.json else "\n".join(bench.lines(result)))
    return 0


def _bench(name: str) -> ModuleType:
    if name in BENCHES_OF_RUNS:
        return BENCHES_OF_RUNS[name]
    return importlib.import_module(f"panoptic_ros.bench.{name}")
