"""kinematics.json.gz frame by frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from panoptic_ros.domain import BodyStateSet
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.geometry.rotations import from_quaternions
from panoptic_ros.io.body_files import KINEMATICS, body_row
from panoptic_ros.io.frame_stream import FrameStream


class BodyStream:
    """Bodies as `io.body_files.write_bodies` has them; instants without a body are left out.

    Args:
        model: of all bodies.

    Raises:
        EnvironmentProblem: if the file cannot be written.
    """

    def __init__(self, path: Path, model: SegmentModel):
        self._model = model
        names = {"segment_names": list(model.names), "joint_names": list(model.joint_names)}
        self._frames = FrameStream(path, {"format": KINEMATICS, **names})

    def add(self, item: BodyStateSet) -> None:
        """One more instant."""
        rows = [body_row(self._model, state) for state in states_of(item)]
        if rows:
            index = self._frames.count
            self._frames.add({"index": index, "stamp_ns": item.stamp_ns, "subjects": rows})

    def sync(self) -> None:
        """See `FrameStream`."""
        self._frames.sync()

    def close(self) -> None:
        """Finish the file."""
        self._frames.close()

    def discard(self) -> None:
        """Give the file up."""
        self._frames.discard()


def states_of(item: BodyStateSet) -> list[BodyState]:
    """The bodies of a set, one by one."""
    found = []
    for k, number in enumerate(item.ids.tolist()):
        known = bool(np.isfinite(item.covariances[k]).all())
        found.append(
            BodyState(
                item.stamp_ns,
                number,
                item.positions[k],
                from_quaternions(item.orientations[k]),
                item.velocities[k, :, :3],
                item.velocities[k, :, 3:],
                item.covariances[k] if known else None,
            )
        )
    return found
