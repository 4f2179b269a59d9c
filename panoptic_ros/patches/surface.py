"""Patches of the surface of people: seeded where tracks are, moved with their parts and as the images say."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import PartMotions
from panoptic_ros.geometry.rotations import rotation_of
from panoptic_ros.kernels import njit
from panoptic_ros.patches.motions import Lifted

Array = np.ndarray
SOFT = 0.005  # m, standard deviation by which a patch moves unlike its part
LOOSE = 0.03  # m, by which it does not
NEAR = 0.03  # m, reach of the tracks that speak for a patch
BEST_VIEWS = 6  # that a patch is measured in
GRAZING = 0.15  # cosine of the angle of view, below which a view does not count
APART = 0.03  # m between patches that are seeded
LEAST_WEIGHT = 0.2  # of the tracks near a patch in a view, that the view counts
# Logit of visibility: constant, cosine of the angle, weight of tracks near it, the same an instant before.
VISIBLE = (-2.2, 1.5, 2.5, 1.0)


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
    """No patches."""
    none = np.zeros(0, np.int64)
    return Surface(
        none, none, none, none, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, views))
    )


class Measured(NamedTuple):
    """What tracks say of N patches."""

    corrections: Array  # (N, 3) m, to where their parts carry them
    sigmas: Array  # (N,) m
    visible: Array  # (N, V) in 0..1


def moved(surface: Surface, motions: PartMotions, lifted: Lifted, life: int, views: Array) -> Surface:
    """The patches an instant later; those that end are left out.

    Args:
        life: instants after which a patch ends. views: (V, 3, 4) cam_from_world.
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
    found = Measured(np.zeros((count, 3)), np.zeros(count), np.zeros((count, views.shape[0])))
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
    after = Surface(
        surface.ids, surface.ages + 1, surface.people, surface.parts, positions + found.corrections, normals,
        found.sigmas, found.visible,
    )  # fmt: skip
    return _selected(after, alive)


def seeded(surface: Surface, motions: PartMotions, lifted: Lifted, most: Array, first_id: int) -> Surface:
    """With new patches where tracks are, on parts that have few.

    Args:
        most: by part, patches that a person has on it. first_id: of the new ones.
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
            chosen = spread_out(carried[starts[number] : starts[number + 1]], own, wanted) + starts[number]
            rows += chosen.tolist()
            normals.append(lifted.normals[chosen] @ turns[k].T)
    new, views = len(rows), surface.visible.shape[1]
    keys = [lifted.keys[group] for group in lifted.groups[rows].tolist()] if rows else []
    visible = np.zeros((new, views))
    visible[np.arange(new), lifted.tracks.cameras[rows]] = 1.0
    fresh = Surface(
        np.arange(first_id, first_id + new), np.zeros(new, np.int64),
        np.array([person for person, _ in keys], np.int64), np.array([part for _, part in keys], np.int64),
        carried[rows].reshape(-1, 3), np.concatenate(normals), np.full(new, SOFT), visible,
    )  # fmt: skip
    return Surface(*(np.concatenate(values) for values in zip(surface, fresh)))


def carried_tracks(lifted: Lifted, motions: PartMotions, numbers: Array) -> Array:
    """Where parts carry the points (N, 3) m of the tracks, NaN where a part has no motion.

    Args:
        numbers: (M,) of the groups of tracks of the motions.
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


def spread_out(points: Array, others: Array, wanted: int) -> Array:
    """Rows of so many points (N, 3) m, each the farthest from the others (M, 3) and from those before it."""
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
    """Rotations (M, 3, 3) of rotation vectors (M, 3) rad."""
    turns = np.empty((len(vectors), 3, 3))
    for vector, turn in zip(vectors, turns):
        rotation_of(vector, turn)
    return turns


def _selected(surface: Surface, which: Array) -> Surface:
    return Surface(*(values[which] for values in surface))


