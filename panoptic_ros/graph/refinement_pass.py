"""Refinement of a whole recording by the method that is configured."""

from __future__ import annotations

from collections.abc import Mapping

from panoptic_ros.graph.offline_averaging import OfflineAveraging
from panoptic_ros.graph.offline_refinement import OfflineRefinement
from panoptic_ros.params import Config, config_of
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.stage import StageContext


def refinement_of(
    configs: Mapping[str, Config], context: StageContext
) -> OfflineRefinement | OfflineAveraging:
    """What refines a whole recording.

    Raises:
        UsageError: if the configuration asks for what is not possible offline.
    """
    averages = config_of(configs, RefinementConfig).method == "averaging"
    return OfflineAveraging(configs, context) if averages else OfflineRefinement(configs, context)
