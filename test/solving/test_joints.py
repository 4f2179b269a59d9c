"""The compiled solver against the numpy one."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from rays import closest_points, ray_distances
from seen_views import observations

from panoptic_ros.geometry import triangulate_robust
from panoptic_ros.solving.agreement import agreement_of_pairs, agreement_with_people
from panoptic_ros.solving.joint_records import (
    JointAssignment,
    JointPredictions,
    PersonCandidates,
    SolvedJoints,
)
from panoptic_ros.solving.joints import settle, solve_joints, solve_without
from panoptic_ros.solving.scene import CameraPoses
from panoptic_ros.solving.triangulation import (
    FEW_FACTOR,
    TABLE,
    IterationLimit,
    PointSolution,
    SolverRules,
    refine_point,
)


def single_person(scenes, views=6, noise=2.0, seed=0):
    """Normalised points (V, J, 2) of one person with outliers, and the rig's arrays."""
    rng = np.random.default_rng(seed)
    rig, truth = scenes.ring(views), scenes.person(0.3, -0.2)
    plane = np.stack([c.intrinsics.undistort(c.project(truth)[0]) for c in rig.cameras])
    plane += noise / 1000.0 * rng.standard_normal(plane.shape)
    plane[rng.random(plane.shape[:2]) < 0.1] += 0.1
    return rig, plane


def only_person(views, guides):
    """One person, whom each view shows as its only 2D person."""
    joints = guides.spreads.shape[1]
    source = np.tile(np.arange(joints), (1, views, 1))
    return PersonCandidates(np.arange(views)[None], source, guides, np.array([-1]), guides.positions)


def seen(stack, plane):
    """2D joints (V, J, 2) of 2 px noise at a focal length of 1000 px, all at once."""
    views = len(plane)
    cams = CameraPoses(stack.rotations, stack.translations, np.zeros(views))
    precision = np.full(plane.shape[:2], 1000.0 / 2.0)
    return observations(plane, precision, np.arange(views), np.arange(views + 1), cams)


def test_final_step_equals_the_reference(scenes):
    for seed in range(5):
        rig, plane = single_person(scenes, seed=seed)
        stack = rig.stack()
        views, joints = plane.shape[:2]
        nothing = JointPredictions.of_nobody_known(1, joints, 1.0)
        rules = SolverRules(4.0, 3.0, 5.0, 4.0, 45)
        positions, normals, *_ = solve_joints(only_person(views, nothing), seen(stack, plane), rules)
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
        guides = JointPredictions(
            expected[None], np.full((1, joints), 0.05), np.zeros((1, joints, 3)), np.full((1, joints), firm)
        )
        rules = SolverRules(4.0, 3.0, 4.0, 4.0, 45)
        return solve_joints(only_person(2, guides), seen(stack, plane), rules).positions[0]

    away = truth + [0.0, 0.0, 0.3]
    assert np.abs(solved(truth, True) - truth).max() < 1e-6
    assert np.isnan(solved(away, True)).all()
    assert np.abs(solved(away, False) - truth).max() < 1e-6  # what is expected does not pull


def test_agreement_of_pairs_is_that_of_their_rays(scenes):
    rig, plane = single_person(scenes, views=3, noise=20.0)
    stack = rig.stack()
    value, common = agreement_of_pairs(np.arange(3), seen(stack, plane), stack.centres, 0.05)
    rays = stack.rays(plane)
    for a, b in ((0, 1), (0, 2), (1, 2)):
        centres = stack.centres[[a, b]][:, None]
        gap = ray_distances(centres[0], rays[a], centres[1], rays[b])
        _, depth_a, depth_b = closest_points(centres[0], rays[a], centres[1], rays[b])
        expected = np.where((depth_a > 0) & (depth_b > 0), np.exp(-(gap**2) / (2 * 0.05**2)), 0.0)
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
            truth.copy(),
            np.zeros(3),
            picks,
            seen(stack, plane),
            SolverRules(4.0, 3.0, gate, 4.0, 45),
            IterationLimit(6, True),
            PointSolution(np.zeros((3, 3)), found, np.empty((views, TABLE))),
        )
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
    guides = JointPredictions.of_nobody_known(1, 1, 0.03)
    if start:
        guides.positions[0] = truth + 0.02
    rules = SolverRules(4.0, 3.0, 4.0, 4.0, 45)
    found = solve_joints(only_person(views, guides), seen(rig.stack(), plane), rules)
    assert np.abs(found.positions[0] - truth).max() < 1e-3
    assert (found.residuals[0, 0, wild] < 0.0).all() and found.views[0, 0] == views - len(wild)


def test_views_that_do_not_meet_give_no_joint(scenes):
    rig = scenes.ring(3)
    plane = np.array([[0.0, 0.3], [0.0, -0.3], [0.0, 0.0]])[:, None]
    observations = seen(rig.stack(), plane)
    observations.precision[2] = 0.0
    rules = SolverRules(4.0, 3.0, 4.0, 4.0, 45)
    found = solve_joints(only_person(3, JointPredictions.of_nobody_known(1, 1, 0.03)), observations, rules)
    assert np.isnan(found.positions).all()


