"""Groups views into detection sets as the graph does, for recordings without a graph."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from panoptic_ros.domain import ClockModel, DetectionSet, ViewDetections
from panoptic_ros.graph.build import make_stage
from panoptic_ros.params import Config, config_of
from panoptic_ros.stage import Notice, StageContext
from panoptic_ros.sync.config import SyncConfig

MOST_WAITING = 100_000  # views of a camera that wait for a camera that begins late: an hour at 28 Hz
SINGLE_SHARE = 0.95  # share of sets with one view from which a file is not grouped


def grouped(
    configs: Mapping[str, Config], context: StageContext, items: Iterable[ViewDetections | ClockModel]
) -> tuple[list[DetectionSet], list[Notice]]:
    """Return the sets that sync makes of views and clock models, and its notices.

    Args:
        items: views side by side in time.
    """
    config = replace(config_of(configs, SyncConfig), queue_limit=MOST_WAITING)
    stage = make_stage("sync", config, context)
    steps = [*(stage.step(item) for item in items), stage.flush()]
    sets = [item for result in steps for item in result.outputs]
    return sets, [notice for result in steps for notice in result.notices]


def is_ungrouped(sets: Sequence[DetectionSet]) -> bool:
    """Return whether the views of several cameras come one per set."""
    cameras = {view.camera for item in sets for view in item.views}
    counts = [len(item.views) for item in sets if item.views]
    return len(cameras) > 1 and sum(count == 1 for count in counts) >= SINGLE_SHARE * len(counts)


def views_in_order(sets: Iterable[DetectionSet]) -> list[ViewDetections]:
    """Return the views of sets in the order of their timestamps."""
    return sorted((view for item in sets for view in item.views), key=lambda view: view.stamp_ns)
