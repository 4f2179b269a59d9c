"""The course of a run: plan, run, finish.

Whatever happens, no half-written results stay. A live run has no end of its own: being asked to end, as by
Ctrl-C, or a fault of a camera ends the recording, and what it has is written.
"""
from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from typing import Any

from panoptic_ros.cli.run.watch import Watch
from panoptic_ros.errors import PanopticError
from panoptic_ros.io.interruption import first_request_told
from panoptic_ros.running.finish import finish
from panoptic_ros.running.in_process import run_in_process
from panoptic_ros.running.plan import Plan
from panoptic_ros.running.planning import make_plan
from panoptic_ros.running.results import Results, result_folder
from panoptic_ros.running.startup_check import StartupCheck


def execute(args: argparse.Namespace) -> int:
    """`panoptic run` with its arguments."""
    plan = make_plan(args)
    started = time.monotonic()
    fault: PanopticError | None = None
    with (
        first_request_told(plan.live) as asked, result_folder(args.out) as folder,
        Watch(plan, args.live_view) as watch,
    ):  # fmt: skip
        check = StartupCheck(plan)

        def saw(key: str, record: Any) -> None:
            watch.saw(key, record)
            check.saw(key, record)

        def stop() -> bool:
            return asked() or (args.duration is not None and time.monotonic() - started > args.duration)

        with Results(folder, plan, saw) as results:
            try:
                counted = _run(plan, results, stop, args)
            except PanopticError as error:
                if not (plan.live and results.poses):
                    raise
                counted, fault = {}, error
            if asked() and not results.poses:
                raise KeyboardInterrupt
        watch.close()
        notices = check.judge()
        elapsed_s = time.monotonic() - started
        finish(
            plan, results, counted, notices,
            pictures=not args.no_pictures, elapsed_s=elapsed_s, out=args.out,
        )  # fmt: skip
    if fault is not None:
        raise fault
    return 0


def _run(
    plan: Plan, results: Results, stop: Callable[[], bool], args: argparse.Namespace
) -> Mapping[str, Mapping[str, str]]:
    if args.in_process:
        return {name: stage.values() for name, stage in run_in_process(plan, results, stop).items()}
    from panoptic_ros.running.over_dds import run_over_dds  # needs ROS, the other way does not

    return run_over_dds(plan, results, stop, args.jpeg)
