"""Displacements between instants against conditioning of one large Gaussian."""

from dataclasses import replace

import captures
import numpy as np
import patch_scene
import pytest

from panoptic_ros.domain import JointState, PartMotions, TrackedPoseSet
from panoptic_ros.domain.of_all import of_all
from panoptic_ros.domain.parts import rigid_parts
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.refinement import fading
from panoptic_ros.refinement.links import JointDisplacements, links_of, predict_linked, with_views
from panoptic_ros.refinement.motion_model import NINE, SIX, transition
from panoptic_ros.refinement.records import MotionStates

DT, NOISE = 0.04, 3.0
PARTS = [list(part.joints) for part in rigid_parts(captures.SKELETON)]


def spread(rng, size, scale):
    root = rng.normal(size=(size, size))
    return scale * (root @ root.T + np.eye(size))


@pytest.mark.parametrize("memory", [0.0, 0.05])
def test_a_displacement_conditions_both_states_exactly(memory):
    size, step = (9 if memory else 6), transition(DT, memory)
    rng = np.random.default_rng(1)
    state, cov = rng.normal(size=size), spread(rng, size, 1e-3)
    moved, own = DT * state[3:6] + 0.01 * rng.normal(size=3), spread(rng, 3, 1e-5)
    motion = MotionStates(state[None, None].copy(), cov[None, None].copy())
    ahead, gains = of_all(np.zeros_like, motion), np.zeros_like(motion.covariances)
    links = JointDisplacements(moved[None, None], own[None, None])
    sized = NINE if memory else SIX
    predict_linked(sized, motion, step, np.full((1, 1), NOISE), links, 1e9, ahead, gains, np.empty((1, 1, 3)))
    forward = np.kron(step.forward, np.eye(3))
    process = NOISE * np.kron(step.spread, np.eye(3))
    whole = np.block([[cov, cov @ forward.T], [forward @ cov, forward @ cov @ forward.T + process]])
    mean = np.concatenate([state, forward @ state])
    rows = np.zeros((3, 2 * size))
    rows[:, :3], rows[:, size : size + 3] = -np.eye(3), np.eye(3)
    gain = whole @ rows.T @ np.linalg.inv(rows @ whole @ rows.T + own)
    mean, whole = mean + gain @ (moved - rows @ mean), whole - gain @ rows @ whole
    assert motion.states[0, 0] == pytest.approx(mean[:size], abs=1e-10)
    assert motion.covariances[0, 0] == pytest.approx(whole[:size, :size], abs=1e-12)
    assert ahead.states[0, 0] == pytest.approx(mean[size:], abs=1e-10)
    assert ahead.covariances[0, 0] == pytest.approx(whole[size:, size:], abs=1e-12)
    backward = whole[:size, size:] @ np.linalg.inv(whole[size:, size:])
    assert gains[0, 0].T == pytest.approx(backward, abs=1e-6)


def motions(rng, parts, people=(7,)):
    keys = [(person, part) for person in people for part in parts]
    count = len(keys)
    return PartMotions(
        [key[0] for key in keys],
        [key[1] for key in keys],
        rng.normal(size=(count, 3)),
        0.3 * rng.normal(size=(count, 3)),
        0.02 * rng.normal(size=(count, 3)),
        np.array([spread(rng, 6, 1e-6) for _ in keys]),
        np.full(count, 20),
        np.ones(count),
    )


def test_joints_of_one_part_move_as_it_says():
    rng = np.random.default_rng(2)
    forearm = next(k for k, part in enumerate(rigid_parts(captures.SKELETON)) if part.name == "lElbow-lWrist")
    given, states = motions(rng, [forearm]), rng.normal(size=(1, 19, 6))
    links = links_of(given, PARTS, np.array([7]), states)
    vector = given.rotations[0]
    angle = np.linalg.norm(vector)
    k = np.cross(np.eye(3), vector / angle)
    rotation = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    for joint in PARTS[forearm]:
        place = states[0, joint, :3]
        after = given.centres[0] + given.translations[0] + rotation @ (place - given.centres[0])
        assert links.displacements[0, joint] == pytest.approx(after - place, abs=1e-12)
        arm = rotation @ (place - given.centres[0])
        jacobian = np.hstack([-np.cross(np.eye(3), arm), np.eye(3)])
        expected = jacobian @ given.covariances[0] @ jacobian.T
        assert links.spreads[0, joint] == pytest.approx(expected, rel=1e-6, abs=1e-15)
    others = [joint for joint in range(19) if joint not in PARTS[forearm]]
    assert np.isnan(links.displacements[0, others]).all()


