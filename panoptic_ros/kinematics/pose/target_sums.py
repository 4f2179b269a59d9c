"""Targets of a pose, added to the sums of its segments; each returns its cost."""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.geometry.rotations import vector_of
from panoptic_ros.kernels import njit
from panoptic_ros.kinematics.pose.segment_sums import add_point, place_site
from panoptic_ros.kinematics.pose.targets import Floor, PointTargets, TurnTargets, ViewTargets

Array = np.ndarray
NEAREST = 0.1  # m before a camera

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def add_views(targets: ViewTargets, frames: Array, places: Array, matrices: Array, vectors: Array) -> float:
    cost = 0.0
    point, pull, information = np.empty(3), np.empty(3), np.empty((3, 3))
    across, down = np.empty(3), np.empty(3)
    for n in range(len(targets.segments)):
        weight = targets.weights[n]
        if weight <= 0.0:
            continue
        s, rotation, shift = targets.segments[n], targets.rotations[targets.cameras[n]], targets.translations
        place_site(frames[s], places[s], targets.offsets[n], point)
        k = targets.cameras[n]
        depth = (
            rotation[2, 0] * point[0] + rotation[2, 1] * point[1] + rotation[2, 2] * point[2] + shift[k, 2]
        )
        if depth < NEAREST:
            continue
        u = (
            rotation[0, 0] * point[0] + rotation[0, 1] * point[1] + rotation[0, 2] * point[2] + shift[k, 0]
        ) / depth
        v = (
            rotation[1, 0] * point[0] + rotation[1, 1] * point[1] + rotation[1, 2] * point[2] + shift[k, 1]
        ) / depth
        ru, rv = u - targets.points[n, 0], v - targets.points[n, 1]
        error = weight * (ru * ru + rv * rv)
        if targets.scale > 0.0:
            cost += targets.scale * math.log(1.0 + error / targets.scale)
            weight /= 1.0 + error / targets.scale
        else:
            cost += error
        for j in range(3):
            across[j] = (rotation[0, j] - u * rotation[2, j]) / depth
            down[j] = (rotation[1, j] - v * rotation[2, j]) / depth
            point[j] -= places[0, j]
        for i in range(3):
            pull[i] = weight * (across[i] * ru + down[i] * rv)
            for j in range(3):
                information[i, j] = weight * (across[i] * across[j] + down[i] * down[j])
        add_point(matrices[s], vectors[s], point, information, pull)
    return cost


@_jit
def add_points(targets: PointTargets, frames: Array, places: Array, matrices: Array, vectors: Array) -> float:
    cost = 0.0
    point, pull, information, error_of = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty(3)
    for n in range(len(targets.segments)):
        s = targets.segments[n]
        place_site(frames[s], places[s], targets.offsets[n], point)
        error = 0.0
        for j in range(3):
            error_of[j] = point[j] - targets.goals[n, j]
        for j in range(3):
            w = targets.information[n]
            pull[j] = w[j, 0] * error_of[0] + w[j, 1] * error_of[1] + w[j, 2] * error_of[2]
            error += pull[j] * error_of[j]
        kept = 1.0
        if targets.scale > 0.0:
            cost += targets.scale * math.log(1.0 + error / targets.scale)
            kept = 1.0 / (1.0 + error / targets.scale)
        else:
            cost += error
        for i in range(3):
            pull[i] *= kept
            point[i] -= places[0, i]
            for j in range(3):
                information[i, j] = kept * targets.information[n, i, j]
        add_point(matrices[s], vectors[s], point, information, pull)
    return cost


@_jit
def add_turns(targets: TurnTargets, frames: Array, matrices: Array, vectors: Array) -> float:
    """sin^2(a / 2) of the angle a: its gradient is that of k a^2 with k = sin(a) / (4 a)."""
    cost = 0.0
    apart, vector = np.empty((3, 3)), np.empty(3)
    for n in range(len(targets.segments)):
        s = targets.segments[n]
        for i in range(3):
            for j in range(3):
                apart[i, j] = (
                    frames[s, i, 0] * targets.goals[n, j, 0]
                    + frames[s, i, 1] * targets.goals[n, j, 1]
                    + frames[s, i, 2] * targets.goals[n, j, 2]
                )
        vector_of(apart, vector)
        angle = math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
        half = math.sin(0.5 * angle)
        error = targets.weights[n] * half * half
        weight = targets.weights[n] * (0.25 if angle < 1e-4 else math.sin(angle) / (4.0 * angle))
        if targets.scale > 0.0:
            cost += targets.scale * math.log(1.0 + error / targets.scale)
            weight /= 1.0 + error / targets.scale
        else:
            cost += error
        for i in range(3):
            vectors[s, i] += weight * vector[i]
            matrices[s, i, i] += weight
    return cost


@_jit
def add_floor(floor: Floor, places: Array, matrices: Array, vectors: Array) -> float:
    cost = 0.0
    arm, pull, information = np.empty(3), np.zeros(3), np.zeros((3, 3))
    for n in range(len(floor.segments)):
        s = floor.segments[n]
        below = floor.radius - places[s, 2]
        if below > 0.0 and floor.weight > 0.0:
            cost += floor.weight * below * below
            pull[2] = -floor.weight * below
            information[2, 2] = floor.weight
            for j in range(3):
                arm[j] = places[s, j] - places[0, j]
            add_point(matrices[s], vectors[s], arm, information, pull)
    return cost
