"""When instants are due. A late stage leaves out instants until it is not late any more."""

import pytest
from stage_cases import SECOND, cases, chain

from panoptic_ros.graph.build import configure
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.kinematics.body.tracker import RecentInstants
from panoptic_ros.kinematics.people.seen_people import NEAR_NS
from panoptic_ros.kinematics.stage import KinematicsStage
from panoptic_ros.kinematics.timeline import LONGEST_S, InstantSchedule, InstantSelection

MS = 1_000_000
PERIOD, CAMERA = SECOND // 60, SECOND // 30


@pytest.mark.parametrize(("period_ms", "late_ms"), [(16, 30), (16, 5)])
def test_instants_wait_for_views_that_take_a_while(period_ms, late_ms):
    """Views go through association and tracking before they come; samples of IMUs come at once."""
    timeline, newest_view, found = InstantSchedule(60.0), -1, []
    for now in range(1000, 3000):
        if now % 16 == 0:
            assert timeline.came("imu", now * MS) == ""
        if now >= 1000 + late_ms and (now - late_ms) % period_ms == 0:
            newest_view = (now - late_ms) * MS
            assert timeline.came(0, newest_view) == ""
        while (stamp := timeline.due()) is not None:
            found.append((stamp, newest_view))
    settled = [row for row in found if row[0] > 1500 * MS]
    assert len(settled) > 80
    assert all(view >= stamp - NEAR_NS for stamp, view in settled)


@pytest.mark.parametrize("capacity", [1.2, 0.8, 0.5, 0.25])
def test_the_wait_settles_whatever_the_machine_can_do(capacity):
    pace, now, waits, strides = InstantSelection(60.0), 0, [], []
    for number in range(1200):
        now = max(now, number * PERIOD)
        pace.waited_ns = now - number * PERIOD
        waits.append(pace.waited_ns)
        strides.append(pace.step())
        now += round(PERIOD / capacity) if strides[-1] else 0
    late = waits[600:]
    assert max(late) <= 0.6 * CAMERA / capacity + 2 * PERIOD / capacity
    solved = [stride for stride in strides if stride]
    assert sum(solved) == pytest.approx(1200, abs=6) and max(solved) <= LONGEST_S * 60
    assert (set(solved) == {1}) == (capacity > 1.0)


def test_those_that_are_the_lag_ago_are_due_once():
    past, given = RecentInstants(), []
    for number, stride in enumerate((1, 1, 1, 2, 4, 1, 1)):
        past.add(number, stride)
        given.append([past.stamp(back) for back in past.due(3)])
    assert given == [[], [], [], [0, 1], [2, 3], [], []]
    assert [past.stamp(back) for back in past.left(3)] == [4, 5, 6]
    assert past.around(0) == 1 and past.around(2) == 5


def test_a_pipeline_tells_it_how_long_records_have_waited(monkeypatch):
    case, told = cases()["kinematics"], []
    monkeypatch.setattr(KinematicsStage, "waited", lambda self, ns: told.append(ns))
    pipeline = Pipeline(configure({"kinematics": {"everybody": True}}), case.context, ["kinematics"])
    pipeline.waited(70_000_000)
    assert told == [70_000_000]


def test_bodies_of_a_late_stage_are_those_of_a_punctual_one_less_often():
    frames = chain(20)
    items = [item for pair in zip(frames["detection_sets"], frames["refinement"]) for item in pair]
    found = {}
    for name, waits in (("punctual", 0), ("late", CAMERA)):
        stage, outputs, left_out = cases()["kinematics"].stage(rate_hz=60.0, lag=0.05), [], 0
        for number, item in enumerate(items):
            stage.waited(waits if 12 < number < 30 else 0)
            result = stage.step(item)
            outputs += result.outputs
            left_out += sum(n.values["left_out"] for n in result.notices if n.code == "kinematics.late")
        found[name] = {body.index: body for body in (*outputs, *stage.flush().outputs)}, left_out
    (punctual, none), (late, left_out) = found["punctual"], found["late"]
    assert none == 0 and left_out == len(punctual) - len(late) > 5
    assert set(late) < set(punctual)
    for index, body in late.items():
        same = punctual[index]
        assert body.stamp_ns == same.stamp_ns and body.ids.tolist() == same.ids.tolist()
        assert abs(body.positions - same.positions).max() < 0.03
