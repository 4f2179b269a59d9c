"""Makes the report of a run, and its pictures, video and plot.

This module also explains to a waiting user why no skeletons have arrived yet.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack

from panoptic_ros.capture import open_source
from panoptic_ros.domain import DetectionSet
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.evaluation.capture_report import summarise_capture
from panoptic_ros.evaluation.nobody import why_nobody
from panoptic_ros.graph.counters import OF
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.io.body_models import read_body_model, read_body_shape
from panoptic_ros.offsets.config import OffsetsConfig
from panoptic_ros.params import config_of
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.runs.results import Results
from panoptic_ros.running.runs.startup_check import regrouped
from panoptic_ros.stage import Notice
from panoptic_ros.view.body_drawing import BodySurfaces, ShapedBodies
from panoptic_ros.view.overlay_run import OverlayRun
from panoptic_ros.view.report import Latency, RunReport


class NoOutputTimer:
    """Timer that explains once why a run has no output yet.

    Args:
        tell: callback with the explanation, called in a separate thread.
    """

    def __init__(self, tell: Callable[[str], None]):
        self._tell = tell
        self._timer: threading.Timer | None = None
        # counters that nodes publish on /diagnostics, by node
        self.counted: Mapping[str, Mapping[str, str]] = {}

    def begin(self, seconds: float) -> None:
        """Start the timer, unless it runs already.

        Args:
            seconds: delay before the explanation.
        """
        if self._timer is None:
            self._timer = threading.Timer(seconds, lambda: self._tell(why_waiting(dict(self.counted))))
            self._timer.daemon = True
            self._timer.start()

    def end(self) -> None:
        """Cancel the timer, as output has arrived."""
        if self._timer is not None:
            self._timer.cancel()


def why_waiting(counted: Mapping[str, Mapping[str, str]]) -> str:
    """Return the reason why the first skeletons are not there yet.

    It names the first stage that reports `waiting_for`, or states that kernels are being compiled.

    Args:
        counted: counters by node, as on /diagnostics.
    """
    waits = [name for name, values in counted.items() if values.get("waiting_for")]
    if waits and not any(values.get("compiling") for values in counted.values()):
        first = min(waits, key=stage_order)
        return (
            f"waiting for the first skeletons: {first} waits for {counted[first]['waiting_for']}; "
            "`panoptic watch` shows more"
        )
    return (
        "waiting for the first skeletons: kernels are compiled once after an installation, which takes about "
        "a minute"
    )


def stage_order(name: str) -> int:
    """Return the position of a node in the graph by its name, e.g. detection_0. Other nodes come last."""
    stage = name if name in NODES else name.rsplit("_", 1)[0]
    return list(NODES).index(stage) if stage in NODES else len(NODES)


LATEST = "latest."
TOO_SLOW = "take: disk_too_slow"  # counts messages that were not recorded
# prefixes of the notice codes that appear in report and console
TOLD = (
    "timecode.",
    "clocks.",
    "sync.clock_",
    "kinematics.",
    "health.",
    "graph.lossy",
    "graph.incompatible_qos",
    "graph.unusable",
    "graph.encoding",
    "source.bad_message",
    "source.damaged",
    "source.patched",
    "source.repaired",
)


def finish(
    plan: Plan,
    results: Results,
    counted: Mapping[str, Mapping[str, str]],
    notices: Sequence[Notice],
    sets: Sequence[DetectionSet],
    *,
    elapsed_s: float,
) -> RunReport:
    """Return the report of a run.

    Args:
        counted: Counters of every node or stage, as on /diagnostics.
        notices: Notices of the self-check.
        sets: Detection sets of the run, see `grouped_views`.
        elapsed_s: Duration of the run, s, without this function.
    """
    summary = summarise_capture(plan.rig, plan.skeleton, list(results.poses), list(sets))
    found = sum(len(item.ids) for item in results.poses)
    warnings = [notice for notice in notices if notice.severity != "info"]
    return RunReport(
        summary,
        frames_in=dict(results.frames_in),
        dropped=_dropped(counted) | ({TOO_SLOW: results.dropped} if results.dropped else {}),
        latency_ms=_latencies(counted),
        notices=[
            *_plan_notices(plan),
            *_newest_only(results),
            *_clock_notices(plan, results),
            *warnings_of(counted),
            *notices,
            *why_nobody(sets, found, warnings),
        ],
        facts={"source": plan.title, "elapsed_s": round(elapsed_s, 2)},
        bodies=results.bodies.document() if results.bodies.instants else {},
    )


def grouped_views(plan: Plan, results: Results) -> list[DetectionSet]:
    """Return the views of a run as detection sets, grouped by the final clock models."""
    views = [view for own in results.views.values() for view in own]
    return regrouped(plan, results.clocks.values(), views)


def draw(
    plan: Plan, results: Results, sets: Sequence[DetectionSet], on_picture: Callable[[int, int], None]
) -> None:
    """Draw the plot. For recordings that are not bags, also draw the overlays and their video.

    Args:
        sets: as for `finish`.
        on_picture: callback with the number of finished video pictures and their total number.
    """
    if not plan.rig.cameras:
        return
    path = results.folder / "skeletons.png"
    from panoptic_ros.view.plot3d import plot_capture  # matplotlib takes half a second to load

    model = plan.extras.get("segments")
    bodies = None
    if model is not None and _has_shape(model):
        bodies = ShapedBodies(list(results.drawn), BodySurfaces(read_body_shape(model)))
    plot_capture(path, plan.rig, plan.skeleton, list(results.poses), title=plan.title, bodies=bodies)
    if plan.live or plan.streams:
        return
    with ExitStack() as stack:
        sources = [
            stack.enter_context(open_source(name, plan.rig, plan.sources[name])[0]) for name in plan.rig.names
        ]
        OverlayRun(plan.rig, plan.skeleton, bodies).write(
            results.folder,
            sources,
            list(sets),
            list(results.poses),
            on_frame=lambda done: on_picture(done, len(sets)),
        )


def _has_shape(model: SegmentModel) -> bool:
    """Return whether the installed body shape belongs to this segment model."""
    return model.names == read_body_model().names


def _dropped(counted: Mapping[str, Mapping[str, str]]) -> dict[str, int]:
    """Return the counts {"stage: cause": messages} of dropped messages and sync notices that occurred."""
    found: dict[str, int] = {}
    for name, values in counted.items():
        for key, value in values.items():
            if key.startswith("dropped.") or key.startswith("notice.sync."):
                found[f"{name}: {key.split('.')[-1]}"] = int(value)
    return found


def _latencies(counted: Mapping[str, Mapping[str, str]]) -> dict[str, Latency]:
    """Return the latencies by node, in the order of the stages.

    Several nodes of one stage are named detection_0, detection_1, ...
    """
    rows = {}
    for stage in NODES:
        for name in sorted(name for name in counted if name.rsplit("_", 1)[0] == stage):
            values = counted[name]
            if int(values.get("taken", 0)) and "step_p50_ms" in values and "step_p99_ms" in values:
                p50, p99 = float(values["step_p50_ms"]), float(values["step_p99_ms"])
                rows[name] = Latency(int(values["taken"]), p50, p99)
    return rows


def warnings_of(counted: Mapping[str, Mapping[str, str]]) -> list[Notice]:
    """Return the newest warning of each kind, separately for each device where a warning names a device.

    If several nodes warn about one device, the first node in the graph counts.

    Args:
        counted: counters by node, as on /diagnostics.
    """
    found: dict[tuple[str, str], str] = {}
    for name in sorted(counted, key=stage_order):
        for key, text in counted[name].items():
            if key.startswith(LATEST):
                code, _, device = key.removeprefix(LATEST).partition(OF)
                found.setdefault((code, device), text)
    by_device = {code for code, device in found if device}
    return [
        Notice(code, "warning", text, {"device": device} if device else {})
        for (code, device), text in found.items()
        if code.startswith(TOLD) and (device or code not in by_device)
    ]


def dropped_in_all(counted: Mapping[str, Mapping[str, str]]) -> int:
    """Return the number of frames and messages that all nodes together have dropped."""
    return sum(
        int(number)
        for values in counted.values()
        for key, number in values.items()
        if key.startswith("dropped.")
    )


def _plan_notices(plan: Plan) -> list[Notice]:
    return [Notice(f"capture.{i}", "info", text) for i, text in enumerate(plan.notices)]


def _newest_only(results: Results) -> list[Notice]:
    """Return a notice if the report covers only the newest part of the run."""
    if results.instants <= len(results.poses):
        return []
    text = (
        f"people, errors and frames out are those of the last {len(results.poses)} of "
        f"{results.instants} instants; skeletons.json.gz and the bag contain all"
    )
    return [Notice("run.newest_only", "info", text)]


def _clock_notices(plan: Plan, results: Results) -> list[Notice]:
    """Return a notice about the clock offsets that were found, if estimation from motion is switched on."""
    if not config_of(plan.configs, OffsetsConfig).active:
        return []
    found = [
        f"{name} {1e-6 * model.offset_ns:+.2f} ms +- {1e3 * model.covariance[0, 0] ** 0.5:.2f}"
        for name, model in sorted(results.clocks.items())
        if name in plan.rig.names
    ]
    kept = [name for name in plan.rig.names if name not in results.clocks]
    words = (", ".join(names) or "none" for names in (found, kept))
    return [Notice("offsets.found", "info", "stamps corrected from motion: {}; kept: {}".format(*words))]