@njit(cache=True, error_model="numpy", nogil=True)
def measure(before, after, normals, numbers, starts, tracks, carried, views, seen, found):
    """What the tracks of its part near each patch say of it: the triangulated rest of its motion.

    Args:
        before, after: (N, 3) m, places; after: as parts carry them. normals: (N, 3), after.
        numbers: (N,) group of tracks of each. starts: first track of each group. carried: (T, 3) m, where
            parts carry the points of the tracks.
        seen: (N, V) visibility an instant before. found: `Measured`, filled.
    """
    count = len(views)
    weights, cosines = np.empty(count), np.empty(count)
    normal, gradient, used = np.empty((3, 3)), np.empty(3), np.empty(count, np.bool_)
    information, rests = np.empty((count, 3)), np.empty((count, 2))
    for n in range(len(before)):
        first, last = starts[numbers[n]], starts[numbers[n] + 1]
        for v in range(count):
            weights[v], used[v] = 0.0, False
            information[v], rests[v] = 0.0, 0.0
            cosines[v] = _cosine(views[v], after[n], normals[n])
        for t in range(first, last):
            square = 0.0
            for i in range(3):
                square += (tracks.points[t, i] - before[n, i]) ** 2
            if square > 9.0 * NEAR * NEAR:
                continue
            weight, v, view = np.exp(-0.5 * square / NEAR**2), tracks.cameras[t], views[tracks.cameras[t]]
            depth = _row(view, 2, carried[t])
            weights[v] += weight
            for i in range(3):
                information[v, i] += weight * tracks.information[t, i]
            for i in range(2):
                rests[v, i] += weight * (tracks.targets[t, i] - _row(view, i, carried[t]) / depth)
        for v in range(count):
            logit = (
                VISIBLE[0]
                + VISIBLE[1] * cosines[v]
                + VISIBLE[2] * min(weights[v], 1.0)
                + VISIBLE[3] * seen[n, v]
            )
            found.visible[n, v] = (
                1.0 / (1.0 + np.exp(-logit)) if weights[v] > 0.0 or cosines[v] > 0.0 else 0.0
            )
            if weights[v] > 0.0:
                for i in range(2):
                    rests[v, i] /= weights[v]
                for i in range(3):
                    information[v, i] /= max(weights[v], 1.0)
        normal[:], gradient[:] = 0.0, 0.0
        for i in range(3):
            normal[i, i] = 1.0 / SOFT**2
        for _ in range(min(BEST_VIEWS, count)):
            best, score = -1, 0.0
            for v in range(count):
                worth = cosines[v] * min(weights[v], 1.0)
                if not used[v] and cosines[v] > GRAZING and weights[v] > LEAST_WEIGHT and worth > score:
                    best, score = v, worth
            if best < 0:
                break
            used[best] = True
            _add(views[best], after[n], information[best], rests[best], normal, gradient)
        inverse = np.linalg.inv(normal)
        trace = 0.0
        for i in range(3):
            trace += inverse[i, i]
            for k in range(3):
                found.corrections[n, i] += inverse[i, k] * gradient[k]
        found.sigmas[n] = np.sqrt(trace / 3.0)


@njit(cache=True, error_model="numpy", nogil=True)
def _add(view, point, information, rest, normal, gradient):
    """Add what a view says of the motion of a point: a rest (2,) on its plane, with information (3,)."""
    depth = _row(view, 2, point)
    rows = np.empty((2, 3))
    for i in range(2):
        slope = _row(view, i, point) / depth
        for k in range(3):
            rows[i, k] = (view[i, k] - slope * view[2, k]) / depth
    a, b, c = information[0], information[1], information[2]
    growth = 1.0 + 0.25 * (a * rest[0] ** 2 + 2.0 * b * rest[0] * rest[1] + c * rest[1] ** 2)
    for i in range(3):
        along = (a * rows[0, i] + b * rows[1, i]) / growth
        across = (b * rows[0, i] + c * rows[1, i]) / growth
        gradient[i] += along * rest[0] + across * rest[1]
        for k in range(3):
            normal[i, k] += along * rows[0, k] + across * rows[1, k]


@njit(cache=True, error_model="numpy", nogil=True)
def _cosine(view, point, normal):
    """Cosine of the angle between the normal of a point and the direction to a camera; -1 behind it."""
    if _row(view, 2, point) <= 0.0:
        return -1.0
    along, square = 0.0, 0.0
    for i in range(3):
        place = 0.0  # camera's place less the point's: - R^T (R x + t)
        for k in range(3):
            place -= view[k, i] * _row(view, k, point)
        along += place * normal[i]
        square += place * place
    return along / np.sqrt(square)


@njit(cache=True, error_model="numpy", nogil=True)
def _row(view, i, point):
    """Coordinate i of a point (3,) in the frame of a camera."""
    return view[i, 0] * point[0] + view[i, 1] * point[1] + view[i, 2] * point[2] + view[i, 3]
