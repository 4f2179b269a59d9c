"""Refinement of motions with exact truth."""

import numpy as np
import pytest

from panoptic_ros.domain import JointState, Rig, SkeletonModel, TimeShift, TrackedPoseSet
from panoptic_ros.errors import DataError
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.refinement.stage import RefinementStage
from panoptic_ros.stage import StageContext

MODEL = SkeletonModel("arm", ("shoulder", "elbow", "wrist"), 0, ((0, 1), (1, 2)), 0)
SIGMA = 0.01  # m


def truth(time):
    """A waving arm of somebody who walks, (3, 3) m."""
    shoulder = np.array([0.8 * time, 0.0, 1.4])
    a, b = 0.8 * np.sin(3.0 * time), 1.2 * np.sin(5.0 * time + 1.0)
    elbow = shoulder + 0.3 * np.array([np.sin(a), 0.3, -np.cos(a)]) / np.hypot(1.0, 0.3)
    return np.stack([shoulder, elbow, elbow + 0.27 * np.array([np.sin(b), 0.0, -np.cos(b)])])


def tracked(index, positions, rate=30.0, ids=(4,), **more):
    positions = np.array(positions, float).reshape(-1, 3, 3)
    there = np.isfinite(positions[..., 0])
    return TrackedPoseSet(
        index,
        round(1e9 + index * 1e9 / rate),
        MODEL.hash,
        positions,
        np.where(there[..., None, None], SIGMA**2 * np.eye(3), np.nan),
        0.8 * there,
        3 * there,
        np.where(there, JointState.MEASURED, JointState.MISSING),
        np.full(len(positions), 0.8),
        ids=np.array(ids[: len(positions)], np.int64),
        **more,
    )


def run(sets, **settings):
    stage = RefinementStage(RefinementConfig(**settings), StageContext(Rig(()), MODEL))
    results = [stage.step(item) for item in sets] + [stage.flush()]
    return [output for result in results for output in result.outputs]


def noisy(count, rate=30.0, seed=0):
    rng = np.random.default_rng(seed)
    exact = [truth(i / rate) for i in range(count)]
    return exact, [tracked(i, x + rng.normal(0, SIGMA, x.shape), rate) for i, x in enumerate(exact)]


@pytest.mark.parametrize("rate", [25.0, 60.0])
def test_smoothing_brings_joints_nearer_and_covariances_stay_honest(rate):
    exact, sets = noisy(int(4 * rate), rate)
    outputs = run(sets)
    assert [o.stamp_ns for o in outputs] == [s.stamp_ns for s in sets]
    late = range(20, len(sets))
    raw = np.mean([np.linalg.norm(sets[i].positions[0] - exact[i], axis=-1) for i in late])
    refined = np.mean([np.linalg.norm(outputs[i].positions[0] - exact[i], axis=-1) for i in late])
    assert refined < 0.75 * raw
    nees = []
    for i in late:
        offset = outputs[i].positions[0] - exact[i]
        scaled = np.linalg.solve(outputs[i].covariances[0], offset[..., None])[..., 0]
        nees.append((offset * scaled).sum(-1))
    assert 0.4 < np.mean(nees) / 3.0 < 1.4


def test_longer_lag_is_better():
    exact, sets = noisy(120)
    errors = [
        np.mean([np.linalg.norm(o.positions[0] - x) for o, x in zip(run(sets, lag=lag), exact)])
        for lag in (0.0, 0.1, 0.3)
    ]
    assert errors[0] > errors[1] > errors[2]


def test_every_set_comes_out_after_the_lag():
    _, sets = noisy(10)
    stage = RefinementStage(RefinementConfig(lag=0.1), StageContext(Rig(()), MODEL))
    assert [len(stage.step(item).outputs) for item in sets] == [0] * 3 + [1] * 7
    assert [o.index for o in stage.flush().outputs] == [7, 8, 9]
    now = RefinementStage(RefinementConfig(lag=0.0), StageContext(Rig(()), MODEL))
    assert [len(now.step(item).outputs) for item in sets] == [1] * 10


