"""Runs a plan: its stages or nodes, the self-check of the calibration, the report and the pictures.

A run over recordings leaves all of its results or none. A live run has no end of its own: a request to end
(e.g. Ctrl-C), a camera fault or a bug ends the recording. The take is closed first. Report and pictures
follow, and no error in them changes the take. A `RunObserver` follows the course of a run.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from panoptic_ros.domain import DetectionSet
from panoptic_ros.errors import ContractError, PanopticError
from panoptic_ros.evaluation.free_running import free_running
from panoptic_ros.io.folders import MARK
from panoptic_ros.io.interruption import first_request_told, interrupted, requests_held
from panoptic_ros.running.plans.duration import ended_after
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.processes.children import NOBODY_AHEAD, LaunchPreparation
from panoptic_ros.running.runs.finish import draw, finish, grouped_views
from panoptic_ros.running.runs.in_process import OfflineResults, run_in_process
from panoptic_ros.running.runs.launch import without_patch_inputs
from panoptic_ros.running.runs.result_folder import LiveFolder, files_below, open_live_folder, result_folder
from panoptic_ros.running.runs.results import BAG, MADE, SKELETONS_AT, Results, is_kept
from panoptic_ros.running.runs.startup_check import StartupCheck
from panoptic_ros.stage import Notice
from panoptic_ros.view.report import RunReport


class RunObserver:
    """Observer of a run. The methods of this base class do nothing; subclasses display the course of the run.

    The run calls all methods in its own thread.
    """

    def started(self, plan: Plan) -> None:
        """Handle the start of the run."""

    def saw(self, key: str, record: Any) -> None:
        """Receive a record of the topic with that key; "diagnostics" carries the counters of all nodes."""

    def judged(self, notices: Sequence[Notice]) -> None:
        """Receive the result of the calibration self-check, during the run or after the last record."""

    def ended(self) -> None:
        """Handle the end of the records. The self-check, if still due, and the pictures follow."""

    def drew(self, done: int, total: int) -> None:
        """Receive the number of finished pictures and their total number."""


NOBODY = RunObserver()


@dataclass(frozen=True)
class RunOutcome:
    """Outcome of a run.

    Args:
        report: Content of report.json; None if it could not be made (live only).
        files: Names of the files and folders in the result folder.
        fault: The error that ended a live run, whose results up to then were written; None = no error.
        troubles: One line about each item that could not be made after a live take was closed.
    """

    report: RunReport | None
    files: tuple[str, ...]
    fault: PanopticError | None = None
    troubles: tuple[str, ...] = ()


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
    ahead: LaunchPreparation = NOBODY_AHEAD,
) -> RunOutcome:
    """Run a plan to its end and leave the results in a folder.

    Args:
        out: Result folder. A live run needs a new or empty folder. Otherwise, files of an earlier run there
            are replaced.
        in_process: Run all stages in this process, without ROS; else run nodes in child processes.
        offline: As `in_process`, and refine the skeletons over the whole recording.
        jpeg_quality: 1-100: images are sent to other processes as JPEG; 0: uncompressed.
        node_per_stage: Live: a node and a process per stage after detection, instead of one for all of them.
        duration_s: Duration, s. It counts from the first timestamp of a recording. In a live run, it counts
            from the first record, or from the start if no record arrives. None = no limit.
        pictures: Also draw overlays, a video and a plot.
        observer: Follows the course of the run.
        ahead: Preloaded process that becomes a process of the graph.

    Raises:
        UserError: on any fault that the user can fix. Nothing is left in `out` then.
        KeyboardInterrupt: if a live run was asked to end before it recorded anything.
    """
    how = _Options(in_process, offline, jpeg_quality, node_per_stage, duration_s, pictures, observer, ahead)
    told: tuple[Notice, ...] = ()
    if not (in_process or offline):
        plan, told = without_patch_inputs(plan)
        observer.judged(told)
    if duration_s is not None and not plan.live:
        plan = ended_after(plan, duration_s)
    if plan.live:
        return _run_live(plan, open_live_folder(Path(out)), how, told)
    with result_folder(Path(out)) as folder:
        started = time.monotonic()
        watch = _RunMonitor(plan, observer, interrupted)
        with Results(folder, plan, watch.saw, pictures) as results:
            observer.started(plan)
            counted = _counted(plan, results, watch.stop, how)
            if interrupted():
                raise KeyboardInterrupt
        observer.ended()
        notices = (*told, *watch.check.judge())
        elapsed_s = time.monotonic() - started
        sets = grouped_views(plan, results)
        notices += _hint(plan.configs, sets, Path(out))
        report = finish(plan, results, counted, notices, sets, elapsed_s=elapsed_s)
        if pictures:
            draw(plan, results, sets, observer.drew)
        report = replace(report, files=sorted([*files_below(folder), MARK]))
        report.write(folder / MARK)
        names = tuple(sorted(path.name for path in folder.iterdir()))
    return RunOutcome(report, names)


@dataclass(frozen=True)
class _Options:
    """Options of `run`."""

    in_process: bool
    offline: bool
    jpeg_quality: int
    node_per_stage: bool
    duration_s: float | None
    pictures: bool
    observer: RunObserver
    ahead: LaunchPreparation


class _RunMonitor:
    """Passes records to the observer and the self-check, and decides when a run stops.

    Args:
        asked: returns whether a request to end has arrived.
        duration_s: duration limit, s; None = no limit.
    """

    def __init__(
        self, plan: Plan, observer: RunObserver, asked: Callable[[], bool], duration_s: float | None = None
    ):
        self._observer, self._asked = observer, asked
        self._duration_s = float("inf") if duration_s is None else duration_s
        self._has_begun, self._end_s = False, time.monotonic() + self._duration_s
        self.check = StartupCheck(plan, observer.judged)

    def saw(self, key: str, record: Any) -> None:
        """Receive a record of the topic with that key.

        The first record with a timestamp starts the duration limit.
        """
        if not self._has_begun and hasattr(record, "stamp_ns"):
            self._has_begun, self._end_s = True, time.monotonic() + self._duration_s
        self._observer.saw(key, record)
        self.check.saw(key, record)

    def stop(self) -> bool:
        """Return whether the run must end now."""
        return self._asked() or time.monotonic() > self._end_s


class _IsolatedObserver:
    """Wrapper that isolates a live take from errors of an observer. The first error ends the observation.

    Args:
        look: the observer, called with key and record.
        troubles: receives one line about the error.
    """

    def __init__(self, look: Callable[[str, Any], None], troubles: list[str]):
        self._look: Callable[[str, Any], None] | None = look
        self._troubles = troubles

    def saw(self, key: str, record: Any) -> None:
        """Pass on a record of the topic with that key."""
        if self._look is not None:
            try:
                self._look(key, record)
            except Exception as error:
                self._look = None
                self._troubles.append(f"the display ended ({_in_short(error)})")


def _run_live(plan: Plan, folder: LiveFolder, how: _Options, told: tuple[Notice, ...]) -> RunOutcome:
    """Record until a request to end or an error; close the take, then make the report.

    Raises:
        KeyboardInterrupt, PanopticError: if the run ended before anything was recorded. The folder is deleted
            then.
        PanopticError: if the take could not be closed. It stays and is marked open.
    """
    started = time.monotonic()
    troubles: list[str] = []
    counted: Counted = {}
    ended_by: BaseException | None = None
    with first_request_told() as asked:
        watch = _RunMonitor(plan, how.observer, asked, how.duration_s)
        try:
            results = Results(folder.path, plan, _IsolatedObserver(watch.saw, troubles).saw, how.pictures)
        except BaseException:
            folder.give_up(MADE)
            raise
        try:
            how.observer.started(plan)
            counted = _counted(plan, results, lambda: watch.stop() or results.fault is not None, how)
        except BaseException as error:  # on any error, the recording is closed below
            ended_by = error
        with requests_held():
            recorded = results.recorded
            fault = _close(results, folder)
            if not recorded and (asked() or ended_by is not None):
                folder.give_up(MADE)
                raise ended_by or KeyboardInterrupt
        if not isinstance(fault, PanopticError) and ended_by is not None:
            fault = _told(ended_by)
        report, more = _report_live(plan, results, counted, told, watch, how, started)
    names = tuple(sorted(path.name for path in folder.path.iterdir()))
    return RunOutcome(report, names, fault, (*troubles, *more))


def _close(results: Results, folder: LiveFolder) -> PanopticError | None:
    """Close a take; return the error that ended it early or prevented closing.

    A take that could not be closed stays marked open.
    """
    try:
        results.close()
    except PanopticError as error:
        folder.leave()
        return type(error)(
            f"{error}; the take is not closed, `panoptic bag repair {folder.path}` saves what was recorded"
        )
    folder.close()
    return results.fault


def _report_live(
    plan: Plan,
    results: Results,
    counted: Counted,
    told: tuple[Notice, ...],
    watch: _RunMonitor,
    how: _Options,
    started: float,
) -> tuple[RunReport | None, list[str]]:
    """Make the report and the pictures of a closed take. Errors and requests to end do not affect the take.

    Returns:
        the report, and a line about each item that could not be made.
    """
    report: RunReport | None = None
    troubles: list[str] = []
    doing = "report"
    try:
        how.observer.ended()
        notices = (*told, *watch.check.judge())
        elapsed_s = time.monotonic() - started
        sets = grouped_views(plan, results)
        notices += _hint(plan.configs, sets, results.folder)
        report = finish(plan, results, counted, notices, sets, elapsed_s=elapsed_s)
        report.write(results.folder / MARK)
        if how.pictures:
            doing = "pictures"
            draw(plan, results, sets, how.observer.drew)
        doing = "report"
        report = replace(report, files=sorted({*files_below(results.folder), MARK}))
        report.write(results.folder / MARK)
    except KeyboardInterrupt:
        troubles.append(f"the {doing} were interrupted; the take is whole")
    except Exception as error:
        troubles.append(f"the {doing} could not be made ({_in_short(error)}); the take is whole")
    return report, troubles


def _hint(configs: Mapping[str, Any], sets: Sequence[DetectionSet], out: Path) -> tuple[Notice, ...]:
    """Return a notice if another command suits the cameras better.

    Args:
        configs: parameters of the stages.
        out: folder of the results.
    """
    found = free_running(sets)
    if found is None:
        return ()
    command = f"`panoptic continuous --bag {out / BAG} --out {out / 'continuous.json.gz'}`"
    given = f"{out / SKELETONS_AT} or " if is_kept(configs, "skeletons_at") else ""
    return (Notice("run.free_running", "warning", f"{found}; use {given}{command}"),)


def _told(error: BaseException) -> PanopticError | None:
    """Return the PanopticError for the cause that ended a live run; None for a request to end."""
    if isinstance(error, PanopticError):
        return error
    if isinstance(error, KeyboardInterrupt):
        return None
    return ContractError(f"the run broke down ({_in_short(error)}); the take is whole up to then")


def _in_short(error: BaseException) -> str:
    """Return type and text of an error in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}".rstrip(": ")


Counted = Mapping[str, Mapping[str, str]]  # counters of every stage or node


def _counted(plan: Plan, results: Results, stop: Callable[[], bool], how: _Options) -> Counted:
    if not (how.in_process or how.offline):
        return _over_dds(plan, results, stop, how)
    taker = OfflineResults(plan, results) if how.offline else results
    counted = {name: stage.values() for name, stage in run_in_process(plan, taker, stop).items()}
    if isinstance(taker, OfflineResults):
        taker.flush()
    return counted


def _over_dds(plan: Plan, results: Results, stop: Callable[[], bool], how: _Options) -> Counted:
    from panoptic_ros.running.runs.over_dds import run_over_dds  # needs ROS, which in-process runs do not

    return run_over_dds(plan, results, stop, how.jpeg_quality, how.node_per_stage, how.ahead)
