"""Surface patches of people: created at 2D tracks, moved with their parts and corrected by the images.

The surface of a part is a capsule. A patch belongs to a part as long as no other part of the person is nearer
at any instant (Joo et al. 2017, 6.2). Distances are measured from the surface instead of the axis, because
parts differ in girth. This test removes wrong points. Flow assigns points to parts by the 2D joints of one
view. So a limb also gets points beyond its end, and an arm gets points on the chest behind it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import PartMotions
from panoptic_ros.geometry.rotations import rotation_of
from panoptic_ros.patches.lifting import Capsules, nearest_parts
from panoptic_ros.patches.motions import LiftedTracks
from panoptic_ros.patches.patch_motion import SOFT, PatchMeasurements, measure

Array = np.ndarray
LOOSE = 0.03  # m, correction from which a patch ends, because it does not move with its part
APART = 0.03  # m, least distance between new patches


class Surface(NamedTuple):
    """N patches; see `PatchTrajectories`."""

    ids: Array
    ages: Array
    people: Array
    parts: Array
    positions: Array
    normals: Array
    sigmas: Array
    visible: Array  # (N, V)


def no_surface(views: int) -> Surface:
    """Return a surface without patches."""
    none = np.zeros(0, np.int64)
    return Surface(
        none, none, none, none, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, views))
    )


def moved(
    surface: Surface,
    motions: PartMotions,
    lifted: LiftedTracks,
    bodies: Mapping[int, Capsules],
    life: int,
    views: Array,
) -> Surface:
    """Return the patches one instant later, without those that end.

    Args:
        bodies: Capsules of people at that instant, by id.
        life: Number of instants after which a patch ends.
        views: (V, 3, 4) cam_from_world.
    """
    row_of = {key: row for row, key in enumerate(zip(motions.people.tolist(), motions.parts.tolist()))}
    keys = zip(surface.people.tolist(), surface.parts.tolist())
    rows = np.array([row_of.get(key, -1) for key in keys], np.int64)
    kept = (rows >= 0) & (surface.ages < life)
    surface, rows = _selected(surface, kept), rows[kept]
    if not len(rows):
        return surface
    turns = rotations_of(motions.rotations)[rows]
    centres, translations = motions.centres[rows], motions.translations[rows]
    arms = np.einsum("nij,nj->ni", turns, surface.positions - centres)
    positions = centres + translations + arms
    normals = np.einsum("nij,nj->ni", turns, surface.normals)
    count, seen = len(rows), surface.visible
    found = PatchMeasurements(np.zeros((count, 3)), np.zeros(count), np.zeros((count, views.shape[0])))
    numbers = np.array([lifted.keys.index(key) for key in row_of], np.int64)
    starts = np.searchsorted(lifted.groups, np.arange(len(lifted.keys) + 1))
    carried = carried_tracks(lifted, motions, numbers)
    measure(
        surface.positions,
        positions,
        normals,
        numbers[rows],
        starts,
        lifted.tracks,
        carried,
        views,
        seen,
        found,
    )
    alive = (np.linalg.norm(found.corrections, axis=1) < LOOSE) & (found.visible > 0.5).any(axis=1)
    positions += found.corrections
    alive &= on_their_parts(positions, surface.people, surface.parts, bodies)
    after = Surface(
        surface.ids,
        surface.ages + 1,
        surface.people,
        surface.parts,
        positions,
        normals,
        found.sigmas,
        found.visible,
    )
    return _selected(after, alive)


def seeded(
    surface: Surface,
    motions: PartMotions,
    lifted: LiftedTracks,
    bodies: Mapping[int, Capsules],
    most: Array,
    first_id: int,
) -> Surface:
    """Return the surface with new patches at tracks, on parts that have few.

    Args:
        bodies: See `moved`.
        most: Greatest number of patches of a person, by part.
        first_id: id of the first new patch.
    """
    numbers = [lifted.keys.index(key) for key in zip(motions.people.tolist(), motions.parts.tolist())]
    carried = carried_tracks(lifted, motions, np.array(numbers, np.int64))
    turns = rotations_of(motions.rotations)
    starts = np.searchsorted(lifted.groups, np.arange(len(lifted.keys) + 1))
    rows: list[int] = []
    normals = [np.zeros((0, 3))]
    for k, number in enumerate(numbers):
        person, part = lifted.keys[number]
        own = surface.positions[(surface.people == person) & (surface.parts == part)]
        wanted = int(most[part]) - len(own)
        if wanted > 0:
            there = np.arange(starts[number], starts[number + 1])
            same = np.ones(len(there), np.int64)
            there = there[on_their_parts(carried[there], person * same, part * same, bodies)]
            chosen = there[spread_out(carried[there], own, wanted)]
            rows += chosen.tolist()
            normals.append(lifted.normals[chosen] @ turns[k].T)
    new, views = len(rows), surface.visible.shape[1]
    keys = [lifted.keys[group] for group in lifted.groups[rows].tolist()] if rows else []
    visible = np.zeros((new, views))
    visible[np.arange(new), lifted.tracks.cameras[rows]] = 1.0
    fresh = Surface(
        np.arange(first_id, first_id + new),
        np.zeros(new, np.int64),
        np.array([person for person, _ in keys], np.int64),
        np.array([part for _, part in keys], np.int64),
        carried[rows].reshape(-1, 3),
        np.concatenate(normals),
        np.full(new, SOFT),
        visible,
    )
    return Surface(*(np.concatenate(values) for values in zip(surface, fresh)))


def carried_tracks(lifted: LiftedTracks, motions: PartMotions, numbers: Array) -> Array:
    """Return the points (N, 3) m of the tracks, moved by their parts; NaN where a part has no motion.

    Args:
        numbers: (M,) group of tracks of each motion.
    """
    row_of = np.full(len(lifted.keys) + 1, -1)
    row_of[numbers] = np.arange(len(numbers))
    rows = row_of[lifted.groups] if len(lifted.groups) else np.zeros(0, np.int64)
    known = rows >= 0
    carried = np.full(lifted.tracks.points.shape, np.nan)
    own = rows[known]
    arms = lifted.tracks.points[known] - motions.centres[own]
    turned = np.einsum("nij,nj->ni", rotations_of(motions.rotations)[own], arms)
    carried[known] = motions.centres[own] + motions.translations[own] + turned
    return carried


def on_their_parts(points: Array, people: Array, parts: Array, bodies: Mapping[int, Capsules]) -> Array:
    """Return whether the part (N,) of each point (N, 3) m is the nearest part of its person (N,).

    See the module for the distance.
    """
    known = [number for number in dict.fromkeys(people.tolist()) if number in bodies]
    there = np.isin(people, known)
    rows = np.array([known.index(number) for number in people[there].tolist()], np.int64)
    nearest = np.full(len(points), -1)
    if there.any():
        firsts, lasts, radii = (np.stack(values) for values in zip(*(bodies[number] for number in known)))
        found = np.empty(len(rows), np.int64)
        nearest_parts(points[there], rows, firsts, lasts, radii[0], found)
        nearest[there] = found
    own: Array = np.equal(nearest, parts)
    return own


def spread_out(points: Array, others: Array, wanted: int) -> Array:
    """Return rows of at most `wanted` points (N, 3) m that are far from each other and from `others` (M, 3).

    Each is the farthest from the others and from those chosen before it.
    """
    chosen: list[int] = []
    distances = np.full(len(points), np.inf)
    for other in others:
        distances = np.minimum(distances, np.linalg.norm(points - other, axis=1))
    while len(chosen) < min(wanted, len(points)):
        row = int(np.argmax(distances))
        if not distances[row] > APART:
            break
        chosen.append(row)
        distances = np.minimum(distances, np.linalg.norm(points - points[row], axis=1))
    return np.array(chosen, np.int64)


def rotations_of(vectors: Array) -> Array:
    """Return the rotations (M, 3, 3) of rotation vectors (M, 3) rad."""
    turns = np.empty((len(vectors), 3, 3))
    for vector, turn in zip(vectors, turns):
        rotation_of(vector, turn)
    return turns


def _selected(surface: Surface, which: Array) -> Surface:
    return Surface(*(values[which] for values in surface))
