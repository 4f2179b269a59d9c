"""Processor time of detection by part: network, other work per image, propagation without the network."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.detection.stage import DetectionStage
from panoptic_ros.domain import DepthFrame, TrackSet, ViewDetections, ViewFrame
from panoptic_ros.graph.nodes import NODES, NodeSpec
from panoptic_ros.stage import StageContext, StepResult

TABLE: Mapping[str, NodeSpec] = {
    **NODES,
    "detection": replace(NODES["detection"], stage=f"{__name__}:TimedStage"),
}


@dataclass
class Costs:
    """Processor time in ns of the detection stage, by type of image.

    Args:
        counting: True = images count now.
        looked, looked_ns: images with a network run.
        network_ns: the network alone.
        carried, carried_ns: images without a network run, whose detections are propagated.
    """

    counting: bool = False
    looked: int = 0
    looked_ns: int = 0
    network_ns: int = 0
    carried: int = 0
    carried_ns: int = 0

    @property
    def beside_ms(self) -> float | None:
        """Return the mean time (ms) of an image with a network run, without the network itself.

        It consists of preprocessing, decoding of outputs and score maps. None without such images.
        """
        return 1e-6 * (self.looked_ns - self.network_ns) / self.looked if self.looked else None

    @property
    def carry_ms(self) -> float | None:
        """Return the mean time (ms) of an image without a network run; None without such images."""
        return 1e-6 * self.carried_ns / self.carried if self.carried else None


class TimedStage(DetectionStage):
    """Detection stage that adds the time of its images to the extra "costs", a `Costs`."""

    def __init__(self, config: DetectionConfig, context: StageContext):
        super().__init__(config, context)
        self._costs: Costs = context.extras["costs"]
        self._session = _TimedSession(self.network.session)
        self.network.session = self._session  # type: ignore[assignment]  # has what detectors use

    def step(self, item: ViewFrame | DepthFrame | TrackSet) -> StepResult[ViewDetections]:
        """Run the stage and count the time if the item is an image."""
        if not isinstance(item, ViewFrame) or not self._costs.counting:
            return super().step(item)
        network, start = self._session.spent_ns, time.thread_time_ns()
        result = super().step(item)
        spent, network = time.thread_time_ns() - start, self._session.spent_ns - network
        if network:
            self._costs.looked, self._costs.looked_ns = self._costs.looked + 1, self._costs.looked_ns + spent
            self._costs.network_ns += network
        else:
            self._costs.carried += 1
            self._costs.carried_ns += spent
        return result


class _TimedSession:
    """Network session that sums up its processor time."""

    def __init__(self, session: Any):
        self._session, self.spent_ns = session, 0
        self.batch_limit = session.batch_limit

    def run(self, tensor: np.ndarray) -> dict[str, np.ndarray]:
        """Run the network."""
        start = time.thread_time_ns()
        outputs: dict[str, np.ndarray] = self._session.run(tensor)
        self.spent_ns += time.thread_time_ns() - start
        return outputs
