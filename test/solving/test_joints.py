"""The compiled solver against the numpy one."""
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from rays import closest_points, ray_distances

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.geometry import Intrinsics, Rigid, triangulate_robust
from panoptic_ros.solving.agreement import agreement_of_pairs, agreement_with_people
from panoptic_ros.solving.cameras import Cameras, Observations
from panoptic_ros.solving.gauss_newton import FEW_FACTOR, TABLE, Result, SolverRules, Steps, refine_point
from panoptic_ros.solving.joint_records import Claims, Guides
from panoptic_ros.solving.joints import solve_joints
from panoptic_ros.solving.undistortion import lens_records, undistort_points


def single_person(scenes, views=6, noise=2.0, seed=0):
    """Normalised points (V, J, 2) of one person with outliers, and the rig's arrays."""
    rng = np.random.default_rng(seed)
    rig, truth = scenes.ring(views), scenes.person(0.3, -0.2)
    plane = np.stack([c.intrinsics.undistort(c.project(truth)[0]) for c in rig.cameras])
    plane += noise / 1000.0 * rng.standard_normal(plane.shape)
    plane[rng.random(plane.shape[:2]) < 0.1] += 0.1
    return rig, plane


def claims(views, joints):
    """One person, whom each view shows as its only 2D person."""
    source = np.tile(np.arange(joints), (1, views, 1))
    return Claims(np.arange(views)[None], source, np.full((views, joints), -1))


def seen(stack, plane):
    """2D joints (V, J, 2) of 2 px noise at a focal length of 1000 px, all at once."""
    views = len(plane)
    cams = Cameras(stack.rotations, stack.translations, np.zeros(views))
    precision = np.full(plane.shape[:2], 1000.0 / 2.0)
    return Observations(plane, precision, np.arange(views), np.arange(views + 1), cams)


def test_final_step_equals_the_reference(scenes):
    for seed in range(5):
        rig, plane = single_person(scenes, seed=seed)
        stack = rig.stack()
        views, joints = plane.shape[:2]
        nothing = Guides.of_nobody_known(1, joints, 1.0)
        rules = SolverRules(4.0, 3.0, 5.0, 4.0, 45)
        positions, normals, *_ = solve_joints(nothing, claims(views, joints), seen(stack, plane), rules)
        reference = triangulate_robust(
            stack, plane.swapaxes(0, 1), np.full((joints, views), 2.0), positions[0], iterations=30
        )
        assert np.abs(reference.points - positions[0]).max() < 1e-3  # noise moves joints by 8 mm
        lower = np.tril(normals[0])
        full = lower + np.swapaxes(np.tril(normals[0], -1), 1, 2)
        assert np.allclose(np.linalg.inv(full), reference.covariances, rtol=0.05, atol=1e-7)


def test_two_views_that_deny_a_firm_place_are_not_believed(scenes):
    rig, truth = scenes.ring(2), scenes.person()
    stack, joints = rig.stack(), len(truth)
    plane = np.stack([c.intrinsics.undistort(c.project(truth)[0]) for c in rig.cameras])

    def solved(expected, firm):
        guides = Guides(
            expected[None], np.full((1, joints), 0.05), np.zeros((1, joints, 3)), np.full((1, joints), firm)
        )
        rules = SolverRules(4.0, 3.0, 4.0, 4.0, 45)
        return solve_joints(guides, claims(2, joints), seen(stack, plane), rules).positions[0]

    away = truth + [0.0, 0.0, 0.3]
    assert np.abs(solved(truth, True) - truth).max() < 1e-6
    assert np.isnan(solved(away, True)).all()
    assert np.abs(solved(away, False) - truth).max() < 1e-6  # what is expected does not pull


def test_undistortion_equals_the_camera_model(scenes):
    rig = scenes.ring(3, distortion=(-0.25, 0.08, 0.001, -0.002, 0.01))
    rng = np.random.default_rng(0)
    pixels = rng.uniform([0, 0], [1280, 960], (3, 50, 2))
    usable = np.ones((3, 50), bool)
    plane, magnification, good = undistort_points(pixels, usable, np.arange(3), lens_records(rig))
    expected = np.stack([c.intrinsics.undistort(p) for c, p in zip(rig.cameras, pixels)])
    assert (good == np.isfinite(expected[..., 0])).all()
    assert np.abs(plane - expected)[good].max() < 1e-9
    assert (magnification == 1.0).all()


def test_undistortion_of_a_fisheye_equals_the_camera_model():
    lens = Intrinsics([[300.0, 0.5, 639.5], [0, 310.0, 479.5], [0, 0, 1]], [0.03, -0.02, 0.005, 0], "fisheye")
    rig = Rig((Camera("a", (1280, 960), lens, Rigid.identity()),))
    pixels = np.random.default_rng(0).uniform([0, 0], [1280, 960], (1, 400, 2))
    plane, magnification, good = undistort_points(
        pixels, np.ones((1, 400), bool), np.zeros(1, int), lens_records(rig)
    )
    expected = lens.undistort(pixels)
    assert (good == np.isfinite(expected[..., 0])).all()
    assert 100 < good.sum() < 400  # some are beyond 90 degrees
    assert (np.abs(plane - expected) / np.hypot(*plane.T).T[..., None].clip(1.0))[good].max() < 1e-9
    growth = np.sqrt(np.linalg.det(lens.distort_jacobian(plane[good])))
    assert np.allclose(magnification[good], growth, rtol=1e-6)


