"""People at instants of a fixed rate, from views that are taken one by one."""

from dataclasses import replace
from itertools import pairwise

import captures
import numpy as np
import pytest
from free_cameras import START_NS, CaptureWithBystander, FreeCapture

from panoptic_ros.domain import ClockModel, JointState, Rig
from panoptic_ros.errors import ConfigError, DataError
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.stage import (
    IdleWorkStage,
    LastingStateStage,
    LatenessAwareStage,
    RequestStage,
    StageContext,
)

SECOND = 1_000_000_000
CAPTURE = FreeCapture(seconds=2.5)


def views_of(capture):
    return [item.views[0] for item in capture.sets]


VIEWS = views_of(CAPTURE)


def new(context=CAPTURE.context, **values):
    config = configure({"continuous": {"active": True, **values}})["continuous"]
    return make_stage("continuous", config, context)


def play(stage, items):
    """Sets and notices."""
    results = []
    for item in items:
        results.append(stage.step(item))
        stage.settle()
    results.append(stage.flush())
    return [o for r in results for o in r.outputs], [n for r in results for n in r.notices]


def error(sets, capture=CAPTURE):
    """Mean error, mm, and the number of people per set."""
    gaps = []
    for item in sets:
        truth = capture.joints(1e-9 * (item.stamp_ns - START_NS))
        gaps += [np.nanmean(np.linalg.norm(truth - body, axis=-1), axis=1).min() for body in item.positions]
    return 1e3 * np.mean(gaps), [len(item.ids) for item in sets]


def same(one, other):
    return (
        one.stamp_ns == other.stamp_ns
        and one.ids.tolist() == other.ids.tolist()
        and all(
            np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True)
            for name in ("positions", "covariances", "scores", "views", "states")
        )
    )


@pytest.fixture(scope="module")
def plain():
    return play(new(), VIEWS)


def test_it_does_what_live_nodes_ask_of_stages():
    for protocol in (IdleWorkStage, RequestStage, LatenessAwareStage, LastingStateStage):
        assert isinstance(new(), protocol)


