"""Writes simulated captures of bodies with cameras and IMUs to files: completely, or not at all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from panoptic_ros.errors import UsageError
from panoptic_ros.io.files import write_json
from panoptic_ros.io.folders import staged_folder
from panoptic_ros.running.simulations.body_scenes import body_scene

if TYPE_CHECKING:
    from panoptic_ros.simulation.bodies.group import BodyGroup

Array = np.ndarray


def write_body_take(name: str, out: Path, seed: int, bag: bool = False, frames: int | None = None) -> str:
    """Simulate a body scene, write rig, 2D poses, IMU samples, subjects and truth; return a line about it.

    Args:
        bag: also write the 2D poses of the default skeleton and the IMU samples to a bag.
        frames: maximum number of frames; None = the full length of the scene.

    Raises:
        UsageError: if there are fewer than two frames.
    """
    from panoptic_ros.io.body_files import write_bodies
    from panoptic_ros.io.body_models import read_body_model
    from panoptic_ros.io.kinematic_files import subject_document, write_imus
    from panoptic_ros.io.recorded_motions import read_clips
    from panoptic_ros.io.rigs import write_rig
    from panoptic_ros.simulation.bodies.group import simulate_group

    scene = body_scene(name)
    if frames is not None:
        if frames < 2:
            raise UsageError(f"{frames} frames: a body that moves needs two at least")
        scene = replace(scene, seconds=(frames - 0.5) / scene.rate)
    model = read_body_model()
    take = simulate_group(scene, seed, model, read_clips())
    with staged_folder(out) as folder:
        write_rig(folder / "rig.json", take.rig)
        write_json(folder / "detections.json.gz", _detections(take))
        write_imus(folder / "imu.csv.gz", take.devices)
        for k, subject in enumerate(take.subjects):
            number = k if len(take.subjects) > 1 else ""
            write_json(folder / f"subject{number}.json", subject_document(subject), indent=1)
        write_bodies(folder / "truth.json.gz", model, take.truth)
        if take.strangers:
            write_bodies(folder / "strangers.json.gz", model, take.strangers)
        if bag:
            _write_bag(folder / "bag", take)
    return f"{name}, {len(take.stamps)} frames, {len(take.rig)} cameras, {len(take.devices)} IMUs"


def _detections(take: BodyGroup) -> dict[str, Any]:
    frames = []
    for t, stamp in enumerate(take.stamps.tolist()):
        views = {
            camera.name: {"stamp_ns": stamp, "persons": [_rows(*one) for one in zip(*take.views[c][t])]}
            for c, camera in enumerate(take.rig.cameras)
        }
        frames.append({"index": t, "stamp_ns": stamp, "views": views})
    return {"format": "panoptic-detections-1", "joint_names": list(take.joint_names), "frames": frames}


def _rows(points: Array, scores: Array) -> list[list[float] | None]:
    return [
        [round(float(x), 1), round(float(y), 1), round(float(s), 2)] if s > 0.0 else None
        for (x, y), s in zip(points, scores)
    ]


def _write_bag(path: Path, take: BodyGroup) -> None:
    """Write rig, skeleton, 2D poses and IMU samples to a bag, in order of their timestamps."""
    from panoptic_ros.domain import ImuSample
    from panoptic_ros.graph.topics import TOPICS
    from panoptic_ros.io.bags import BagWriter
    from panoptic_ros.io.messages import bag_messages, to_message
    from panoptic_ros.simulation import SKELETON

    family = bag_messages()
    rows: list[tuple[int, str, Any]] = [
        (view.stamp_ns, TOPICS["detections"].of(view.camera), view)
        for t in range(len(take.stamps))
        for view in take.detections(t, SKELETON)
    ]
    for name, series in take.devices.items():
        rows += [
            (
                stamp,
                TOPICS["imu"].of(name),
                ImuSample(name, stamp, series.quaternions[k], series.rates[k], series.forces[k]),
            )
            for k, stamp in enumerate(series.stamps.tolist())
        ]
    with BagWriter(path) as bag:
        for key, record in (("rig", take.rig), ("skeleton_model", SKELETON)):
            bag.write("/" + TOPICS[key].name, int(take.stamps[0]), to_message(record, family))
        for stamp, topic, record in sorted(rows, key=lambda row: row[:2]):
            bag.write("/" + topic, stamp, to_message(record, family))
