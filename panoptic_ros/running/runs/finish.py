"""After a run: the report, and the pictures, video and plot that go with it.

What a run waits for that gives nothing yet.
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


class Waiting:
    """Tells a person who sees nothing happen why, once.

    Args:
        tell: called with the text, on a thread of its own.
    """

    def __init__(self, tell: Callable[[str], None]):
        self._tell = tell
        self._timer: threading.Timer | None = None
        self.counted: Mapping[str, Mapping[str, str]] = {}  # what nodes tell on /diagnostics

    def begin(self, seconds: float) -> None:
        """Wait so long from now, if nobody waits already."""
        if self._timer is None:
            self._timer = threading.Timer(seconds, lambda: self._tell(why_waiting(dict(self.counted))))
            self._timer.daemon = True
            self._timer.start()

    def end(self) -> None:
        """There is something to see."""
        if self._timer is not None:
            self._timer.cancel()


def why_waiting(counted: Mapping[str, Mapping[str, str]]) -> str:
    """What the first skeletons wait for, as nodes tell on /diagnostics: the first stage that waits."""
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
    """Return the place of a node in the graph by its name, e.g. detection_0; other nodes come last."""
    stage = name if name in NODES else name.rsplit("_", 1)[0]
    return list(NODES).index(stage) if stage in NODES else len(NODES)


LATEST = "latest."
TOO_SLOW = "take: disk_too_slow"  # messages that were not recorded
# notices of which report and console tell
TOLD = (
    "timecode.",
    "clocks.",
    "sync.clock_",
    "kinematics.",
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
        counted: what every node or stage counted, as on /diagnostics.
        notices: of the self-check.
        sets: the views of the run, see `grouped_views`.
        elapsed_s: how long the run took, without this.
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
    """Return the views of a run, grouped by the last clock models."""
    views = [view for own in results.views.values() for view in own]
    return regrouped(plan, results.clocks.values(), views)


def draw(
    plan: Plan, results: Results, sets: Sequence[DetectionSet], on_picture: Callable[[int, int], None]
) -> None:
    """Draw the plot, and of recordings overlays and their video.

    Args:
        sets: as of `finish`.
        on_picture: called with the number of pictures of the video that are done, and of all.
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
    """Whether the shape that is installed is one of these segments."""
    return model.names == read_body_model().names


def _dropped(counted: Mapping[str, Mapping[str, str]]) -> dict[str, int]:
    """{"stage: cause": messages}, of the causes that occurred."""
    found: dict[str, int] = {}
    for name, values in counted.items():
        for key, value in values.items():
            if key.startswith("dropped.") or key.startswith("notice.sync."):
                found[f"{name}: {key.split('.')[-1]}"] = int(value)
    return found


def _latencies(counted: Mapping[str, Mapping[str, str]]) -> dict[str, Latency]:
    """By node, in the order of the stages; several nodes of one stage are detection_0, detection_1, ..."""
    rows = {}
    for stage in NODES:
        for name in sorted(name for name in counted if name.rsplit("_", 1)[0] == stage):
            values = counted[name]
            if int(values.get("taken", 0)) and "step_p50_ms" in values and "step_p99_ms" in values:
                p50, p99 = float(values["step_p50_ms"]), float(values["step_p99_ms"])
                rows[name] = Latency(int(values["taken"]), p50, p99)
    return rows


def warnings_of(counted: Mapping[str, Mapping[str, str]]) -> list[Notice]:
    """Return the newest warning of each kind, and of each device where it is about devices.

    Of several nodes that warn of one device, the one that is first in the graph counts.

    Args:
        counted: by node, as on /diagnostics.
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
    """Frames and messages that all nodes together have dropped."""
    return sum(
        int(number)
        for values in counted.values()
        for key, number in values.items()
        if key.startswith("dropped.")
    )


def _plan_notices(plan: Plan) -> list[Notice]:
    return [Notice(f"capture.{i}", "info", text) for i, text in enumerate(plan.notices)]


def _newest_only(results: Results) -> list[Notice]:
    """Said where the report is not about everything."""
    if results.instants <= len(results.poses):
        return []
    text = (
        f"people, errors and frames out are those of the last {len(results.poses)} of {results.instants} "
        "instants; skeletons.json.gz and the bag hold all"
    )
    return [Notice("run.newest_only", "info", text)]


def _clock_notices(plan: Plan, results: Results) -> list[Notice]:
    """What was found of the clocks, where that was asked for."""
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
