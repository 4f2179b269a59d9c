"""Sync: sets on the master time line, independent of the order of arrival."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.domain import ClockModel, EndOfStream, ViewDetections
from panoptic_ros.errors import ConfigError, DataError

SECOND = 10**9
T = 100


def frames(bench, cameras="abc", count=5, lost=()):
    """Triggered frames at 100, 200, ..., in the order of time."""
    return [
        bench.view(c, T * (1 + k), k)
        for k, c in itertools.product(range(count), cameras)
        if (c, k) not in lost
    ]


def stream(bench, name, rate, phase_s=0.0, seconds=10.0, jitter=0.0, drift=0.0, lost=0.0, seed=0):
    rng = np.random.default_rng(seed)
    result = []
    for k in range(int(seconds * rate)):
        stamp = SECOND * (1.0 + phase_s + k / rate * (1 + drift) + jitter * rng.standard_normal())
        if rng.random() >= lost:
            result.append(bench.view(name, stamp, k))
    return result


def in_time(*streams):
    return sorted((v for s in streams for v in s), key=lambda v: v.stamp_ns)


def test_a_set_is_given_with_its_last_frame_in_the_order_of_the_rig(bench):
    sync = bench.stage()
    for item in frames(bench, count=4):
        sync.step(item)
    assert not sync.step(bench.view("c", 503)).outputs
    assert not sync.step(bench.view("a", 500)).outputs
    (result,) = sync.step(bench.view("b", 505)).outputs
    assert [v.camera for v in result.views] == ["a", "b", "c"]
    assert (result.index, result.stamp_ns) == (4, 503)


def test_lost_frames_leave_their_camera_absent_and_the_master_no_gap(bench):
    lost = {("b", 1), ("a", 2), ("a", 3)}
    sets, codes = bench.run(bench.stage(), frames(bench, count=8, lost=lost))
    assert [s[1] for s in sets] == [T * (1 + k) for k in range(8)]
    for k, s in enumerate(sets):
        assert {c for c, _ in s[2]} == {c for c in "abc" if (c, k) not in lost}
    assert codes == []


def test_sets_begin_when_all_cameras_have_shown_their_rates(bench):
    sync = bench.stage()
    given = [len(sync.step(item).outputs) for item in frames(bench, count=5)]
    assert given == [0] * 11 + [4, 0, 0, 1]


def test_end_of_a_camera_lets_the_others_go_on(bench):
    sync = bench.stage()
    for item in frames(bench, "ab", 4):
        sync.step(item)
    results = sync.step(EndOfStream("c")).outputs
    assert [[v.camera for v in s.views] for s in results] == [["a", "b"]] * 4


def test_deadline_gives_what_is_there_and_counts_late_frames(bench):
    sync = bench.stage(deadline_s=150e-9)
    given = [s for item in frames(bench, "ab", 7) for s in sync.step(item).outputs]
    assert [[v.camera for v in s.views] for s in given] == [["a", "b"]] * 7
    late = [sync.step(item) for item in frames(bench, "c", 7)]  # four come within the deadline
    codes = [n.code for r in late for n in r.notices]
    assert codes == [*["sync.late_frame"] * 3, "sync.camera_back", *["sync.late_frame"] * 4]


def test_stamp_that_stands_still_is_dropped_and_reported(bench):
    sync = bench.stage()
    for stamp in (0, 50, 100):
        sync.step(bench.view("a", stamp))
    assert [n.code for n in sync.step(bench.view("a", 100)).notices] == ["sync.stamp_back"]


def test_queue_is_bounded(bench):
    sync = bench.stage(queue_limit=3)
    codes = [n.code for i in range(6) for n in sync.step(bench.view("a", 100 * i)).notices]
    assert codes == ["sync.queue_full"] * 3


def test_few_views_are_dropped_and_counted(bench):
    lost = {("b", 0), ("c", 0)}
    sets, codes = bench.run(bench.stage(minimum_views=2), frames(bench, lost=lost))
    assert len(sets) == 4 and sets[0][0] == 0 and codes == ["sync.few_views"]


def test_bad_input_is_refused_without_a_trace(bench):
    sync = bench.stage()
    with pytest.raises(DataError, match="'x'"):
        sync.step(bench.view("x", 1))
    bad = ViewDetections("a", 1, 0, (9, 9), "00000000", np.zeros((0, 2, 2)), np.zeros((0, 2)), np.zeros(0))
    with pytest.raises(DataError, match="00000000"):
        sync.step(bad)
    assert sync.flush().outputs == ()
    with pytest.raises(ConfigError, match="'x' is not a camera"):
        bench.stage(master="x")
    with pytest.raises(ConfigError, match="delays_ms"):
        bench.stage(delays_ms=("a",))


@settings(max_examples=60, deadline=None)
@given(
    jitter=st.lists(st.integers(0, 9), min_size=15, max_size=15),
    lost=st.sets(st.integers(0, 14), max_size=6),
    order=st.permutations(range(15)),
    resampling=st.sampled_from(["nearest", "interpolate"]),
)
def test_arrival_order_between_cameras_does_not_matter(jitter, lost, order, resampling):
    from_conftest = globals()["_bench"]
    items = [
        from_conftest.view(c, T * (1 + i) + jitter[3 * i + k], i)
        for (i, (k, c)) in itertools.product(range(5), enumerate("abc"))
        if 3 * i + k not in lost
    ]
    reference, _ = from_conftest.run(from_conftest.stage(resampling=resampling), items)
    shuffled = sorted(range(len(items)), key=lambda i: order[i])
    per_camera = {c: [v for v in items if v.camera == c] for c in "abc"}
    arrival = [per_camera[items[i].camera].pop(0) for i in shuffled]  # each camera's own order is kept
    assert from_conftest.run(from_conftest.stage(resampling=resampling), arrival)[0] == reference
    assert sum(len(s[2]) for s in reference) == len(items)
    if resampling == "nearest":
        used = [entry for s in reference for entry in s[2]]
        assert len(used) == len(set(used))


@pytest.fixture(autouse=True)
def _for_properties(bench):
    globals()["_bench"] = bench


# ---------------------------------------------------------------------- rates and phases


def test_mixed_rates_with_default_settings(bench):
    """25 and 29.97 fps with drift, jitter and drops: 29.97 sets a second, each frame at most once."""
    streams = [
        stream(bench, "a", 25.0, 0.011, 20, 1e-3, 50e-6, 0.02, 1),
        stream(bench, "b", 30000 / 1001, 0.004, 20, 1e-3, -50e-6, 0.02, 2),
        stream(bench, "c", 25.0, 0.031, 20, 1e-3, 20e-6, 0.02, 3),
    ]
    items = in_time(*streams)
    sets, codes = bench.run(bench.stage(), items)
    used = [entry for s in sets for entry in s[2]]
    assert len(used) == len(set(used)) and len(used) >= 0.99 * len(items)
    stamps = np.array([s[1] for s in sets]) / SECOND
    assert len(sets) == pytest.approx(20 * 29.97, abs=3)
    assert np.diff(stamps).min() > 0.028 and np.diff(stamps).max() < 0.07  # once no camera has a frame
    away = np.array([abs(stamp - s[1]) for s in sets for _, stamp in s[2]]) / SECOND
    assert away.max() < 0.0205
    views = [len(s[2]) for s in sets]
    assert np.mean(views) > 2.55  # 25 / 29.97 of the time there is a frame of each slow camera
    assert set(codes) <= {"sync.surplus_frame"}


def test_unsynchronised_phases_share_one_set_per_period(bench):
    phases = {"a": 0.0, "b": 0.0166, "c": -0.012}
    streams = [stream(bench, c, 30.0, p, 10, 5e-4, seed=k) for k, (c, p) in enumerate(phases.items())]
    sets, codes = bench.run(bench.stage(), in_time(*streams))
    assert codes == [] and len(sets) in (300, 301)
    assert sum(len(s[2]) == 3 for s in sets) >= 298
    for s in sets:
        for camera, stamp in s[2]:
            away = (stamp - s[1]) / SECOND - phases[camera]
            assert min(abs(away), abs(away - 1 / 30), abs(away + 1 / 30)) < 3.5e-3


def test_triggered_cameras_with_late_stamps_and_drops_stay_together(bench):
    rng = np.random.default_rng(8)
    items = []
    for k in range(600):
        for c in "abc":
            late = rng.gamma(2.0, 7e-4) + (rng.random() < 0.05) * rng.uniform(2e-3, 12e-3)
            if rng.random() > 0.03:
                items.append(bench.view(c, SECOND * (1 + k / 30 + late), k))
    sync = bench.stage()
    results = [s for item in items for s in sync.step(item).outputs] + list(sync.flush().outputs)
    mixed = [s for s in results if len({v.frame_number for v in s.views}) > 1]
    assert mixed == [] and len(results) >= 599


def test_a_master_that_stops_for_good_is_carried_by_the_others(bench):
    streams = [stream(bench, c, 30.0, 0.0, 60 if c != "a" else 2) for c in "abc"]
    items = in_time(*streams)
    at = next(k for k, v in enumerate(items) if v.stamp_ns > 3.05 * SECOND)
    sets, codes = bench.run(bench.stage(), [*items[:at], EndOfStream("a"), *items[at:]])
    assert codes == [] and len(sets) == 1800
    assert all(len(s[2]) == 2 for s in sets[60:])
    assert all(len({stamp for _, stamp in s[2]}) == 1 for s in sets)


def test_a_pause_of_all_cameras_and_a_device_that_resumes(bench):
    early = [stream(bench, c, 30.0, 0.0, 2) for c in "abc"]
    late = [stream(bench, c, 30.0, 7.0, 2) for c in "abc"]
    third = [v for v in late[2] if v.stamp_ns > 9 * SECOND]
    told = ["sync.camera_silent", "sync.camera_back", "sync.late_frame"]
    for live, expected, late_frames in ((0.0, [], 0), (0.2, told, 1)):
        sync = bench.stage(deadline_s=live)
        sets, codes = bench.run(sync, in_time(*early, late[0], late[1], third))
        assert codes == expected
        assert [len(s[2]) for s in sets] == [3] * 60 + [2] * (31 + late_frames) + [3] * (29 - late_frames)
        assert all(len({stamp for _, stamp in s[2]}) == 1 for s in sets)


def test_a_chosen_master_and_a_fixed_rate(bench):
    streams = [stream(bench, "a", 60.0, 0.003), stream(bench, "b", 30.0, 0.0), stream(bench, "c", 30.0, 0.0)]
    sets, codes = bench.run(bench.stage(master="b"), in_time(*streams))
    assert len(sets) in (300, 301) and set(codes) == {"sync.surplus_frame"}
    assert all(s[2][0][1] - s[1] in (3_000_000, 3_000_001, 2_999_999) for s in sets[:300])
    sets, _ = bench.run(bench.stage(rate_hz=25.0, phase_s=0.01), in_time(*streams))
    assert [s[1] for s in sets][:3] == [1_010_000_000, 1_050_000_000, 1_090_000_000]
    assert len(sets) in (250, 251)
    sets, _ = bench.run(bench.stage(rate_hz=29.97), in_time(*streams))
    steps = np.diff([s[1] for s in sets])
    assert set(steps.tolist()) <= {33_366_666, 33_366_667, 33_366_668}


def test_frames_outside_of_the_window_are_left_out(bench):
    streams = [stream(bench, "a", 30.0), stream(bench, "b", 30.0, 0.006), stream(bench, "c", 30.0, 0.004)]
    sets, _ = bench.run(bench.stage(window_s=0.005, master="a"), in_time(*streams))
    together = [s for s in sets if len(s[2]) == 2]
    assert len(together) == 300 and all({c for c, _ in s[2]} == {"a", "c"} for s in together)


# ---------------------------------------------------------------------- clocks


def test_clock_models_move_stamps_to_the_master_time_line(bench):
    epoch = 1_700_000_000_000_000_001
    models = [
        ClockModel("a", epoch, -epoch, 0.0, np.zeros((2, 2))),
        ClockModel("b", 0, 7, 0.0, np.zeros((2, 2))),
        ClockModel("somebody else", 0, 1000, 0.0, np.zeros((2, 2))),
    ]
    offsets = {"a": epoch, "b": -7, "c": 0}
    items = [bench.view(v.camera, v.stamp_ns + offsets[v.camera]) for v in frames(bench)]
    sets, codes = bench.run(bench.stage(), [*models, *items])
    assert codes == []
    assert sets == [(k, T * (k + 1), tuple((c, T * (k + 1)) for c in "abc")) for k in range(5)]


def test_delays_of_cameras(bench):
    items = [bench.view(c, 1e7 * (1 + k) - {"a": 2e6, "b": 0, "c": 1e6}[c]) for k in range(5) for c in "abc"]
    sets, _ = bench.run(bench.stage(delays_ms=("a=2", "*=1", "b=0")), items)
    assert [s[1] for s in sets] == [10_000_000 * (1 + k) for k in range(5)]
    assert all(len({stamp for _, stamp in s[2]}) == 1 for s in sets)


def test_cameras_that_need_a_clock_wait_for_it(bench):
    sync = bench.stage(clocks=("*=mic",))
    items = frames(bench)
    for item in items[:9]:
        assert not sync.step(item).outputs
    sync.step(ClockModel("mic", 0, 1000, 0.0, np.zeros((2, 2)), 0.0, 0, 10**9))
    sets = [s for item in items[9:] for s in sync.step(item).outputs] + list(sync.flush().outputs)
    assert [s.stamp_ns for s in sets] == [1100, 1200, 1300, 1400, 1500]