def test_two_parts_are_averaged_by_their_information():
    rng = np.random.default_rng(3)
    names = [part.name for part in rigid_parts(captures.SKELETON)]
    arm, forearm = names.index("lShoulder-lElbow"), names.index("lElbow-lWrist")
    elbow = captures.SKELETON.joint("lElbow")
    both, states = motions(rng, [arm, forearm]), rng.normal(size=(1, 19, 6))
    rows = [PartMotions(*(getattr(both, name)[k : k + 1] for name in both.__slots__)) for k in (0, 1)]
    alone = [links_of(row, PARTS, np.array([7]), states) for row in rows]
    inverses = [np.linalg.inv(each.spreads[0, elbow]) for each in alone]
    total = np.linalg.inv(sum(inverses))
    mean = total @ sum(i @ each.displacements[0, elbow] for i, each in zip(inverses, alone))
    links = links_of(both, PARTS, np.array([7]), states)
    assert links.displacements[0, elbow] == pytest.approx(mean, abs=1e-9)
    assert links.spreads[0, elbow] == pytest.approx(total, rel=1e-6, abs=1e-15)


def test_nothing_is_said_of_strangers():
    rng = np.random.default_rng(4)
    assert links_of(motions(rng, [0], people=(9,)), PARTS, np.array([7]), rng.normal(size=(1, 19, 6))) is None


def test_differences_of_measurements_are_averaged_with_links_by_their_information():
    rng = np.random.default_rng(5)
    links = JointDisplacements(rng.normal(size=(3, 2, 3)), np.array([[spread(rng, 3, 1e-6)] * 2] * 3))
    links.displacements[2, 0] = np.nan
    moved, spreads = rng.normal(size=(2, 2, 3)), np.array([[spread(rng, 3, 1e-5)] * 2] * 2)
    moved[0, 1] = np.nan
    found = with_views(links, np.array([2, 0]), moved, spreads)
    assert np.isnan(found.displacements[2, 0]).all()  # a difference alone is not a link
    assert found.displacements[2, 1] == pytest.approx(links.displacements[2, 1])  # without a difference
    one, other = np.linalg.inv(links.spreads[0, 0]), np.linalg.inv(spreads[1, 0])
    mean = np.linalg.solve(one + other, one @ links.displacements[0, 0] + other @ moved[1, 0])
    assert found.displacements[0, 0] == pytest.approx(mean)
    assert found.spreads[0, 0] == pytest.approx(np.linalg.inv(one + other))
    assert found.displacements[1] == pytest.approx(links.displacements[1])


# ------------------------------------------------------------------ what they are worth


def refined(items, lag):
    stage = make_stage(
        "refinement",
        configure({"refinement": {"lag": lag, "bone_sigma": 0.0}})["refinement"],
        captures.CONTEXT,
    )
    return [output for item in items for output in stage.step(item).outputs] + list(stage.flush().outputs)


def noisy(count, noise, hidden=(), joint="lWrist"):
    """With the motion of the surface, and without; truth (count, 19, 3)."""
    surface = make_stage("patches", configure({"patches": {"active": True}})["patches"], captures.CONTEXT)
    with_motion, without, truth = [], [], []
    for item in patch_scene.recording(count, angle=0.15, noise_px=0.3):
        if isinstance(item, TrackedPoseSet):
            truth.append(item.positions[0])
            gone = [captures.SKELETON.joint(joint)] if item.index in hidden else []
            item = patch_scene.skeletons(item.index, item.positions[0], noise, gone)
            without.append(item)
        given = surface.step(item).outputs
        with_motion += [*given, *([item] if isinstance(item, TrackedPoseSet) else [])]
    return with_motion, without, np.array(truth)


def test_measured_motion_takes_noise_away_and_no_motion():
    with_motion, without, truth = noisy(24, 0.015)
    errors = [
        np.linalg.norm(np.array([item.positions[0] for item in refined(items, 0.2)]) - truth, axis=2)[
            6:
        ].mean()
        for items in (with_motion, without)
    ]
    assert errors[0] < 0.6 * errors[1]


