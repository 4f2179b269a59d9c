"""Hand-made people whose scores can be computed by hand."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence

NAMES = ("Neck", "Nose", "BodyCenter", "lWrist")
BODY = np.array([[0.0, 0.0, 1.4], [0.1, 0.0, 1.6], [0.0, 0.0, 0.9], [0.3, 0.3, 1.0]])
PERIOD_NS = 40_000_000


def people_at(index: int, count: int = 2) -> np.ndarray:
    """Joints (P, 4, 3) m of people who walk along x at 1 m/s, 2 m apart."""
    shift = np.array([0.04 * index, 0.0, 0.0])
    return np.stack([BODY + shift + np.array([0.0, 2.0 * k, 0.0]) for k in range(count)])


class Build:
    """Makes frames and sequences of the joints `NAMES`."""

    names = NAMES
    period_ns = PERIOD_NS
    people_at = staticmethod(people_at)

    @staticmethod
    def frame(index, ids, positions, delay_ns=0, **more):
        positions = np.asarray(positions, float).reshape(len(ids), len(NAMES), 3)
        return SkeletonFrame(10**9 + index * PERIOD_NS + delay_ns, np.array(ids), positions, **more)

    @staticmethod
    def sequence(frames):
        return SkeletonSequence(NAMES, tuple(frames))

    @classmethod
    def single(cls, positions):
        """One frame."""
        return cls.sequence([cls.frame(0, list(range(len(positions))), positions)])

    @classmethod
    def walk(cls, frames=10, count=2, offset=(0.0, 0.0, 0.0), ids=None, **more):
        """Everybody in all frames, moved by `offset`; `ids(index)` gives the ids."""
        name = ids or (lambda index: list(range(count)))
        return cls.sequence(
            cls.frame(i, name(i), people_at(i, count) + np.array(offset), **more) for i in range(frames)
        )


@pytest.fixture
def build():
    return Build
