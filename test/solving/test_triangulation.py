"""The robust point refinement against many plain steps; the linear solution against numpy."""

import numpy as np
from seen_views import observations

from panoptic_ros.solving.scene import CameraPoses
from panoptic_ros.solving.triangulation import (
    TABLE,
    IterationLimit,
    PointSolution,
    SolverRules,
    refine_point,
    triangulate_linear,
)


def eyes(count, rng):
    """Cameras round the origin that look at it."""
    rotations = []
    for i in range(count):
        forward = np.array([np.cos(2.0 * i), np.sin(2.0 * i), 0.3 * rng.normal()])
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        rotations.append([right, np.cross(forward, right), forward])
    return CameraPoses(np.array(rotations), np.tile([0.0, 0.0, 4.0], (count, 1)), np.zeros(count))


def minimum(x, plane, precision, cams, cauchy):
    """Minimum of the Cauchy cost by a downhill search that knows no derivatives."""
    from scipy.optimize import minimize

    def cost(point):
        local = cams.rotations @ point + cams.translations
        r2 = ((local[:, :2] / local[:, 2:] - plane) ** 2).sum(axis=1) * precision**2
        return (cauchy**2 * np.log1p(r2 / cauchy**2)).sum()

    return minimize(cost, x, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}).x


def test_finds_the_minimum_of_the_cauchy_cost():
    for seed in range(6):
        rng = np.random.default_rng(seed)
        cams, views = eyes(5, rng), 5
        truth = rng.uniform(-0.5, 0.5, 3)
        local = cams.rotations @ truth + cams.translations
        plane = (local[:, :2] / local[:, 2:])[:, None] + 0.002 * rng.normal(size=(views, 1, 2))
        precision = np.full((views, 1), 500.0)
        picks = np.stack([np.arange(views), np.zeros(views, int)], axis=1)
        x, normal, residuals = truth + 0.05, np.empty((3, 3)), np.empty(views)
        rules = SolverRules(4.0, 3.0, 4.0, 4.0, 45)
        seen = observations(plane, precision, np.arange(views), np.arange(views + 1), cams)
        result = PointSolution(normal, residuals, np.empty((views, TABLE)))
        count = refine_point(x, np.zeros(3), picks, seen, rules, IterationLimit(30, False), result)
        assert count == views
        assert np.abs(x - minimum(truth, plane[:, 0], 500.0, cams, 3.0)).max() < 2e-5


def test_linear_triangulation_is_least_squares(scenes):
    rig, truth = scenes.ring(4), scenes.person(0.2, 0.1)
    stack, mirror = rig.stack(), np.array(scenes.skeleton.mirror)
    plane = np.stack([c.intrinsics.undistort(c.project(truth)[0]) for c in rig.cameras])
    plane += 1e-3 * np.random.default_rng(0).standard_normal(plane.shape)
    plane[2] = plane[2][mirror]
    weight = np.random.default_rng(1).uniform(0.0, 500.0, plane.shape[:2])
    member, mirrored = np.array([0, -1, 2, 3]), np.array([False, False, True, False])
    cams = CameraPoses(stack.rotations, stack.translations, np.zeros(4))
    seen = observations(plane, weight, np.arange(4), np.arange(5), cams)
    points = triangulate_linear(member, mirrored, seen, mirror)
    for j in range(len(truth)):
        rows, right = [], []
        for v in (0, 2, 3):
            s = mirror[j] if mirrored[v] else j
            for k in range(2):
                r, t = stack.rotations[v], stack.translations[v]
                rows.append(weight[v, s] * (plane[v, s, k] * r[2] - r[k]))
                right.append(weight[v, s] * (t[k] - plane[v, s, k] * t[2]))
        expected = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0]
        assert np.allclose(points[j], expected, atol=1e-6)
