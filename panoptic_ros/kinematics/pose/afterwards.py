"""What instants that came later say about a pose, by eliminating them one after the other.

Of symmetric matrices one half is worked on: that takes half of the time.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from scipy.linalg import blas

from panoptic_ros.kernels import njit
from panoptic_ros.kinematics.pose.positive_matrices import factor_of, forward

Array = np.ndarray


class Linked(NamedTuple):
    """What an instant added: (D, D) of second differences with the two before it, of first differences with
    the one before, of its own evidence, and its lower factor; and, given all up to it, (2 D, 2 D) of the one
    before and it, and (2 D, D) by how much errors that last pull them, see `PoseWindow.covariance`. ratio: of
    the step of time to it to the one before."""

    bend: Array
    turn: Array
    own: Array
    root: Array
    joint: Array
    pulled: Array
    weight: float
    ratio: float


class Afterwards(NamedTuple):
    """What later instants say about a pose and the one before it, (2 D, 2 D), and by how much errors that
    last pull both through them, (2 D, D); how many instants ago that was found."""

    information: Array
    pulled: Array
    age: int


def afterwards(links: Iterable[Linked], free: Array) -> Afterwards:
    """Of instants after a pose.

    Args:
        links: of these instants, the newest first.
        free: (D, D), what the evidence of an instant leaves open.
    """
    n = len(free)
    later, own, count = np.zeros((2 * n, 2 * n), order="F"), np.zeros((n, n)), 0
    for link in links:
        later = _before(link, later)
        own += link.own
        count += 1
    _mirror(later)
    if not count:
        return Afterwards(later, np.zeros((2 * n, n)), 0)
    # what moves all later evidence by the same moves the pose by it: motion says nothing against that
    whole = later[:, :n] + later[:, n:]
    return Afterwards(later, forward(factor_of(own / count + free), whole.T).T, 0)


def _before(link: Linked, later: Array) -> Array:
    """What an instant and all after it say about the two before it, from what those after it say about it and
    the one before; the lower half of (2 D, 2 D), by columns."""
    n = len(link.own)
    newest, against = np.empty((n, n), order="F"), np.empty((n, 2 * n), order="F")
    found = np.empty((2 * n, 2 * n), order="F")
    _assemble((link.bend, link.ratio), link.turn, link.own, later, newest, against, found)
    solved = forward(factor_of(newest.T), against)
    left: Array = blas.dsyrk(-1.0, solved, 1.0, found, trans=1, lower=1, overwrite_c=1)
    return left


@njit(cache=True, error_model="numpy", nogil=True)
def _assemble(
    second: tuple[Array, float],
    turn: Array,
    own: Array,
    later: Array,
    newest: Array,
    against: Array,
    found: Array,
) -> None:
    """The lower halves of what the newest of three instants has with itself and the two before have with one
    another, and all that it has with them."""
    bend, ratio = second
    n, middle = len(bend), 1.0 + ratio
    for j in range(n):
        for i in range(n):
            k, t = bend[j, i], turn[j, i]
            against[i, j] = ratio * k
            against[i, n + j] = later[n + i, j] - middle * k - t
            found[n + i, j] = -ratio * middle * k
            if i >= j:
                newest[i, j] = k + t + own[j, i] + later[n + i, n + j]
                found[i, j] = ratio * ratio * k
                found[n + i, n + j] = middle * middle * k + t + later[i, j]


@njit(cache=True, error_model="numpy", nogil=True)
def _mirror(matrix: Array) -> None:
    """Fill the upper half from the lower one."""
    for j in range(len(matrix)):
        for i in range(j):
            matrix[i, j] = matrix[j, i]
