"""Refinement of a whole recording as a pass, by the method that is configured."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from heapq import merge

from panoptic_ros.domain import DepthFrame, PatchTracks, RefinedPoseSet, TrackedPoseSet
from panoptic_ros.graph.offline_averaging import OfflineAveraging
from panoptic_ros.graph.offline_refinement import OfflineRefinement, Taken
from panoptic_ros.params import Config, config_of
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.stage import Progress, Recording, StageContext

ORDER = {PatchTracks: 0, DepthFrame: 1, TrackedPoseSet: 2}  # of records of the same stamp


def refinement_of(
    configs: Mapping[str, Config], context: StageContext
) -> OfflineRefinement | OfflineAveraging:
    """What refines a whole recording.

    Raises:
        UsageError: if the configuration asks for what is not possible offline.
    """
    averages = config_of(configs, RefinementConfig).method == "averaging"
    return OfflineAveraging(configs, context) if averages else OfflineRefinement(configs, context)


class RefinementPass:
    """All of a recording, refined: a `stage.Pass`."""

    def __init__(self, config: Mapping[str, Config], context: StageContext):
        self._configs, self._context = config, context

    def run(self, recording: Recording, progress: Progress) -> tuple[RefinedPoseSet, ...]:
        """Skeletons of every set; reads `skeletons_raw`, and `patch_tracks` and `sensor_depth` if there."""
        refinement, rig = refinement_of(self._configs, self._context), self._context.rig
        count = max(1, sum(1 for _ in recording.records("skeletons_raw")))
        streams: list[Iterable[Taken]] = [recording.records("patch_tracks", name) for name in rig.names]
        streams += [recording.records("sensor_depth", sensor.name) for sensor in rig.depth_sensors]
        streams.append(recording.records("skeletons_raw"))
        found: list[RefinedPoseSet] = []
        for item in merge(*streams, key=_place):
            found += refinement.take(item)
            progress(min(1.0, len(found) / count), "refining")
        found += refinement.flush()
        progress(1.0, "refining")
        return tuple(found)


def _place(item: Taken) -> tuple[int, int]:
    return item.stamp_ns, next(order for kind, order in ORDER.items() if isinstance(item, kind))
