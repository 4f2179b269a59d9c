"""What only runs in one process do: refine over the whole recording, and patches with recorded inputs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from panoptic_ros.graph.refinement_pass import refinement_of
from panoptic_ros.io.bag_streams import SENSOR_KEYS, TRACKS_KEY
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.runs.results import Results
from panoptic_ros.stage import Notice, StageContext

TAKEN = ("patch_tracks", "sensor_depth", "skeletons_raw")


class OfflineResults:
    """Takes the records of a run in one process; its own refinement stands in for the smoother with a lag."""

    def __init__(self, plan: Plan, results: Results):
        self._results = results
        self._refinement = refinement_of(plan.configs, StageContext(plan.rig, plan.skeleton, plan.extras))

    def take(self, key: str, record: Any) -> None:
        """See `Results`."""
        if key != "skeletons":
            self._results.take(key, record)
        if key in TAKEN:
            for output in self._refinement.take(record):
                self._results.take("skeletons", output)

    def flush(self) -> None:
        """The rest of the skeletons."""
        for output in self._refinement.flush():
            self._results.take("skeletons", output)


def without_patch_inputs(plan: Plan) -> tuple[Plan, tuple[Notice, ...]]:
    """The plan of a run over several processes, without recorded depth maps and 2D tracks; says so."""
    left = tuple(stream for stream in plan.streams if stream.key not in (*SENSOR_KEYS, TRACKS_KEY))
    if not plan.maps and left == plan.streams:
        return plan, ()
    text = "patches go without recorded depth maps and 2D tracks here: add --in-process or --offline"
    return replace(plan, maps=(), streams=left), (Notice("patches.inputs_left_out", "warning", text),)
