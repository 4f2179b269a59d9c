"""Simulated captures of bodies with cameras and IMUs, in files: whole or not at all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from panoptic_ros.errors import UsageError
from panoptic_ros.io.files import write_json
from panoptic_ros.io.folders import staged_folder

if TYPE_CHECKING:
    from panoptic_ros.simulation.bodies.capture import BodyCapture, BodyScene

BODY_SCENES = {  # {name: what it is}
    "body-punch": "a body with 8 cameras and 13 IMUs: punches and kicks",
    "body-wash": "the same: standing gestures",
    "body-walk": "the same: walking on uneven ground",
    "body-shake": "the same: walking and shaking hands",
    "body-jog": "the same: walking, jogging, jumping",
    "body-t-pose": "the same as body-punch; a T-pose, 4 degrees off per joint and axis, tells the mounting",
}
_CLIPS = {
    "body-punch": ("02_05",), "body-wash": ("02_10",), "body-walk": ("03_01", "03_02"),
    "body-shake": ("18_01",), "body-jog": ("02_01", "02_03", "02_04", "02_02"), "body-t-pose": ("02_05",),
}  # fmt: skip


def body_scene(name: str) -> BodyScene:
    """The scene of one of the names of `BODY_SCENES`."""
    from panoptic_ros.simulation.bodies.capture import BodyScene  # numba is slow to load

    poor = name == "body-t-pose"
    return BodyScene(_CLIPS[name], seconds=19.0, mounts=not poor, t_pose=4.0 if poor else 2.0)


def write_body_take(name: str, out: Path, seed: int, bag: bool = False, frames: int | None = None) -> str:
    """Simulate and write rig, 2D people, IMU samples, subject and truth; a line about it.

    Args:
        bag: 2D people of the usual skeleton and samples of IMUs also as a bag.
        frames: at most, of those that the clips give.

    Raises:
        UsageError: if there are fewer than two frames.
    """
    from panoptic_ros.io.body_files import write_bodies
    from panoptic_ros.io.body_models import read_body_model
    from panoptic_ros.io.kinematic_files import subject_document, write_imus
    from panoptic_ros.io.recorded_motions import read_clips
    from panoptic_ros.io.rigs import write_rig
    from panoptic_ros.simulation.bodies.capture import simulate_body

    scene = body_scene(name)
    if frames is not None:
        if frames < 2:
            raise UsageError(f"{frames} frames: a body that moves needs two at least")
        scene = replace(scene, seconds=(frames - 0.5) / scene.rate)
    take = simulate_body(scene, seed, read_body_model(), read_clips())
    with staged_folder(out) as folder:
        write_rig(folder / "rig.json", take.rig)
        write_json(folder / "detections.json.gz", _detections(take))
        write_imus(folder / "imu.csv.gz", take.devices)
        write_json(folder / "subject.json", subject_document(take.subject, take.stature), indent=1)
        write_bodies(folder / "truth.json.gz", take.subject.body.model, take.truth())
        if bag:
            _write_bag(folder / "bag", take)
    return f"{name}, {len(take.stamps)} frames, {len(take.rig)} cameras, {len(take.devices)} IMUs"


def _detections(take: BodyCapture) -> dict[str, Any]:
    frames = []
    for t, stamp in enumerate(take.stamps.tolist()):
        views = {}
        for c, camera in enumerate(take.rig.cameras):
            rows = [
                [round(float(x), 1), round(float(y), 1), round(float(s), 2)] if s > 0.0 else None
                for (x, y), s in zip(take.pixels[c, t], take.scores[c, t])
            ]
            views[camera.name] = {"stamp_ns": stamp, "persons": [rows]}
        frames.append({"index": t, "stamp_ns": stamp, "views": views})
    return {"format": "panoptic-detections-1", "joint_names": list(take.joint_names), "frames": frames}


def _write_bag(path: Path, take: BodyCapture) -> None:
    """Rig, skeleton, 2D people and samples, by their stamps."""
    from panoptic_ros.domain import ImuSample, ViewDetections
    from panoptic_ros.graph.topics import TOPICS
    from panoptic_ros.io.bags import BagWriter
    from panoptic_ros.io.messages import bag_messages, to_message
    from panoptic_ros.simulation import SKELETON

    family, columns = bag_messages(), [take.joint_names.index(name) for name in SKELETON.joint_names]
    rows: list[tuple[int, str, Any]] = []
    for t, stamp in enumerate(take.stamps.tolist()):
        for c, camera in enumerate(take.rig.cameras):
            scores = take.scores[c, t, columns][None]
            points = np.where(scores[..., None] > 0.0, take.pixels[c, t, columns][None], np.nan)
            view = ViewDetections(
                camera.name, stamp, t, camera.image_size, SKELETON.hash, points, scores, scores.mean(1)
            )
            rows.append((stamp, TOPICS["detections"].of(camera.name), view))
    for name, series in take.devices.items():
        rows += [
            (stamp, TOPICS["imu"].of(name),
             ImuSample(name, stamp, series.quaternions[k], series.rates[k], series.forces[k]))
            for k, stamp in enumerate(series.stamps.tolist())
        ]  # fmt: skip
    with BagWriter(path) as bag:
        for key, record in (("rig", take.rig), ("skeleton_model", SKELETON)):
            bag.write("/" + TOPICS[key].name, int(take.stamps[0]), to_message(record, family))
        for stamp, topic, record in sorted(rows, key=lambda row: row[:2]):
            bag.write("/" + topic, stamp, to_message(record, family))
