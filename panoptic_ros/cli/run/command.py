"""The course of a run: plan, run, finish; whatever happens, no half-written results stay."""
from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from typing import Any

from panoptic_ros.cli.run.finish import finish
from panoptic_ros.cli.run.in_process import run_in_process
from panoptic_ros.cli.run.plan import Plan
from panoptic_ros.cli.run.planning import make_plan
from panoptic_ros.cli.run.results import Results, result_folder
from panoptic_ros.cli.run.startup_check import StartupCheck
from panoptic_ros.cli.run.watch import Watch


def execute(args: argparse.Namespace) -> int:
    """`panoptic run` with its arguments."""
    plan = make_plan(args)
    started = time.monotonic()

    def stop() -> bool:
        return args.duration is not None and time.monotonic() - started > args.duration

    with result_folder(args.out) as folder, Watch(plan, args.live_view) as watch:
        check = StartupCheck(plan)

        def saw(key: str, record: Any) -> None:
            watch.saw(key, record)
            check.saw(key, record)

        with Results(folder, plan, saw) as results:
            counted = _run(plan, results, stop, args)
        watch.close()
        notices = check.judge()
        elapsed_s = time.monotonic() - started
        finish(
            plan, results, counted, notices,
            pictures=not args.no_pictures, elapsed_s=elapsed_s, out=args.out,
        )  # fmt: skip
    return 0


def _run(
    plan: Plan, results: Results, stop: Callable[[], bool], args: argparse.Namespace
) -> Mapping[str, Mapping[str, str]]:
    if args.in_process:
        return {name: stage.values() for name, stage in run_in_process(plan, results, stop).items()}
    from panoptic_ros.cli.run.over_dds import run_over_dds  # needs ROS, the other way does not

    return run_over_dds(plan, results, stop, args.jpeg)
