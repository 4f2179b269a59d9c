"""Which part of a person patches belong to, against distances computed one by one."""

import numpy as np

from panoptic_ros.patches.lifting import Capsules
from panoptic_ros.patches.surface import on_their_parts


def bodies(rng, count=2):
    ends = rng.uniform(-0.5, 0.5, (count, 2, 4, 3))
    radii = np.array([0.12, 0.05, 0.04, 0.07])
    return {10 * k: Capsules(ends[k, 0], ends[k, 1], radii) for k in range(count)}


def above(point, capsules, k):
    """Distance of a point from the surface of a capsule, by many points of its axis."""
    shares = np.linspace(0.0, 1.0, 2001)[:, None]
    axis = capsules.firsts[k] + shares * (capsules.lasts[k] - capsules.firsts[k])
    return np.linalg.norm(point - axis, axis=1).min() - capsules.radii[k]


def test_a_patch_is_its_parts_where_that_is_the_nearest_surface():
    rng = np.random.default_rng(4)
    people = bodies(rng)
    points, owners = rng.uniform(-0.6, 0.6, (60, 3)), rng.choice([0, 10], 60)
    nearest = [
        int(np.argmin([above(point, people[owner], k) for k in range(4)]))
        for point, owner in zip(points, owners.tolist())
    ]
    parts = np.where(np.arange(60) % 2, nearest, rng.integers(0, 4, 60))
    assert (on_their_parts(points, owners, parts, people) == (parts == nearest)).all()


def test_parts_and_people_that_are_not_known_have_no_patches():
    people = bodies(np.random.default_rng(5), 1)
    people[0].firsts[1] = np.nan
    points = people[0].lasts[[1, 0]]
    assert not on_their_parts(points, np.array([0, 3]), np.array([1, 0]), people).any()
