"""A live run whose bag stands for cameras: `live_take.py BAG OUT [ARGUMENTS]`, or forked by `fork_server`.

It takes views at 30 Hz and appends the stamp of each instant to the file that the variable TOLD names.
"""

import os
import sys
import time
from dataclasses import replace
from pathlib import Path

from panoptic_ros.cli.main import program
from panoptic_ros.cli.run import source
from panoptic_ros.running.runs import run as running_run
from panoptic_ros.running.runs.in_process import run_in_process

PERIOD_S = 1.0 / 30.0


class Paced:
    """Gives records on at the rate of cameras, and tells how far it is."""

    def __init__(self, results, told):
        self._results, self._told = results, told

    def take(self, key, record):
        self._results.take(key, record)
        if key == "skeletons":
            os.write(self._told, f"{record.stamp_ns}\n".encode())
            time.sleep(PERIOD_S)


def over_dds(plan, results, stop, *how):
    told = os.open(os.environ["TOLD"], os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    run_in_process(replace(plan, live=False), Paced(results, told), stop)
    return {}


def begin(bag, out, *more):
    """Run the program, which ends the process."""
    plan_of = source.make_plan
    source.make_plan = lambda args: replace(plan_of(args), live=True)
    running_run._over_dds = over_dds
    sys.argv[1:] = ["run", "--bag", bag, "--out", out, *more]
    os.chdir(Path(out).parent)
    program()


def load():
    """Load modules and compiled code, as every run would."""
    from panoptic_ros.cli.run import beginning, watch  # noqa: F401
    from panoptic_ros.graph.build import configure, make_stage
    from panoptic_ros.graph.nodes import FUSION
    from panoptic_ros.running.plans import bag_plan  # noqa: F401
    from panoptic_ros.running.runs import listening  # noqa: F401
    from panoptic_ros.simulation import SCENES, SKELETON, simulate
    from panoptic_ros.stage import StageContext

    context, configs = StageContext(simulate(SCENES["clean-4p5v"], 0, 1).rig, SKELETON), configure({})
    for name in ("sync", *FUSION):
        make_stage(name, configs[name], context)


if __name__ == "__main__":
    begin(*sys.argv[1:])
