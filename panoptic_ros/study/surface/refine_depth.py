"""Use the depth maps of a capture folder as separate sensors, in the studies of refinement.

This module also scores the free-space test of depth maps and the propagation of joints by patches.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np

from panoptic_ros.capture import open_capture_folder
from panoptic_ros.capture.depth_folder import depth_files, read_depth
from panoptic_ros.domain import Camera, DepthFrame, DepthSensor, PatchTrajectories, Rig
from panoptic_ros.domain.parts import rigid_parts
from panoptic_ros.evaluation import FramePair
from panoptic_ros.geometry import Intrinsics
from panoptic_ros.patches.depth_maps import DepthMaps, in_front
from panoptic_ros.refinement.links import links_of
from panoptic_ros.simulation.kinect import kinect_like
from panoptic_ros.stage import StageContext

Array = np.ndarray
OUTLIER = 0.15  # m, displacement of the simulated outliers


def with_sensors(folder: Path, rig: Rig) -> Rig:
    """Return the rig with one depth sensor per camera that has registered depth maps."""
    own = {sensor.name: sensor for sensor in rig.depth_sensors}
    for camera in rig.cameras:
        files = depth_files(folder, camera.name)
        if files:
            rows, columns = read_depth(files[0]).shape
            name = f"{camera.name}_depth"
            own[name] = DepthSensor(_sized(camera, name, (columns, rows)), camera.name)
    return replace(rig, depth_sensors=tuple(own.values()))


def depth_frames(
    folder: Path, rig: Rig, stamps: Mapping[tuple[str, int], int], kinect: bool, seed: int
) -> Iterator[DepthFrame]:
    """Yield the depth maps of all sensors of a rig from `with_sensors`.

    Args:
        stamps: timestamps (ns) of the images, by camera and frame.
        kinect: add the noise of a sensor.
        seed: seed of this noise.
    """
    rng = np.random.default_rng(seed)
    registered = {sensor.name: sensor.colour_camera for sensor in rig.depth_sensors}
    for name, camera in registered.items():
        if name == f"{camera}_depth":
            for number, file in enumerate(depth_files(folder, camera)):
                if (camera, number) in stamps:
                    depth = read_depth(file)
                    shown = kinect_like(depth, rng) if kinect else depth
                    yield DepthFrame(name, stamps[camera, number], number, shown)
    with closing(open_capture_folder(folder, cameras=list(rig.names), depth=False)) as capture:
        for source in capture.depth_sensors:
            for frame in source:
                yield replace(frame, depth=kinect_like(frame.depth, rng)) if kinect else frame


def free_space(
    rig: Rig, frames: Sequence[DepthFrame], pairs: Sequence[FramePair], face: Array
) -> dict[str, float]:
    """Return the shares of joints that a sensor sees as free space.

    The joints are true ones, measured ones with an error below 5 cm, and true ones moved by 15 cm in a random
    direction.

    Args:
        face: (J,) bool, joints that are not tested.
    """
    rng, depth = np.random.default_rng(0), DepthMaps(rig)
    counts = {"true": [0, 0], "measured": [0, 0], "outliers": [0, 0]}
    waiting = sorted(frames, key=lambda frame: frame.stamp_ns)
    for pair in pairs:
        while waiting and waiting[0].stamp_ns <= pair.stamp_ns:
            depth.take(waiting.pop(0))
        maps = [sensed for _, (_, sensed) in depth.nearest(pair.stamp_ns)]
        rows, columns = np.array(pair.matches, np.int64).reshape(-1, 2).T
        true = pair.truth[rows][:, ~face].reshape(-1, 3)
        found = pair.result[columns][:, ~face].reshape(-1, 3)
        aside = rng.standard_normal(true.shape)
        moved = true + OUTLIER * aside / np.linalg.norm(aside, axis=1, keepdims=True)
        close = found[np.linalg.norm(found - true, axis=1) < 0.05]
        for name, points in (("true", true), ("measured", close), ("outliers", moved)):
            points = points[np.isfinite(points).all(axis=1)]
            free = np.zeros(len(points), bool)
            for sensed in maps:
                free |= in_front(sensed, points)
            counts[name][0] += int(free.sum())
            counts[name][1] += len(points)
    return {f"free_{name}": found / max(total, 1) for name, (found, total) in counts.items()}


def transforms(
    patches: Sequence[PatchTrajectories],
    pairs: Sequence[FramePair],
    context: StageContext,
    order: Sequence[int],
) -> dict[str, float]:
    """Score the motions of body parts: T(t + 1 | t) of Joo et al. 2017, 6.3, applied to true joints.

    Args:
        order: the truth's index of each joint of the skeleton.

    Returns:
        median and 90th percentile of the error (mm), and the share of joints with a motion.
    """
    parts = [list(part.joints) for part in rigid_parts(context.skeleton)]
    moved = sorted({joint for part in parts for joint in part})
    places = {
        pair.stamp_ns: {
            own: pair.truth[row, order] for (_, own), row in zip(pair.match_ids, pair.matches[:, 0])
        }
        for pair in pairs
    }
    errors, count = [np.zeros(0)], 0
    for item in patches:
        before, after = places.get(item.before_ns, {}), places.get(item.stamp_ns, {})
        ids = [number for number in before if number in after]
        if item.before_ns == item.stamp_ns or not ids:
            continue
        one, other = (np.array([where[number] for number in ids]) for where in (before, after))
        states = np.concatenate([one, np.zeros_like(one)], axis=2)
        links = links_of(item.motions, parts, np.array(ids), states)
        count += int(np.isfinite((one + other)[:, moved, 0]).sum())
        if links is not None:
            off = np.linalg.norm(links.displacements - (other - one), axis=2)[:, moved]
            errors.append(1e3 * off[np.isfinite(off)])
    every = np.concatenate(errors)
    median, most = np.quantile(every, [0.5, 0.9]) if len(every) else (np.nan, np.nan)
    return {"t_median_mm": float(median), "t_p90_mm": float(most), "t_available": len(every) / max(count, 1)}


def _sized(camera: Camera, name: str, size: tuple[int, int]) -> Camera:
    """Return the camera with another name and another image size."""
    scale = np.array(size) / np.array(camera.image_size)
    matrix = camera.intrinsics.matrix.copy()
    matrix[:2, :2] *= scale[:, None]
    matrix[:2, 2] = (matrix[:2, 2] + 0.5) * scale - 0.5
    lens = Intrinsics(matrix, camera.intrinsics.distortion, camera.intrinsics.lens)
    return replace(camera, name=name, image_size=size, intrinsics=lens)
