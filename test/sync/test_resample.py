"""People interpolated to the instant of their set."""

import numpy as np
import pytest

SECOND = 10**9


def people(time_s, order=(0, 1)):
    """Two people of two joints each, who walk and are 30 px apart."""
    left = np.array([[20 + 12 * time_s, 10 + 3 * time_s], [22 + 12 * time_s, 40 + 3 * time_s]])
    both = np.stack([left, left + [30.0, 0.0] - [[4 * time_s, 0.0]]])
    return both[list(order)]


def capture(bench, drops=()):
    items = []
    for k in range(90):
        for name, rate, phase in (("a", 30.0, 0.0), ("b", 25.0, 0.013), ("c", 30.0, -0.011)):
            if (name, k) not in drops and k / rate < 2.9:
                t = phase + k / rate
                order = (0, 1) if k % 2 else (1, 0)  # people come in any order
                items.append(bench.view(name, SECOND * (1 + t), k, people(t, order)))
    return sorted(items, key=lambda v: v.stamp_ns)


def run(bench, items, **parameters):
    sync = bench.stage(resampling="interpolate", **parameters)
    return [s for item in items for s in sync.step(item).outputs] + list(sync.flush().outputs)


def test_people_are_where_they_are_at_the_instant(bench):
    sets = run(bench, capture(bench))
    worst = 0.0
    for s in sets[2:-2]:
        truth = people((s.stamp_ns - SECOND) / SECOND)
        for view in s.views:
            assert view.stamp_ns == s.stamp_ns and view.maps is None
            gaps = np.abs(view.points[:, None] - truth[None]).max((2, 3))
            worst = max(worst, gaps.min(1).max())
            assert sorted(gaps.argmin(1).tolist()) == [0, 1]
            assert view.scores == pytest.approx(0.8, abs=1e-9)
    assert worst < 1e-6
    assert np.mean([len(s.views) for s in sets]) > 2.7


def test_a_joint_without_a_neighbour_stays_and_loses_of_its_score(bench):
    items = capture(bench, drops={("b", k) for k in range(20, 23)})
    late = 0
    for s in run(bench, items):
        for view in s.views:
            if view.camera == "b" and view.scores.min() < 0.79:
                late += 1
                assert view.scores.min() > 0.05 and view.stamp_ns == s.stamp_ns
    assert 1 <= late <= 4


def test_sets_wait_one_frame_and_no_longer(bench):
    sync = bench.stage(resampling="interpolate")
    for item in capture(bench):
        for s in sync.step(item).outputs:
            if s.index > 5:
                assert item.stamp_ns - s.stamp_ns <= 0.041 * SECOND


def test_joints_that_jump_and_people_who_appear_are_not_mixed(bench):
    views = []
    for k in range(8):
        points = people(0.0)
        if k >= 4:
            points[0, 1, 0] += 25.0  # almost the person's size
        for c, phase in (("a", 0.0), ("b", 0.01), ("c", 0.01)):
            views.append(bench.view(c, SECOND * (1 + phase + k / 30), k, points))
    for s in run(bench, views):
        for view in s.views:
            leap = view.points[0, 1, 0] - people(0.0)[0, 1, 0]
            assert min(abs(leap), abs(leap - 25.0)) < 1e-9
