"""3D plot of people and cameras, and floor plan of the head paths."""

from __future__ import annotations

import io
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from panoptic_ros.domain import Camera, Rig, SkeletonModel, TrackedPoseSet
from panoptic_ros.errors import DataError
from panoptic_ros.io.colors import rgb_of
from panoptic_ros.io.files import write_bytes
from panoptic_ros.view.body_drawing import DrawnBody, ShapedBodies, shades
from panoptic_ros.view.plotting import (
    Axes,
    Axes3D,
    Figure,
    FigureCanvasAgg,
    Line3DCollection,
    MaxNLocator,
    Poly3DCollection,
)

Array = np.ndarray
CAMERA_GREY = (0.45, 0.45, 0.45)
SHOWN_INSTANTS = 4
WIDEST = 2.0  # largest off-axis distance of a drawn frustum corner, relative to its depth


def plot_capture(
    path: Path,
    rig: Rig,
    skeleton: SkeletonModel,
    poses: Sequence[TrackedPoseSet],
    *,
    instants: Sequence[int] | None = None,
    title: str = "",
    bodies: ShapedBodies | None = None,
) -> None:
    """Write a PNG: skeletons and cameras in 3D on the left, the view from above on the right.

    Skeletons are drawn at some instants, older ones paler. Head paths are drawn on the floor (z = 0) over all
    instants. Colours match those of the overlays.

    Args:
        poses: Tracked poses sorted by time; may be empty.
        instants: Indices into `poses` of the drawn skeletons. None chooses a few, evenly spread.
        bodies: Bodies sorted by time. Those nearest to the drawn instants replace the bones.

    Raises:
        DataError: For poses of another skeleton.
        EnvironmentProblem: If the file cannot be written.
    """
    for pose in poses:
        if pose.skeleton_hash != skeleton.hash:
            raise DataError(f"poses of skeleton {pose.skeleton_hash}, plotting {skeleton.name}")
    chosen = _some_of(poses) if instants is None else [poses[i] for i in instants]
    paths = head_paths(skeleton, poses)
    figure = Figure(figsize=(14.0, 5.4), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(1.2, 1.0), wspace=0.06)[0]
    scene: Axes3D = left.add_subplot(projection="3d")
    plan = right.add_subplot()
    there = set() if bodies is None else {body.id for body in bodies.bodies}
    _draw_scene(scene, rig, skeleton, chosen, paths, there)
    if bodies is not None:
        _draw_bodies(scene, bodies._replace(bodies=_chosen_bodies(bodies.bodies, chosen)))
    _draw_plan(plan, rig, skeleton, chosen, paths)
    if title:
        figure.suptitle(title)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    write_bytes(Path(path), buffer.getvalue())


def _chosen_bodies(bodies: Sequence[DrawnBody], poses: Sequence[TrackedPoseSet]) -> list[DrawnBody]:
    """Return each person's bodies nearest in time to the poses, or a few evenly spread ones without poses."""
    stamps = [pose.stamp_ns for pose in poses]
    found = []
    for number in sorted({body.id for body in bodies}):
        own = [body for body in bodies if body.id == number]
        times = np.array([body.stamp_ns for body in own])
        wanted = stamps or np.linspace(times[0], times[-1], SHOWN_INSTANTS).tolist()
        found += [own[row] for row in dict.fromkeys(int(np.abs(times - t).argmin()) for t in wanted)]
    return found


def _draw_bodies(axes: Axes3D, shaped: ShapedBodies) -> None:
    stamps = sorted({body.stamp_ns for body in shaped.bodies})
    for body in shaped.bodies:
        points, normals, triangles = shaped.surfaces.place(body)
        opacity = 0.25 + 0.75 * (stamps.index(body.stamp_ns) + 1) / len(stamps)
        tints = shades(normals, triangles)[:, None] * np.array(rgb_of(body.id))
        colors = np.concatenate([tints, np.full((len(tints), 1), opacity)], axis=1)
        axes.add_collection3d(Poly3DCollection(points[triangles], facecolors=colors, edgecolors="none"))


def head_paths(skeleton: SkeletonModel, poses: Sequence[TrackedPoseSet]) -> dict[int, Array]:
    """Return head positions (T, 3) m over all T instants by id, NaN where person or head is missing."""
    paths: dict[int, Array] = {}
    for t, pose in enumerate(poses):
        for person, identity in enumerate(pose.ids):
            path = paths.setdefault(int(identity), np.full((len(poses), 3), np.nan))
            path[t] = pose.positions[person, skeleton.head]
    return dict(sorted(paths.items()))


def frustum_lines(camera: Camera, length: float) -> Array:
    """Return the camera frustum as eight lines (8, 2, 3) m in the world frame.

    Four lines lead from the centre to the image corners, and four from corner to corner. The corners are at
    depth `length` (m). Corners of wide lenses are drawn closer to the optical axis.
    """
    width, height = camera.image_size
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], float)
    plane = camera.intrinsics.undistort(corners)
    lost = np.isnan(plane)
    # pixels beyond the fold of the lens cannot be undistorted
    plane = np.where(lost, camera.intrinsics.plane_from_pixels(corners), plane)
    plane = plane * np.minimum(1.0, WIDEST / np.linalg.norm(plane, axis=1, keepdims=True).clip(1e-9))
    in_camera = length * np.concatenate([plane, np.ones((4, 1))], axis=1)
    world = camera.cam_from_world.inverse().apply(in_camera)
    centre = np.broadcast_to(camera.centre, (4, 3))
    return np.concatenate(
        [np.stack([centre, world], axis=1), np.stack([world, np.roll(world, -1, axis=0)], axis=1)]
    )


