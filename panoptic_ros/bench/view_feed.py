"""What a viewer is loaded with: people, cameras, 2D people and images, all moving, as messages to publish."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.bench.graph_feed import Feed, simulated_feed
from panoptic_ros.domain import JointState, Preview, RefinedPoseSet, ViewDetections, ViewFrame, ViewSources
from panoptic_ros.io.previews import make_preview

SCENARIO = "noisy-8p10v"
PEOPLE, VIEWS, RATE_HZ = 8, 8, 30.0
PREVIEW_EVERY = 3  # instants: 10 Hz
SPREAD_M = 0.012


@dataclass(frozen=True)
class ViewInstant:
    """All that is published of one instant; its stamps count from 0."""

    skeletons: RefinedPoseSet
    views: tuple[ViewDetections, ...]
    previews: tuple[Preview, ...]


def view_load(instants: int = 60) -> tuple[Feed, list[ViewInstant]]:
    """Eight people before eight cameras at 30 Hz, previews at 10 Hz: simulated, played forth and back."""
    feed = simulated_feed(SCENARIO, PEOPLE, VIEWS, RATE_HZ)
    rng = np.random.default_rng(0)
    pictures = [_picture(rng) for _ in feed.rig.names]
    return feed, [_instant(feed, pictures, number) for number in range(instants)]


def _instant(feed: Feed, pictures: list[np.ndarray], number: int) -> ViewInstant:
    joints, found = len(feed.skeleton), feed.sets[feed.number_of_set(number)]
    angles = 2.0 * np.pi * (np.arange(PEOPLE) / PEOPLE + number / 300.0)
    centres = np.stack([1.6 * np.cos(angles), 1.6 * np.sin(angles), np.ones(PEOPLE)], -1)
    body = np.random.default_rng(1).normal(scale=[0.2, 0.2, 0.4], size=(joints, 3))
    shape = PEOPLE, joints
    skeletons = RefinedPoseSet(
        number, 0, feed.skeleton.hash, centres[:, None] + body,
        np.broadcast_to(SPREAD_M**2 * np.eye(3), (*shape, 3, 3)), np.full(shape, 0.9),
        np.full(shape, VIEWS), np.full(shape, JointState.MEASURED), np.full(PEOPLE, 0.9),
        sources=ViewSources(
            feed.rig.names, np.full(len(feed.rig), number, np.uint64),
            np.tile(np.arange(PEOPLE, dtype=np.int32)[:, None], (1, len(feed.rig))),
        ),
        ids=np.arange(PEOPLE),
    )  # fmt: skip
    views = tuple(replace(view, stamp_ns=0, frame_number=number) for view in found.views)
    previews = tuple(
        make_preview(ViewFrame(name, 0, number, np.roll(picture, 8 * number, axis=1)))
        for name, picture in zip(feed.rig.names, pictures)
        if number % PREVIEW_EVERY == 0
    )  # fmt: skip
    return ViewInstant(skeletons, views, previews)


def _picture(rng: np.random.Generator) -> np.ndarray:
    """An HD image whose preview is as large as one of a real room: 11 kB."""
    coarse = rng.integers(96, 160, (27, 48, 3), dtype=np.uint8)
    return np.kron(coarse, np.ones((40, 40, 1), np.uint8))