def test_agreement_of_pairs_is_that_of_their_rays(scenes):
    rig, plane = single_person(scenes, views=3, noise=20.0)
    stack = rig.stack()
    value, common = agreement_of_pairs(np.arange(3), seen(stack, plane), stack.centres, 0.05)
    rays = stack.rays(plane)
    for a, b in ((0, 1), (0, 2), (1, 2)):
        centres = stack.centres[[a, b]][:, None]
        gap = ray_distances(centres[0], rays[a], centres[1], rays[b])
        _, depth_a, depth_b = closest_points(centres[0], rays[a], centres[1], rays[b])
        expected = np.where((depth_a > 0) & (depth_b > 0), np.exp(-gap**2 / (2 * 0.05**2)), 0.0)
        assert np.isclose(value[a, b], expected.mean()) and common[a, b] == plane.shape[1]


def test_agreement_with_people_is_residual_times_depth(scenes):
    rig, plane = single_person(scenes, views=3)
    stack, truth = rig.stack(), scenes.person(0.35, -0.2)
    mirror = np.array(scenes.skeleton.mirror)
    straight, mirrored, _ = agreement_with_people(
        truth[None], np.zeros((1, 19, 3)), seen(stack, plane), mirror, 0.05
    )
    for v, camera in enumerate(rig.cameras):
        for order, value in ((np.arange(19), straight), (mirror, mirrored)):
            local = camera.cam_from_world.apply(truth[order])
            metres = np.linalg.norm(local[:, :2] - plane[v] * local[:, 2:], axis=1)
            assert np.isclose(value[0, v], np.exp(-(metres**2) / (2 * 0.05**2)).mean())


def test_the_gate_is_wider_where_few_views_are_left(scenes):
    rig, truth = scenes.ring(6), scenes.person(0.3, -0.2)[0]
    stack, views = rig.stack(), 6
    plane = np.stack([c.intrinsics.undistort(c.project(truth)[0]) for c in rig.cameras])[:, None]
    plane[0, 0, 0] += 0.01

    def residuals(count, gate):
        picks = np.stack([np.arange(views), np.zeros(views, np.int64)], axis=1)
        picks[count:] = -1
        found = np.zeros(views)
        refine_point(
            truth.copy(), np.zeros(3), picks, seen(stack, plane), SolverRules(4.0, 3.0, gate, 4.0, 45),
            Steps(6, True), Result(np.zeros((3, 3)), found, np.empty((views, TABLE))),
        )  # fmt: skip
        return found

    for count, factor in ((3, FEW_FACTOR), (6, 1.0)):
        largest = residuals(count, 100.0)[:count].max()
        assert (residuals(count, 1.2 * largest / factor)[:count] >= 0.0).all()
        assert (residuals(count, 0.9 * largest / factor)[:count] < 0.0).any()


@given(seed=st.integers(0, 10**6), views=st.integers(4, 8), start=st.booleans())
def test_wild_views_do_not_pull(scenes, seed, views, start):
    rng, rig = np.random.default_rng(seed), scenes.ring(views)
    truth = np.array([rng.uniform(-0.5, 0.5, 3) + (0.0, 0.0, 1.0)])
    plane = np.stack([c.intrinsics.undistort(c.project(truth)[0]) for c in rig.cameras])
    wild = rng.choice(views, 2 if views > 5 else 1, replace=False)
    plane[wild] += rng.choice([-1.0, 1.0], (len(wild), 1, 2)) * rng.uniform(0.15, 0.3, (len(wild), 1, 2))
    guides = Guides.of_nobody_known(1, 1, 0.03)
    if start:
        guides.positions[0] = truth + 0.02
    rules = SolverRules(4.0, 3.0, 4.0, 4.0, 45)
    found = solve_joints(guides, claims(views, 1), seen(rig.stack(), plane), rules)
    assert np.abs(found.positions[0] - truth).max() < 1e-3
    assert (found.residuals[0, 0, wild] < 0.0).all() and found.views[0, 0] == views - len(wild)


def test_views_that_do_not_meet_give_no_joint(scenes):
    rig = scenes.ring(3)
    plane = np.array([[0.0, 0.3], [0.0, -0.3], [0.0, 0.0]])[:, None]
    observations = seen(rig.stack(), plane)
    observations.precision[2] = 0.0
    rules = SolverRules(4.0, 3.0, 4.0, 4.0, 45)
    found = solve_joints(Guides.of_nobody_known(1, 1, 0.03), claims(3, 1), observations, rules)
    assert np.isnan(found.positions).all()
