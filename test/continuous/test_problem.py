"""Stiffness that is learnt with the curves of a person."""

import captures
import numpy as np
from free_cameras import FreeCapture

from panoptic_ros.continuous.curves import ORDER
from panoptic_ros.continuous.follow import follow
from panoptic_ros.continuous.problem import (
    INSIDE_S,
    STEP_S,
    CurveProblem,
    TrackRays,
    grid_over,
    knots_inside,
    learn_stiffness,
)
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.geometry.splines import spline
from panoptic_ros.solving.frames import camera_frames

MIRROR = np.array(captures.SKELETON.mirror)
WRIST = captures.SKELETON.joint_names.index("lWrist")


def rays_of(spoil=lambda pixels, rng, camera: None, seconds=2.0):
    capture = FreeCapture(rate=25.0, seconds=seconds, speed=0.2, spoil=spoil)
    arrays = RigArrays.of(capture.rig)
    frames = camera_frames(capture.sets, arrays, captures.SKELETON)
    stamps = np.array([1e-9 * (frame.stamp_ns - frames[0].stamp_ns) for frame in frames])
    track = follow(frames, stamps, arrays, MIRROR)[0]
    return TrackRays.of(track.entries, frames, stamps, arrays, MIRROR), arrays


def test_a_false_ray_at_the_end_does_not_make_a_standing_person_fast():
    seen = {}

    def spoil(pixels, rng, camera):
        seen[camera] = seen.get(camera, 0) + 1
        if camera == 0 and seen[camera] == 1:
            pixels[:, WRIST] += 70.0

    rays, arrays = rays_of(spoil)
    problem = CurveProblem(rays, rays.stamps, arrays, grid_over(rays.stamps, 0.2))
    fit = problem.solve()
    problem.compare(fit)
    curve = spline(problem.grid.origin, problem.grid.step, fit.points.transpose(1, 0, 2))
    velocities = curve(rays.stamps, 1)[np.arange(len(rays.joints)), rays.joints]
    assert np.linalg.norm(velocities, axis=1).max() < 1.0
    first = np.flatnonzero((rays.joints == WRIST) & (rays.cameras == 0))[0]
    assert problem.growths[first] > 20.0  # the false ray is an outlier


def test_stiffness_is_learnt_between_rays():
    rays, _ = rays_of()
    grid = grid_over(rays.stamps, 0.2)
    inside = knots_inside(rays, rays.stamps, grid)
    times = grid.origin + STEP_S * np.arange(grid.number - ORDER)
    first, last = rays.stamps.min(), rays.stamps.max()
    assert inside[:, (times > first + INSIDE_S + STEP_S) & (times < last - INSIDE_S - STEP_S)].all()
    assert not inside[:, (times < first + INSIDE_S - STEP_S) | (times > last - INSIDE_S + STEP_S)].any()
    gone = rays.subset((rays.stamps < 0.7) | (rays.stamps > 1.5))
    gap = knots_inside(gone, gone.stamps, grid)
    assert not gap[:, (times > 0.6) & (times < 1.55)].any() and gap[:, np.abs(times - 0.3) < 0.02].all()
    brief = rays.subset(rays.stamps < 0.3)
    assert knots_inside(brief, brief.stamps, grid).all()


def test_stiffness_outside_is_that_of_the_nearest_inside():
    inside = np.zeros((1, 60), bool)
    inside[:, 10:50] = True
    differences = np.full((1, 60), 3e-4)
    differences[:, 50:] = 1.0
    stiffness = np.full((1, 60), 1e4)
    for _ in range(30):
        stiffness = learn_stiffness(stiffness, differences, np.zeros((1, 60)), inside)
    np.testing.assert_allclose(stiffness, 1e4, rtol=0.05)