def test_instants_are_those_of_the_rate_and_people_are_right(plain):
    sets, notices = plain
    assert [item.stamp_ns for item in sets] == [START_NS + k * SECOND // 50 for k in range(1, len(sets) + 1)]
    assert [item.index for item in sets] == list(range(len(sets)))
    mean, counts = error(sets[10:-10])
    assert mean < 2.5 and set(counts) == {2} and notices == []
    assert {tuple(item.ids.tolist()) for item in sets} == {(0, 1)}
    assert all((item.states == JointState.MEASURED).all() and item.views.min() >= 2 for item in sets)


@pytest.mark.parametrize(("lag", "rate_hz"), [(0.0, 50.0), (0.1, 29.97), (0.5, 10.0)])
def test_an_instant_is_given_with_the_first_view_newer_than_the_lag(lag, rate_hz):
    stage, newest = new(lag=lag, rate_hz=rate_hz), 0
    assert not any(stage.step(view).outputs for view in VIEWS[:11])  # until all cameras have two views
    for view in VIEWS[11:]:
        for item in stage.step(view).outputs:
            if view is VIEWS[11]:
                continue
            assert newest <= item.stamp_ns + round(lag * SECOND) < view.stamp_ns
            assert item.newest_ns <= item.stamp_ns + round(lag * SECOND)
        newest = view.stamp_ns


def test_later_views_and_the_order_of_arrival_do_not_matter(plain):
    sets, _ = plain
    for count in (60, 91):
        stage = new()
        early = [item for view in VIEWS[:count] for item in stage.step(view).outputs]
        assert early and all(map(same, early, sets))
    order = []  # views up to the same instant plus lag, in any order
    rng = np.random.default_rng(1)
    slots = {}
    for view in VIEWS:
        slots.setdefault(-(-view.stamp_ns * 50 // SECOND), []).append(view)
    for slot in slots.values():
        order += [slot[k] for k in rng.permutation(len(slot))]
    assert order != VIEWS
    assert all(map(same, play(new(), order)[0], sets))


def test_a_wait_allows_for_disorder(plain):
    moved = list(VIEWS)
    for k in range(20, 100, 10):
        moved[k : k + 3] = moved[k + 1], moved[k + 2], moved[k]  # 33 ms late
    sets, notices = play(new(wait_s=0.05), moved)
    assert all(map(same, sets, plain[0])) and notices == []
    _, notices = play(new(), moved)
    assert {n.code for n in notices} <= {"continuous.late_views"}


def test_clock_models_are_applied():
    offsets = np.array([0.0, 0.06, -0.05, 0.03, -0.06, 0.02])
    capture = FreeCapture(seconds=2.5, offsets=offsets)
    models = [
        ClockModel(name, START_NS, round(SECOND * offset), 0.0, np.diag([1e-8, 1e-12]))
        for name, offset in zip(capture.rig.names, offsets)
    ]
    sets, notices = play(new(), [*models, *views_of(capture)])
    mean, counts = error(sets[10:-10], capture)
    assert mean < 2.5 and set(counts) == {2} and notices == []
    wrong, _ = play(new(), views_of(capture))
    assert error(wrong[10:-10], capture)[0] > 2.0 * mean


def test_rolling_shutters_of_the_rig_are_taken_into_account():
    lines = np.array([30e-6, 0.0, 25e-6, 0.0, 20e-6, 30e-6])
    capture = FreeCapture(seconds=2.5, lines=lines, speed=2.0)
    cameras = (replace(c, line_delay_us=1e6 * line) for c, line in zip(capture.rig.cameras, lines))
    context = StageContext(Rig(tuple(cameras)), captures.SKELETON)
    mean, _ = error(play(new(context), views_of(capture))[0][10:-10], capture)
    wrong, _ = error(play(new(capture.context), views_of(capture))[0][10:-10], capture)
    assert mean < 3.5 and wrong > 1.5 * mean


def test_nobody_is_reported_half_a_second_after_the_last_view_and_a_pause_gives_no_sets():
    away = [v for v in VIEWS if not START_NS + 1.2e9 < v.stamp_ns < START_NS + 2.2e9]
    sets, _ = play(new(), away)
    last = max(item.stamp_ns for item in sets if len(item.ids) and item.stamp_ns < START_NS + 2.2e9)
    assert START_NS + 1.6e9 < last < START_NS + 1.71e9
    states = next(item.states for item in sets if item.stamp_ns == last)
    assert set(states.ravel().tolist()) <= {JointState.PREDICTED, JointState.MISSING}
    later = [replace(view, stamp_ns=view.stamp_ns + 60 * SECOND) for view in VIEWS]
    sets, notices = play(new(), [*VIEWS, *later])
    assert len(sets) < 300 and notices == []
    assert all(a.stamp_ns < b.stamp_ns for a, b in pairwise(sets))


def test_times_go_on_when_all_clocks_are_set_back():
    back = [replace(view, stamp_ns=view.stamp_ns - 7 * SECOND) for view in VIEWS]
    sets, _ = play(new(), [*VIEWS, *back])
    assert all(a.stamp_ns < b.stamp_ns for a, b in pairwise(sets))
    assert len(sets) == pytest.approx(250, abs=10) and [len(item.ids) for item in sets[-40:]] == [2] * 40
    assert {number for item in sets for number in item.ids.tolist()} <= {0, 1, 2, 3}


def test_joints_that_are_hidden_for_long_are_missing():
    wrist = captures.SKELETON.joint_names.index("lWrist")

    def hide(view):
        scores, points = view.scores.copy(), view.points.copy()
        scores[:, wrist], points[:, wrist] = 0.0, np.nan
        return replace(view, scores=scores, points=points)

    sets, _ = play(new(), [v if v.stamp_ns < START_NS + SECOND else hide(v) for v in VIEWS])
    end = sets[-10]
    assert np.isnan(end.positions[:, wrist]).all() and (end.states[:, wrist] == JointState.MISSING).all()
    assert (end.scores[:, wrist] == 0.0).all() and np.isfinite(np.delete(end.positions, wrist, 1)).all()


@pytest.mark.parametrize(("shift_s", "code"), [(1.0, "ahead"), (-1.0, "late"), (30.0, "ahead")])
def test_a_camera_with_a_wrong_clock_is_left_out_and_named(shift_s, code):
    moved = [
        replace(v, stamp_ns=v.stamp_ns + round(shift_s * SECOND)) if v.camera == "cam2" else v for v in VIEWS
    ]
    sets, notices = play(new(), moved)
    inside = [item for item in sets if item.stamp_ns > START_NS + SECOND // 5][:-10]
    mean, counts = error(inside)
    assert mean < 2.7 and set(counts) == {2}
    assert {(n.code, n.values["camera"]) for n in notices} == {(f"continuous.{code}_views", "cam2")}


def test_a_few_wild_stamps_do_no_harm(plain):
    rng = np.random.default_rng(3)
    wild = [
        replace(v, stamp_ns=v.stamp_ns + int(rng.choice([-9, 4]) * SECOND)) if k % 40 == 39 else v
        for k, v in enumerate(VIEWS)
    ]
    sets, _ = play(new(), wild)
    inside = [item for item in sets if item.stamp_ns > START_NS + SECOND // 5][:-10]
    mean, counts = error(inside)
    assert mean < 2.7 and set(counts) == {2}


def test_cameras_that_stop_or_start_late_do_no_harm():
    middle = START_NS + 5 * SECOND // 4
    for kept in (lambda v: v.stamp_ns < middle, lambda v: v.stamp_ns > middle):
        sets, notices = play(new(), [v for v in VIEWS if v.camera not in ("cam1", "cam4") or kept(v)])
        mean, counts = error(sets[10:-10])
        assert mean < 3.0 and set(counts) == {2} and notices == []


def test_when_views_have_waited_instants_are_left_out(plain):
    stage, given, left_out = new(), [], 0
    for view in VIEWS:
        stage.waited(110_000_000)
        result = stage.step(view)
        given += result.outputs
        left_out += sum(notice.values["left_out"] for notice in result.notices)
    assert left_out == pytest.approx(2 * len(given), abs=2)
    assert len(given) == pytest.approx(len(plain[0]) / 3.0, abs=3)
    assert all((item.stamp_ns * 50 // SECOND) % 3 == 0 for item in given)


def test_requested_instants_wait_for_their_views_and_change_nothing(plain):
    stage, given, answers = new(), [], 0
    assert stage.instants().newest_ns < stage.instants().oldest_ns and not stage.has_all_of(START_NS)
    for view in VIEWS:
        given += stage.step(view).outputs
        stage.settle()
        asked = view.stamp_ns - SECOND // 10 - 1_234_567
        assert stage.has_all_of(asked) == (view.stamp_ns > asked + SECOND // 10) or answers == 0
        if stage.has_all_of(asked) and asked in stage.instants():
            found = stage.at(asked)
            assert found.stamp_ns == asked and error([found])[0] < 8.0 and len(found.ids) == 2
            answers += 1
        assert not stage.has_all_of(view.stamp_ns)
    assert answers > 100
    given += stage.flush().outputs
    assert all(map(same, given, plain[0]))


def test_requests_are_answered_before_other_output(plain, monkeypatch):
    """Answers and the other output are the same as for requests after the step."""
    stage, late, given, early, order = new(), new(), [], {}, []
    regular = stage._people_at

    def people_at(index, stamp_ns):
        order.append(stamp_ns)
        return regular(index, stamp_ns)

    def look():
        if waiting and stage.has_all_of(waiting[0]) and waiting[0] in stage.instants():
            stamp = waiting.pop()
            early[stamp] = stage.at(stamp)

    monkeypatch.setattr(stage, "_people_at", people_at)
    stage.before_output(look)
    first = 0
    for view in VIEWS:
        asked = view.stamp_ns - SECOND // 10 - 1_234_567
        waiting = [asked]
        order.clear()
        given += stage.step(view).outputs
        first += bool(asked in early and order[0] == asked and len(order) > 1)
        late.step(view)
        if asked in early:
            assert late.has_all_of(asked) and same(late.at(asked), early[asked])
    given += stage.flush().outputs
    assert all(map(same, given, plain[0])) and len(given) == len(plain[0])
    assert first > 50


def test_the_range_of_requests_is_that_of_the_kept_views():
    stage = new()
    for view in VIEWS:
        stage.step(view)
    instants = stage.instants()
    assert 1.2 < 1e-9 * (instants.newest_ns - instants.oldest_ns) < 1.6
    assert len(stage.at(instants.oldest_ns).ids) == 2 == len(stage.at(instants.newest_ns).ids)
    assert instants.newest_ns in instants and instants.newest_ns + 1 not in instants


def test_memory_is_bounded_and_little_lasts():
    stage, sizes = new(), []
    for k in range(3):
        for view in VIEWS:
            stage.step(replace(view, stamp_ns=view.stamp_ns + k * 5 * SECOND // 2))
            stage.settle()
        sizes.append(len(stage.state()))
    assert sizes[2] < 1.1 * sizes[1] and len(stage.lasting_state()) < 0.05 * sizes[1]
    other = new()
    other.begin(stage.lasting_state())
    later = [replace(view, stamp_ns=view.stamp_ns + 60 * SECOND) for view in VIEWS]
    sets, _ = play(other, later)
    assert min(number for item in sets for number in item.ids.tolist()) > 1  # no id is used twice


def test_forget_keeps_the_ids():
    stage = new()
    for view in VIEWS:
        stage.step(view)
    stage.forget()
    later = [replace(view, stamp_ns=view.stamp_ns + 60 * SECOND) for view in VIEWS]
    ids = {tuple(item.ids.tolist()) for item in play(stage, later)[0]} - {()}
    assert ids == {(2, 3)}


def test_faults_of_input_and_configuration_are_named():
    stage = new()
    with pytest.raises(DataError, match="a view of camera 'x', which the rig lacks"):
        stage.step(replace(VIEWS[0], camera="x"))
    with pytest.raises(DataError, match="camera cam. sends skeleton other"):
        stage.step(replace(VIEWS[0], skeleton_hash="other"))
    one = StageContext(Rig(CAPTURE.rig.cameras[:1]), captures.SKELETON)
    with pytest.raises(ConfigError, match="1 camera is not enough"):
        new(one)
    assert new(one, active=False).step(VIEWS[0]).outputs == ()
    with pytest.raises(ConfigError, match="lag = 1.5 is above 1.0 s"):
        new(lag=1.5)


def test_people_where_only_two_cameras_look_are_left_out_unless_asked_for():
    views = views_of(CaptureWithBystander(cameras=5, rate=15.0, seconds=1.5))
    for needed, people in ((3, 1), (2, 2)):
        stage = make_stage(
            "continuous",
            configure({"continuous": {"active": True}, "assembly": {"capture_views": needed}})["continuous"],
            CaptureWithBystander(cameras=5, seconds=0.1).context,
        )
        sets, _ = play(stage, views)
        assert [len(item.ids) for item in sets[-20:-5]] == [people] * 15
