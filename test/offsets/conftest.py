"""People whose joints move as told before cameras whose clocks are off by known amounts."""

import numpy as np
import pytest
from rolling import rolling_points, with_line_delays

from panoptic_ros.domain import DetectionSet, JointState, TrackedPoseSet, ViewDetections
from panoptic_ros.simulation import simulate
from panoptic_ros.simulation.scenes import scene
from panoptic_ros.simulation.skeleton import SKELETON
from panoptic_ros.stage import StageContext

RATE, START = 30.0, 5_000_000_000
OFFSETS = np.array([0.05, -0.02, 0.0, -0.045, 0.015])  # s, mean 0


class Capture:
    """A ring of five cameras and the truth of two people, moving as much as `motion` says."""

    def __init__(
        self,
        motion=1.0,
        noise_px=1.0,
        seconds=3.0,
        offsets=OFFSETS,
        drift=0.0,
        bias_px=0.0,
        line_delays_us=(0.0,),
    ):
        take = simulate(scene("clean-4p5v"), 1, 2)
        self.rig, self.skeleton = with_line_delays(take.rig, line_delays_us), SKELETON
        self.context = StageContext(self.rig, SKELETON)
        self.motion, self.offsets = motion, offsets
        self._shape = take.people[0].joints(np.zeros(1))[0]
        self._shape -= [*self._shape[2, :2], 0.0]
        frames = int(seconds * RATE)
        self.ticks = START + (np.arange(frames) * 1e9 / RATE).astype(np.int64)
        rng = np.random.default_rng(3)
        self._bias = bias_px * np.random.default_rng(8).standard_normal((len(self.rig), 2, 19, 2))
        self.sets = [self._set(i, tick, noise_px, drift, rng) for i, tick in enumerate(self.ticks)]
        self.tracked = [self._poses(i, tick) for i, tick in enumerate(self.ticks)]

    def joints(self, time):
        """(2, 19, 3) m at a time in s."""
        sway = [np.sin(3.1 * time), np.sin(2.3 * time + 1.0), 0.1 * np.sin(7.0 * time)]
        first = self._shape + [-0.7, 0.2, 0.0] + self.motion * 0.4 * np.array(sway)
        return np.stack([first, self._shape + [0.8, -0.3, 0.0] + self.motion * 0.3 * np.array(sway[::-1])])

    def _set(self, index, tick, noise_px, drift, rng):
        views = []
        for c, camera in enumerate(self.rig.cameras):
            true = 1e-9 * (tick - START) + self.offsets[c]  # its stamp says `tick`
            true += drift * (c - 2) * (1e-9 * (tick - START) - 1.5)
            _, seen = camera.project(self.joints(true))
            points = rolling_points(camera, self.joints, true)
            points = points + self._bias[c] + noise_px * rng.standard_normal(points.shape)
            usable = seen & camera.contains(points)
            scores = np.where(usable, 0.8, 0.0)
            points = np.where(usable[..., None], points, np.nan)
            views.append(
                ViewDetections(
                    camera.name,
                    int(tick),
                    index,
                    camera.image_size,
                    SKELETON.hash,
                    points,
                    scores,
                    np.full(2, 0.8),
                )
            )
        return DetectionSet(index, int(tick), SKELETON.hash, tuple(views))

    def _poses(self, index, tick):
        positions = self.joints(1e-9 * (tick - START))
        ones = np.ones(positions.shape[:2])
        return TrackedPoseSet(
            index,
            int(tick),
            SKELETON.hash,
            positions,
            np.tile(1e-4 * np.eye(3), (*ones.shape, 1, 1)),
            ones,
            5 * ones,
            JointState.MEASURED * ones,
            np.ones(2),
            ids=np.array([4, 9]),
        )


@pytest.fixture(scope="session")
def make_capture():
    return Capture
