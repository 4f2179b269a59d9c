"""A live run as a process of its own, whose bag stands for cameras: `live_take.py BAG OUT [ARGUMENTS]`.

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


if __name__ == "__main__":
    plan_of = source.make_plan
    source.make_plan = lambda args: replace(plan_of(args), live=True)
    running_run._over_dds = over_dds
    bag, out, *more = sys.argv[1:]
    sys.argv[1:] = ["run", "--bag", bag, "--out", out, *more]
    os.chdir(Path(out).parent)
    program()