def test_a_joint_that_began_at_a_wrong_place_is_not_carried_on_against_all_views():
    with_motion, _, truth = noisy(40, 0.003)
    wrist = captures.SKELETON.joint("lWrist")
    items = []
    for item in with_motion:
        if isinstance(item, TrackedPoseSet) and item.index < 6:
            positions = item.positions.copy()
            positions[0, wrist] += (0.5, 0.3, -0.6)
            item = replace(item, positions=positions)
        items.append(item)
    errors = [
        np.linalg.norm(item.positions[0, wrist] - truth[k, wrist])
        for k, item in enumerate(refined(items, 0.0))
    ]
    assert min(errors[:6]) > 0.5
    assert max(errors[16:]) < 0.03


@pytest.mark.parametrize("lag", [0.0, 0.5])
def test_a_gap_is_filled_where_the_surface_shows_the_motion(lag):
    """Half a second of a wrist in a curve."""
    hidden = range(8, 21)
    with_motion, without, truth = noisy(26, 0.002, hidden)
    wrist = captures.SKELETON.joint("lWrist")
    filled = refined(with_motion, lag)[8:21]
    assert all(item.states[0, wrist] in (JointState.PREDICTED, JointState.FILLED) for item in filled)
    errors = [np.linalg.norm(item.positions[0, wrist] - truth[k, wrist]) for k, item in zip(hidden, filled)]
    assert np.mean(errors) < 0.02
    assert any(item.states[0, wrist] == JointState.MISSING for item in refined(without, lag)[8:21])


def test_what_later_views_tell_is_faded_in_and_motion_is_not_delayed():
    with_motion, _, truth = noisy(24, 0.015)
    told = {}
    for share in (0.0, 0.5):
        own = {"refinement": {"lag": 0.12, "bone_sigma": 0.0, "fading": share}}
        stage = make_stage("refinement", configure(own)["refinement"], captures.CONTEXT)
        items = [output for item in with_motion for output in stage.step(item).outputs]
        errors = np.array([item.positions[0] for item in items]) - truth[: len(items)]
        turns = np.linalg.norm(np.diff(errors[6:], 2, axis=0), axis=2).mean()
        told[share] = np.linalg.norm(errors[6:], axis=2).mean(), turns
    assert told[0.5][1] < 0.9 * told[0.0][1]
    assert told[0.5][0] < 1.1 * told[0.0][0]


def turning(items, config):
    """How much errors turn (J,) m from instant to instant, and their means (J,) m."""
    stage = make_stage("refinement", configure({"refinement": config})["refinement"], captures.CONTEXT)
    *items, truth = items
    told = [output.positions[0] for item in items for output in stage.step(item).outputs]
    errors = np.array(told) - truth[: len(told)]
    turns = np.linalg.norm(np.diff(errors[6:], 2, axis=0), axis=2).mean(axis=0)
    return turns, np.linalg.norm(errors[6:], axis=2).mean(axis=0)


def test_without_a_lag_too_steps_of_single_views_are_faded_in(monkeypatch):
    with_motion, without, truth = noisy(24, 0.015)
    own = {"lag": 0.0, "bone_sigma": 0.0}
    monkeypatch.setattr(fading, "LEAST", 0.03)
    turns, errors = turning([*with_motion, truth], own)
    plain, _ = turning([*without, truth], own)
    monkeypatch.setattr(fading, "LEAST", 1e-9)
    at_once, errors_at_once = turning([*with_motion, truth], own)
    assert turns.mean() < 0.9 * at_once.mean() and errors.mean() < 1.05 * errors_at_once.mean()
    assert (turning([*without, truth], own)[0] == plain).all()  # nothing shows how joints move


def test_what_is_followed_gradually_arrives_without_a_step_of_its_speed():
    linked, span, dt = np.ones((1, 1), bool), 0.05, 0.001
    apart = np.zeros((1, 1, 6))
    apart[..., 0], apart[..., 3] = 0.01, 0.3
    places, speeds = [0.01], [0.3]
    for _ in range(500):
        apart = fading.settled(apart, linked, dt, span)
        places.append(apart[0, 0, 0])
        speeds.append(apart[0, 0, 3])
    assert np.diff(places) == pytest.approx(dt * np.array(speeds[1:]), abs=2e-5)  # one motion, at any step
    assert np.abs(np.diff(speeds)).max() < dt * 4.0 * (0.01 / span**2 + 0.3 / span) + 1e-6
    assert abs(places[-1]) < 1e-6
    once = fading.settled(np.array([[[0.01, 0, 0, 0.3, 0, 0]]]), linked, 0.5, span)
    assert once == pytest.approx(apart, abs=1e-9)
    assert not fading.settled(once + 1.0, ~linked, dt, span).any()
