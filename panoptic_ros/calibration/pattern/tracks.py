"""Points of a pattern in the images of all cameras: tracks from matches of pairs, and their selection."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

Array = np.ndarray
MOST_POINTS = (
    6000  # in an adjustment, whose time grows with points times squared views, its errors hardly fall
)


class PatternSightings(NamedTuple):
    """Pixels of the points of a pattern, sorted by point, then camera.

    Args:
        cameras, points: (M,) of each pixel; points are numbered from 0 without gaps, over all scenes.
        pixels: (M, 2) px.
    """

    cameras: Array
    points: Array
    pixels: Array

    def table(self, count: int) -> Array:
        """Return the pixels (B, C, 2) of `count` cameras; NaN = not seen."""
        table = np.full((int(self.points.max(initial=-1)) + 1, count, 2), np.nan)
        table[self.points, self.cameras] = self.pixels
        return table


class FeatureMatches(NamedTuple):
    """Matches of two images: cameras, features (N,) of each, and distances (N,) of their descriptors."""

    first: int
    second: int
    first_features: Array
    second_features: Array
    distances: Array


def tracks_of(counts: Array, matches: Iterable[FeatureMatches]) -> tuple[Array, Array, Array]:
    """Return the tracks of features of one scene, by union of matches, the most similar first.

    A match that would give a track two features of one camera is left out.

    Args:
        counts: (C,) number of features of each camera.

    Returns:
        track, camera and feature (M,) of each member of a track of two features or more, sorted.
    """
    firsts = np.concatenate([[0], np.cumsum(counts)])
    owner = np.repeat(np.arange(len(counts)), counts)
    edges = [
        np.stack([firsts[m.first] + m.first_features, firsts[m.second] + m.second_features, m.distances])
        for m in matches
    ]
    parents = list(range(int(firsts[-1])))
    seen_by: dict[int, set[int]] = {}

    def root(node: int) -> int:
        while parents[node] != node:
            parents[node] = parents[parents[node]]
            node = parents[node]
        return node

    if edges:
        table = np.concatenate(edges, axis=1)
        for a, b in table[:2, np.argsort(table[2], kind="stable")].T.astype(np.int64):
            one, other = root(int(a)), root(int(b))
            if one == other:
                continue
            mine, theirs = (seen_by.get(node, {int(owner[node])}) for node in (one, other))
            if not mine & theirs:
                parents[other] = one
                seen_by[one] = mine | theirs
                seen_by.pop(other, None)
    roots = np.array([root(node) for node in range(len(parents))], np.int64)
    linked = np.bincount(roots, minlength=len(roots))[roots] >= 2
    members = np.flatnonzero(linked)
    track = np.unique(roots[members], return_inverse=True)[1]
    order = np.lexsort([owner[members], track])
    members = members[order]
    return track[order], owner[members], members - firsts[owner[members]]


def thinned(sightings: PatternSightings, most: int = MOST_POINTS) -> PatternSightings:
    """Return at most `most` points: for each camera, its points that most cameras see."""
    views = np.bincount(sightings.points)
    if len(views) <= most:
        return sightings
    rank = np.empty(len(sightings.points), np.int64)
    for camera in np.unique(sightings.cameras):
        own = np.flatnonzero(sightings.cameras == camera)
        order = np.argsort(-views[sightings.points[own]], kind="stable")
        rank[own[order]] = np.arange(len(own))
    best = np.full(len(views), len(rank))
    np.minimum.at(best, sightings.points, rank)
    chosen = np.zeros(len(views), bool)
    chosen[np.lexsort([-views, best])[:most]] = True
    use = chosen[sightings.points]
    numbers = np.unique(sightings.points[use], return_inverse=True)[1]
    return PatternSightings(sightings.cameras[use], numbers, sightings.pixels[use])
