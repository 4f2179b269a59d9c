"""Somebody whose surface is known exactly: 2D tracks on capsules that move, and the skeletons to them."""

from __future__ import annotations

from dataclasses import replace

import captures
import numpy as np

from panoptic_ros.domain import DepthFrame, JointState, PatchTracks, TrackedPoseSet, ViewSources
from panoptic_ros.domain.parts import rigid_parts
from panoptic_ros.patches.lifting import axes, lift

SECOND = 10**9
STEP = SECOND // 25
PARTS = rigid_parts(captures.SKELETON)


def turned(points, angle, shift, about=(0.0, 0.0, 0.0)):
    """Points turned by an angle (rad) about an upright axis through a place, then shifted."""
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return (np.asarray(points) - about) @ rotation.T + about + shift


def skeletons(index, positions, noise=0.0, missing=()):
    """A set of one person, id 7, with joints (J, 3) m, seen by all cameras as their person 0."""
    rng = np.random.default_rng(index)
    points = positions + noise * rng.standard_normal(positions.shape)
    states = np.full(len(points), JointState.MEASURED)
    states[list(missing)] = JointState.MISSING
    there = states != JointState.MISSING
    points[~there] = np.nan
    covariances = np.where(there[:, None, None], 1e-4 * np.eye(3), np.nan)
    names = captures.RIG.names
    sources = ViewSources(names, np.full(len(names), index), np.zeros((1, len(names))))
    return TrackedPoseSet(
        index,
        SECOND + index * STEP,
        captures.SKELETON.hash,
        points[None],
        covariances[None],
        there[None].astype(float),
        4 * there[None],
        states[None],
        np.ones(1),
        sources=sources,
        ids=np.array([7]),
    )


def tracks(index, before, move, noise_px=0.0, wrong=0.0, cameras=captures.RIG.cameras):
    """Tracks from the instant before to this one: points on capsules round joints (J, 3), moved by `move`.

    Args:
        wrong: share of the tracks that stay where they are.
    """
    rng = np.random.default_rng(index + 1000)
    capsules = axes(PARTS, captures.SKELETON, before)
    found = []
    for camera in cameras:
        pose = camera.cam_from_world
        origin = -pose.rotation.T @ pose.translation
        own = np.repeat(np.arange(len(PARTS)), 24)
        share = rng.uniform(0.05, 0.95, (len(own), 1))
        aside = rng.uniform(-0.6, 0.6, (len(own), 3)) * capsules.radii[own, None]
        aimed = capsules.firsts[own] + share * (capsules.lasts[own] - capsules.firsts[own]) + aside
        rays = (aimed - origin) / np.linalg.norm(aimed - origin, axis=1, keepdims=True)
        points, normals, seen = np.zeros((len(own), 3)), np.zeros((len(own), 3)), np.zeros(len(own), bool)
        lift(origin, rays, own, capsules, points, normals, seen)
        still = rng.random(len(own)) < wrong
        after = np.where(still[:, None], points, move(points))
        (begins, inside), (ends, later) = camera.project(points), camera.project(after)
        good = seen & inside & later
        ends = ends + noise_px * rng.standard_normal(ends.shape)
        found.append(
            PatchTracks(
                camera.name,
                SECOND + index * STEP,
                index,
                SECOND + (index - 1) * STEP,
                index - 1,
                captures.SKELETON.hash,
                begins[good],
                ends[good],
                np.tile([16.0, 0.0, 16.0], (good.sum(), 1)),
                np.zeros(good.sum()),
                own[good],
            )
        )
    return found


def recording(count=8, angle=0.05, shift=(0.02, -0.01, 0.005), start=0, **values):
    """Tracks and skeletons of somebody who turns and goes, in the order in which a stage takes them."""
    positions, items = captures.people(0.0)[1], []
    for index in range(start, start + count):
        if index > start:
            before, about = positions, positions.mean(axis=0)

            def move(points, about=about):
                return turned(points, angle, shift, about)

            positions = move(before)
            items += tracks(index, before, move, **values)
        items.append(skeletons(index, positions))
    return items


def moved_stamps(items, by_ns):
    """The same later."""
    return [
        replace(
            item,
            stamp_ns=item.stamp_ns + by_ns,
            **(
                {"before_ns": item.before_ns + by_ns}
                if isinstance(item, PatchTracks)
                else {"newest_ns": item.newest_ns + by_ns}
            ),
        )
        for item in items
    ]


def depth_map(sensor, index, joints, wall=4.0):
    """What a depth sensor measures of capsules round joints (J, 3), and a wall behind them."""
    width, height = sensor.image_size
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    plane = sensor.intrinsics.undistort(np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float))
    rays = np.column_stack([plane, np.ones(len(plane))])
    capsules, depth = axes(PARTS, captures.SKELETON, joints), np.full(len(rays), wall)
    for first, last, radius in zip(*capsules):
        for share in np.linspace(0.0, 1.0, 8):  # balls along the axis
            centre = sensor.cam_from_world.apply(first + share * (last - first))
            along = rays @ centre / (rays**2).sum(axis=1)
            aside = ((along[:, None] * rays - centre) ** 2).sum(axis=1)
            inside = aside < radius**2
            back = np.sqrt((radius**2 - aside[inside]) / (rays[inside] ** 2).sum(axis=1))
            depth[inside] = np.minimum(depth[inside], along[inside] - back)
    shown = depth.reshape(height, width).astype(np.float32)
    return DepthFrame(sensor.name, SECOND + index * STEP, index, shown)


def recording_with_gap(count, gap, joint):
    """`recording` in which a joint is missing in some instants; and the true joints (J, 3) m by index."""
    items, truth = [], {}
    for item in recording(count):
        if not isinstance(item, PatchTracks):
            truth[item.index] = item.positions[0].copy()
            if item.index in gap:
                item = skeletons(item.index, item.positions[0], missing=(joint,))
        items.append(item)
    return items, truth