def test_every_observation_goes_to_whom_it_fits_best():
    residuals = np.array([[[1.0]], [[2.0]], [[1.5]]])
    picks = np.zeros((3, 1, 1, 2), np.int64)
    for member, penalty, winner in (([0, 0, 0], 4.0, 0), ([1, 0, 0], 4.0, 2)):
        owner = np.full((2, 1), -1)
        solved = SolvedJoints(np.zeros((3, 1, 3)), np.zeros((3, 1, 3, 3)), residuals, picks)
        claims = JointAssignment(np.array(member)[:, None], np.zeros((3, 1, 1), np.int64), owner)
        losers = settle(solved, claims, penalty)
        assert owner[0, 0] == winner and owner[1, 0] == -1
        assert losers[:, 0].tolist() == [p != winner for p in range(3)]


@given(seed=st.integers(0, 10**6), count=st.integers(1, 5))
def test_solved_without_wrong_2d_joints_equals_solved_anew(scenes, seed, count):
    """The second of two people far apart shows all wrong 2D joints; the first stays as it was."""
    rng = np.random.default_rng(seed)
    rig = scenes.ring(5)
    people = [scenes.person(-1.0, 0.0), scenes.person(1.0, 0.3)]
    plane = np.stack([c.intrinsics.undistort(c.project(truth)[0]) for c in rig.cameras for truth in people])
    plane += 2e-3 * rng.standard_normal(plane.shape)
    joints, stack = plane.shape[1], rig.stack()
    cams, starts = CameraPoses(stack.rotations, stack.translations, np.zeros(5)), 2 * np.arange(6)
    member = np.arange(10).reshape(5, 2).T.copy()
    source = np.tile(np.arange(joints), (2, 5, 1))
    nothing = JointPredictions.of_nobody_known(2, joints, 1.0)
    found = PersonCandidates(member, source, nothing, np.array([-1, -1]), nothing.positions)
    rules = SolverRules(4.0, 3.0, 5.0, 4.0, 45)
    wrong = np.zeros(plane.shape[:2], bool)
    wrong[rng.choice(member[1], count), rng.integers(0, joints, count)] = True

    def given_to(precision):
        return observations(plane, precision, np.repeat(np.arange(5), 2), starts, cams)

    first = given_to(np.full(plane.shape[:2], 500.0))
    solved = solve_joints(found, first, rules)
    before = solved.positions[0].copy()
    solve_without(wrong, solved, found, first, rules)
    anew = solve_joints(found, given_to(np.where(wrong, 0.0, 500.0)), rules)
    used = anew.residuals >= 0.0
    assert np.array_equal(solved.picks[used], anew.picks[used])
    for ours, expected in zip(solved[:3], anew[:3], strict=True):
        assert np.array_equal(ours, expected, equal_nan=True)
    assert np.array_equal(solved.positions[0], before, equal_nan=True)


def crowd(scenes, seed):
    """Return candidates and observations of four people whom views confuse and whose joints views miss."""
    rng = np.random.default_rng(seed)
    views, people = 5, 4
    rig = scenes.ring(views)
    truths = [scenes.person(*rng.uniform(-0.35, 0.35, 2), rng.uniform(0, 6)) for _ in range(people)]
    plane = np.stack([c.intrinsics.undistort(c.project(t)[0]) for c in rig.cameras for t in truths])
    plane += 4e-3 * rng.standard_normal(plane.shape)
    precision = np.where(rng.random(plane.shape[:2]) < 0.6, 500.0, 0.0)
    member = np.arange(views * people).reshape(views, people).T.copy()
    for v in range(views):
        if rng.random() < 0.5:
            member[:, v] = rng.permutation(member[:, v])
    member[rng.random(member.shape) < 0.2] = -1
    joints, stack = plane.shape[1], rig.stack()
    cams = CameraPoses(stack.rotations, stack.translations, np.zeros(views))
    starts = people * np.arange(views + 1)
    guides = JointPredictions.of_nobody_known(people, joints, 0.1)
    guides.positions[...] = np.stack(truths) + 0.03 * rng.standard_normal((people, joints, 3))
    source = np.tile(np.arange(joints), (people, views, 1))
    found = PersonCandidates(member, source, guides, np.full(people, -1), guides.positions)
    return found, observations(plane, precision, np.repeat(np.arange(views), people), starts, cams)


@given(seed=st.integers(0, 10**6))
def test_a_2d_joint_supports_one_joint_only(scenes, seed):
    """Paper 5.3, also after joints that lost a 2D joint were solved again."""
    found, first = crowd(scenes, seed)
    solved = solve_joints(found, first, SolverRules(4.0, 3.0, 5.0, 4.0, 45))
    used = solved.picks[solved.residuals >= 0.0]
    assert len(np.unique(used, axis=0)) == len(used)


@given(seed=st.integers(0, 10**6))
def test_joints_without_a_place_hold_no_2d_joints(scenes, seed):
    found, first = crowd(scenes, seed)
    solved = solve_joints(found, first, SolverRules(4.0, 3.0, 5.0, 4.0, 45))
    nowhere = np.isnan(solved.positions[..., 0])
    assert nowhere.any() and not nowhere.all()
    assert (solved.residuals[nowhere] < 0.0).all() and not solved.normals[nowhere].any()
    assert (solved.views[~nowhere] >= 2).all()
