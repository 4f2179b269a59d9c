"""Which device is on which segment: two that were exchanged turn as the other's segment does."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from panoptic_ros.geometry.rotations import mean_rotation, vectors_of

Array = np.ndarray
LOOKS = 25  # that are compared
FEWEST, FEWEST_LABELS = 8, 4  # for what must move, and what need not
ODD = 0.26  # rad, root mean square about a constant mounting: more than soft tissue and cameras explain
BETTER = 0.6  # share of that which the exchange must come below
WRONG, RIGHT = 0.7, 0.5  # rad off its mounting as said, and with the other's


class Exchange(NamedTuple):
    """Two devices (by number) that are on each other's segment, and how they sit there: (3, 3) each,
    segment from device."""

    devices: tuple[int, int]
    mounts: tuple[Array, Array]


class Wearing:
    """Compares how devices turn with how cameras alone see the segments turn."""

    def __init__(self, count: int):
        self._looks: deque[tuple[Array, Array]] = deque(maxlen=LOOKS)
        self._count = count

    def look(self, frames: Array, orientations: Array, mounts: Array, unseen: Array) -> Exchange | None:
        """Two devices that are exchanged, if there are any; after that all looks are forgotten.

        Either their names are, so that the mounting of each fits the data of the other; or they are, and then
        how they turn tells it as the body moves.

        Args:
            frames: (N, 3, 3) of the segments that the N devices are said to be on, seen by cameras alone.
            orientations: (N, 3, 3) world from device, NaN = not told.
            mounts: (N, 3, 3) segment from device, as said.
            unseen: (N, 3) axes of these segments about which cameras do not see them turn, 0 = none.
        """
        self._looks.append((frames, orientations))
        seen, told = (np.array([look[k] for look in self._looks]) for k in (0, 1))
        found = self._names(seen, told, mounts, unseen) if len(seen) >= FEWEST_LABELS else None
        if found is None and len(seen) >= FEWEST:
            found = self._turns(seen, told)
        if found is not None:
            self._looks.clear()
        return found

    def _names(self, seen: Array, told: Array, mounts: Array, unseen: Array) -> Exchange | None:
        """Two devices whose data fit when each has the other's place and mounting."""
        goals = told[-FEWEST_LABELS:, None] @ mounts.swapaxes(1, 2)[None, :, None]  # by place, then device
        turned = np.ascontiguousarray(seen[-FEWEST_LABELS:, :, None].swapaxes(-1, -2) @ goals)
        apart = np.linalg.norm(vectors_of(turned.reshape(-1, 3, 3)), axis=-1).reshape(turned.shape[:3])
        along = np.einsum("pi,lpdij,pj->lpd", unseen, turned, unseen)  # of bones: where they point
        points = np.linalg.norm(unseen, axis=-1)[:, None] > 0.0
        apart = np.where(points, np.arccos(np.clip(along, -1.0, 1.0)), apart)
        off = np.median(np.where(np.isfinite(apart), apart, 0.0), axis=0)
        wrong = np.flatnonzero(np.diag(off) > WRONG).tolist()
        pairs = [(max(off[i, j], off[j, i]), i, j) for i in wrong for j in wrong if i < j]
        worst, i, j = min(pairs, default=(np.inf, 0, 0))
        return Exchange((i, j), (mounts[j], mounts[i])) if worst < RIGHT else None

    def _turns(self, seen: Array, told: Array) -> Exchange | None:
        own, _ = _scatter(seen, told)
        odd = np.flatnonzero(own > ODD)
        pairs = [(i, j) for i in odd for j in odd if i < j]
        if not pairs:
            return None
        first, second = np.array(pairs).T
        there, mounts_i = _scatter(seen[:, second], told[:, first])
        here, mounts_j = _scatter(seen[:, first], told[:, second])
        share = (there + here) / (own[first] + own[second])
        best = int(share.argmin())
        if share[best] >= BETTER:
            return None
        i, j = pairs[best]
        return Exchange((int(i), int(j)), (mounts_i[best], mounts_j[best]))


def _scatter(seen: Array, told: Array) -> tuple[Array, Array]:
    """Root mean square (N,), rad, about a constant mounting (N, 3, 3), of N devices (looks, N, 3, 3) at the
    places (looks, N, 3, 3) that were seen; 0 where there are too few looks."""
    turned = seen.swapaxes(-1, -2) @ told
    there = np.isfinite(turned).all((-1, -2))
    turned = np.where(there[..., None, None], turned, 0.0)  # a mean is of the same direction with zeros
    middle = mean_rotation(turned)
    apart = np.where(there[..., None, None], turned @ middle.swapaxes(-1, -2), np.eye(3))
    squares = (vectors_of(apart.reshape(-1, 3, 3)) ** 2).sum(-1).reshape(there.shape).sum(0)
    count = there.sum(0)
    return np.where(count < FEWEST, 0.0, np.sqrt(squares / np.maximum(count, 1))), middle