def _some_of(poses: Sequence[TrackedPoseSet]) -> list[TrackedPoseSet]:
    """Return at most `SHOWN_INSTANTS` pose sets, evenly spread over those with people, with the last."""
    busy = [pose for pose in poses if len(pose.ids)]
    if len(busy) <= SHOWN_INSTANTS:
        return busy
    return [busy[round(i)] for i in np.linspace(0, len(busy) - 1, SHOWN_INSTANTS)]


def _draw_scene(
    axes: Axes3D,
    rig: Rig,
    skeleton: SkeletonModel,
    poses: Sequence[TrackedPoseSet],
    paths: dict[int, Array],
    hidden: Collection[int],
) -> None:
    centres = np.stack([camera.centre for camera in rig.cameras])
    size = 0.12 * max(1.0, float(np.ptp(centres, axis=0).max()))
    frusta = np.concatenate([frustum_lines(camera, size) for camera in rig.cameras])
    axes.add_collection3d(Line3DCollection(frusta, colors=[CAMERA_GREY], linewidths=0.8, clip_on=False))
    for camera in rig.cameras if len(rig) <= 40 else ():
        axes.text(*camera.centre, f" {camera.name}", fontsize=7, color=CAMERA_GREY)
    for identity, path in paths.items():
        axes.plot(path[:, 0], path[:, 1], 0.0, color=rgb_of(identity), linewidth=1.0)
    shown = [centres]
    for lines, colors in (_bone_lines(skeleton, pose, age, hidden) for pose, age in _aged(poses)):
        if len(lines):  # Line3DCollection cannot compute the extent of an empty set
            axes.add_collection3d(Line3DCollection(lines, colors=colors, linewidths=2.0))
        shown.append(lines.reshape(-1, 3))
    _equal_axes(axes, np.concatenate(shown))
    axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)")
    axes.view_init(elev=22.0, azim=-60.0)


def _draw_plan(
    axes: Axes,
    rig: Rig,
    skeleton: SkeletonModel,
    poses: Sequence[TrackedPoseSet],
    paths: dict[int, Array],
) -> None:
    for camera in rig.cameras:
        x, y = camera.centre[:2]
        ahead = camera.cam_from_world.rotation[2, :2]  # horizontal part of the optical axis
        axes.plot([x, x + 0.5 * ahead[0]], [y, y + 0.5 * ahead[1]], color=CAMERA_GREY, linewidth=1.0)
        axes.plot(x, y, "s", color=CAMERA_GREY, markersize=5)
        if len(rig) <= 40:
            axes.annotate(camera.name, (x, y), textcoords="offset points", xytext=(5, 5), fontsize=7)
    for identity, path in paths.items():
        axes.plot(path[:, 0], path[:, 1], color=rgb_of(identity), linewidth=1.6, label=f"id {identity}")
        seen = np.flatnonzero(np.isfinite(path[:, 0]))
        if len(seen):
            axes.plot(*path[seen[-1], :2], "o", color=rgb_of(identity), markersize=6)
    for pose, age in _aged(poses):
        lines, colors = _bone_lines(skeleton, pose, age)
        for line, color in zip(lines, colors):
            axes.plot(line[:, 0], line[:, 1], color=color, linewidth=0.8)
    axes.margins(0.1)
    axes.set_aspect("equal")
    axes.set(xlabel="x (m)", ylabel="y (m)", title="from above: paths of the heads")
    axes.grid(alpha=0.3)
    if 0 < len(paths) <= 20:
        axes.legend(loc="best", fontsize=8)


def _aged(poses: Sequence[TrackedPoseSet]) -> list[tuple[TrackedPoseSet, float]]:
    """Return each pose set with its opacity; the newest has 1."""
    return [(pose, 0.25 + 0.75 * (i + 1) / len(poses)) for i, pose in enumerate(poses)]


def _bone_lines(
    skeleton: SkeletonModel, pose: TrackedPoseSet, opacity: float, hidden: Collection[int] = ()
) -> tuple[Array, list[tuple[float, float, float, float]]]:
    """Return lines (N, 2, 3) m of all bones with finite ends and their RGBA colours, without `hidden` ids."""
    ends = pose.positions[:, np.array(skeleton.bones)]  # (P, B, 2, 3)
    there = np.isfinite(ends).all((-1, -2))
    there[[number in hidden for number in pose.ids.tolist()]] = False
    colors = [(*rgb_of(pose.ids[person]), opacity) for person, _ in np.argwhere(there)]
    return ends[there], colors


def _equal_axes(axes: Axes3D, points: Array) -> None:
    """Set equal axis scales and include the floor (z = 0)."""
    low, high = np.minimum(points.min(0), [np.inf, np.inf, 0.0]), points.max(0)
    span = np.maximum(high - low, 0.5)
    axes.set_xlim(low[0], low[0] + span[0])
    axes.set_ylim(low[1], low[1] + span[1])
    axes.set_zlim(low[2], low[2] + span[2])
    axes.set_box_aspect(span, zoom=1.05)
    for axis, length in zip((axes.xaxis, axes.yaxis, axes.zaxis), span):
        axis.set_major_locator(MaxNLocator(max(2, round(7 * length / span.max())), steps=[1, 2, 5, 10]))