class TestStampsOfTheirOwn:
    """Sets whose joints were seen 12 ms after the instant along x, and at -8 and 4 ms along y and z."""

    delays = np.diag([0.012, -0.008, 0.004])  # s
    newest = 15_000_000  # ns after the set

    def sets(self, known=True, count=60, rate=30.0):
        rng = np.random.default_rng(3)
        sets, exact = [], []
        for index in range(count):
            time = index / rate
            velocity = (truth(time + 1e-4) - truth(time - 1e-4)) / 2e-4
            seen = truth(time) + velocity @ self.delays + rng.normal(0, 0.2 * SIGMA, (3, 3))
            shift = TimeShift(
                np.tile(self.delays, (1, 3, 1, 1)),
                np.zeros((1, 3, 3)),
                velocity[None],
                np.tile(0.1 * np.eye(3), (1, 3, 1, 1)),
            )
            stamp = round(1e9 + index * 1e9 / rate)
            more = {"time_shift": shift} if known else {}
            sets.append(tracked(index, seen, rate, newest_ns=stamp + self.newest, **more))
            exact.append(time)
        return sets, exact

    def errors(self, outputs):
        gaps = [o.positions[0] - truth(1e-9 * (o.stamp_ns - 10**9)) for o in outputs[20:]]
        return np.linalg.norm(gaps, axis=-1).mean()

    def test_joints_are_put_where_they_were_at_the_instant(self):
        aware, blind = (run(self.sets(known)[0]) for known in (True, False))
        assert self.errors(aware) < 0.5 * self.errors(blind)

    @pytest.mark.parametrize(
        ("lag", "after", "latest"),
        [(0.0, 15, 15), (1 / 60, 0, 15), (1 / 30, 15, 15 + 34), (0.12, 0, 15 + 101)],
    )
    def test_results_use_views_up_to_the_lag(self, lag, after, latest):
        sets, _ = self.sets()
        stage = RefinementStage(RefinementConfig(lag=lag), StageContext(Rig(()), MODEL))
        given = [(item, o) for item in sets for o in stage.step(item).outputs]
        for item, output in given[2:]:
            start = sets[output.index].stamp_ns
            assert abs(output.stamp_ns - start - 1e6 * after) < 1e6
            assert item.newest_ns <= start + 1e6 * latest
            assert item.newest_ns <= output.stamp_ns + 1e9 * lag + 4e6
        assert len(given) >= len(sets) - 4
        shorter = [o.positions for _, o in given[:-8]]
        again = RefinementStage(RefinementConfig(lag=lag), StageContext(Rig(()), MODEL))
        cut = [o.positions for item in sets[:-4] for o in again.step(item).outputs]
        assert all(np.array_equal(a, b) for a, b in zip(shorter, cut))

    def test_errors_fall_with_the_lag(self):
        errors = [self.errors(run(self.sets()[0], lag=lag)) for lag in (0.0, 1 / 60, 1 / 30, 0.12)]
        assert errors[0] > errors[1] > errors[2] > errors[3]


def test_gaps_are_filled_from_both_sides_and_predicted_at_the_end():
    exact, sets = noisy(40)
    holes = []
    for i, item in enumerate(sets):
        positions = item.positions.copy()
        if i in (20, 21) or 30 <= i < 40:
            positions[0, 2] = np.nan
        holes.append(tracked(i, positions))
    outputs = run(holes)
    states = [int(o.states[0, 2]) for o in outputs]
    assert states[20:22] == [JointState.FILLED] * 2
    assert states[30] == JointState.PREDICTED and states[39] == JointState.MISSING
    for i in (20, 21, 30):
        assert np.linalg.norm(outputs[i].positions[0, 2] - exact[i][2]) < 0.05
        assert outputs[i].views[0, 2] == 0 and 0.0 < outputs[i].scores[0, 2] < 0.8


def test_somebody_lost_for_two_frames_is_filled_and_somebody_gone_is_not_invented():
    _, sets = noisy(30)
    lost = [tracked(i, []) if i in (10, 11) or i > 20 else sets[i] for i in range(30)]
    outputs = run(lost)
    assert [len(o.ids) for o in outputs] == [1] * 21 + [0] * 9
    assert (outputs[10].states == JointState.FILLED).all()


def test_single_outliers_are_bridged():
    exact, sets = noisy(40)
    wrong = sets[25].positions.copy()
    wrong[0, 2] += 0.3
    outputs = run([tracked(i, wrong if i == 25 else s.positions) for i, s in enumerate(sets)])
    assert np.linalg.norm(outputs[25].positions[0, 2] - exact[25][2]) < 0.06


def test_off_means_unchanged_and_at_once():
    _, sets = noisy(3)
    stage = RefinementStage(RefinementConfig(enabled=False), StageContext(Rig(()), MODEL))
    for item in sets:
        (output,) = stage.step(item).outputs
        assert np.array_equal(output.positions, item.positions)
        assert np.array_equal(output.ids, item.ids) and type(output).__name__ == "RefinedPoseSet"


def test_old_stamps_and_other_skeletons():
    _, sets = noisy(3)
    stage = RefinementStage(RefinementConfig(), StageContext(Rig(()), MODEL))
    stage.step(sets[1])
    assert stage.step(sets[0]).notices[0].code == "refinement.old_stamp"
    other = SkeletonModel("other", ("a", "b"), 0, ((0, 1),), 1)
    with pytest.raises(DataError, match="skeleton"):
        RefinementStage(RefinementConfig(), StageContext(Rig(()), other)).step(sets[0])
