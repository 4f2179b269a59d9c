"""The course of a run: its stages or nodes, the self-check, the report.

Whatever happens, no half-written results stay. A live run has no end of its own: being asked to end, as by
Ctrl-C, or a fault of a camera ends the recording, and what it has is written.
"""
from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from panoptic_ros.errors import PanopticError
from panoptic_ros.io.interruption import first_request_told
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.processes.children import NOBODY_AHEAD, Ahead
from panoptic_ros.running.runs.finish import finish
from panoptic_ros.running.runs.in_process import run_in_process
from panoptic_ros.running.runs.observer import RunObserver
from panoptic_ros.running.runs.offline import OfflineResults, without_patch_inputs
from panoptic_ros.running.runs.results import Results, result_folder
from panoptic_ros.running.runs.startup_check import StartupCheck
from panoptic_ros.stage import Notice
from panoptic_ros.view.report import RunReport

NOBODY = RunObserver()


@dataclass(frozen=True)
class RunOutcome:
    """What a run came to.

    Args:
        report: as it stands in report.json.
        files: names of what was written to the folder.
        fault: what ended a live run, whose results up to then were written; None if nothing did.
    """

    report: RunReport
    files: tuple[str, ...]
    fault: PanopticError | None = None


def run(
    plan: Plan,
    out: Path,
    *,
    in_process: bool = False,
    offline: bool = False,
    jpeg_quality: int = 0,
    node_per_stage: bool = False,
    duration_s: float | None = None,
    pictures: bool = True,
    observer: RunObserver = NOBODY,
    ahead: Ahead = NOBODY_AHEAD,
) -> RunOutcome:
    """Run a plan to its end and leave the results in a folder.

    Args:
        out: is made, or replaced if it holds the results of a run.
        in_process: all stages in this process, without ROS; else nodes in processes of their own.
        offline: the same, and skeletons are refined over the whole recording.
        jpeg_quality: 1-100: images are sent to other processes as JPEG; 0: as they are.
        node_per_stage: a node and a process for every stage after detection, in place of one for all.
        duration_s: stop after so many seconds.
        pictures: also draw overlays, a video and a plot.
        observer: is told what goes on.
        ahead: becomes a process of the graph.

    Raises:
        UserError: on whatever the user can mend; nothing is left in `out` then.
        KeyboardInterrupt: if a live run was asked to end before there was anything.
    """
    started = time.monotonic()
    fault: PanopticError | None = None
    told: tuple[Notice, ...] = ()
    if not (in_process or offline):
        plan, told = without_patch_inputs(plan)
        observer.judged(told)
    with first_request_told(plan.live) as asked, result_folder(out) as folder:
        observer.started(plan)
        check = StartupCheck(plan, observer.judged)

        def saw(key: str, record: Any) -> None:
            observer.saw(key, record)
            check.saw(key, record)

        def stop() -> bool:
            return asked() or (duration_s is not None and time.monotonic() - started > duration_s)

        with Results(folder, plan, saw, pictures) as results:
            try:
                counted = (
                    _in_process(plan, results, stop, offline) if in_process or offline
                    else _over_dds(plan, results, stop, jpeg_quality, node_per_stage, ahead)
                )  # fmt: skip
            except PanopticError as error:
                if not (plan.live and results.has_something):
                    raise
                counted, fault = {}, error
            if asked() and not (plan.live and results.has_something):
                raise KeyboardInterrupt
        observer.ended()
        notices = (*told, *check.judge())
        elapsed_s = time.monotonic() - started
        report = finish(
            plan, results, counted, notices, pictures=pictures, elapsed_s=elapsed_s, on_picture=observer.drew
        )
        files = tuple(sorted(path.name for path in folder.iterdir()))
    return RunOutcome(report, files, fault)


Counted = Mapping[str, Mapping[str, str]]  # what every stage or node counted


def _in_process(plan: Plan, results: Results, stop: Callable[[], bool], offline: bool) -> Counted:
    taker = OfflineResults(plan, results) if offline else results
    counted = {name: stage.values() for name, stage in run_in_process(plan, taker, stop).items()}
    if isinstance(taker, OfflineResults):
        taker.flush()
    return counted


def _over_dds(
    plan: Plan, results: Results, stop: Callable[[], bool], jpeg_quality: int, node_per_stage: bool,
    ahead: Ahead,
) -> Counted:
    from panoptic_ros.running.runs.over_dds import run_over_dds  # needs ROS, the other way does not

    return run_over_dds(plan, results, stop, jpeg_quality, node_per_stage, ahead)
