"""Clocks of cameras that jump: nothing is grouped wrongly, told once, over within two seconds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.domain import ClockModel

SECOND = 10**9
RATE = 30.0


def groups(bench, sync, items):
    """Frame numbers of every set, the sets' stamps, and codes of warnings."""
    results = [sync.step(item) for item in items] + [sync.flush()]
    sets = [s for r in results for s in r.outputs]
    warnings = [n.code for r in results for n in r.notices if n.severity != "info"]
    return [{v.camera: v.frame_number for v in s.views} for s in sets], [s.stamp_ns for s in sets], warnings


def capture(bench, seconds, stamp, cameras="abc"):
    """Triggered frames; `stamp(camera, true_ns)` is what the camera's clock says."""
    return [
        bench.view(c, stamp(c, round(SECOND * (10 + k / RATE))), k)
        for k in range(int(seconds * RATE))
        for c in cameras
    ]


@pytest.mark.parametrize("live", [0.0, 0.3])
@pytest.mark.parametrize("step", [-5.0, -0.5, -3600.0])
def test_a_clock_of_all_cameras_that_is_set_back(bench, live, step):
    start = 7200 * SECOND
    items = capture(bench, 6, lambda c, t: start + t + (round(step * SECOND) if t > 12 * SECOND else 0))
    frames, stamps, warnings = groups(bench, bench.stage(deadline_s=live), items)
    assert all(len(set(f.values())) == 1 for f in frames)
    assert sum(len(f) for f in frames) >= len(items) - 3
    assert (np.diff(stamps) > 0.9 * SECOND / RATE).all() and np.diff(stamps).max() < 2.1 * SECOND / RATE
    assert warnings.count("sync.clock_set_back") == 1


@pytest.mark.parametrize("step", [5.0, -5.0, 3600.0])
def test_a_single_camera_that_jumps_without_a_clock_model_is_left_out_live(bench, step):
    start = 7200 * SECOND
    items = capture(
        bench,
        8,
        lambda c, t: start + t + (round(step * SECOND) if c == "b" and 12 * SECOND < t < 15 * SECOND else 0),
    )
    frames, _, warnings = groups(bench, bench.stage(deadline_s=0.3), items)
    assert all(len(set(f.values())) == 1 for f in frames)
    assert len(frames) == 240
    assert sum("b" in f for f in frames) >= 240 - 95 and frames[-1].keys() == {"a", "b", "c"}
    assert warnings.count("sync.clock_off") == 1


def models_of(offset_of, until_ns, seconds=0.25):
    """Clock models as a clocks stage gives them, a quarter of a second after the fact."""
    return [ClockModel(c, 0, offset_of(c), 0.0, np.zeros((2, 2)), 0.0, 0, until_ns(c)) for c in "abc"]


@pytest.mark.parametrize("live", [0.0, 1.0])
@pytest.mark.parametrize("step", [0.25, -0.4, 7.0, -7.0, -3600.0])
def test_a_camera_whose_clock_jumps_waits_for_its_next_line(bench, live, step):
    """Its frames are held from the odd one on, and given the right time when the model comes."""
    offsets = {"a": 0, "b": 3 * SECOND, "c": -2 * SECOND}
    base = 7200 * SECOND
    jump_at, told_at = 12 * SECOND, 12 * SECOND + 300_000_000
    step_ns = round(step * SECOND) + 9_000_000

    def clock(c, t):
        return base + t - offsets[c] + (step_ns if c == "b" and t > jump_at else 0)

    def after_jump(true_ns):
        model = _model("b", offsets["b"] - step_ns, clock("b", true_ns), 1)
        return replace(model, from_ns=clock("b", jump_at + 1))

    items, next_model, segment = [], 0, 0
    for view in capture(bench, 6, clock):
        true_ns = round(SECOND * (10 + view.frame_number / RATE))
        if true_ns >= next_model:
            next_model = true_ns + SECOND
            items += [_model(c, offsets[c], clock(c, true_ns), 0) for c in "abc" if c != "b" or not segment]
            items += [after_jump(true_ns)] if segment else []
        if true_ns >= told_at and not segment:
            segment = 1
            items.append(after_jump(true_ns))
        items.append(view)
    sync = bench.stage(deadline_s=live, clocks=("a=a", "b=b", "c=c"))
    frames, _, warnings = groups(bench, sync, items)
    assert all(len(set(f.values())) == 1 for f in frames)
    assert len(frames) == 180 and sum("b" in f for f in frames) == 180
    assert warnings == []  # the clocks stage tells


def _model(camera, offset, until, segment):
    return ClockModel(camera, 0, offset, 0.0, np.zeros((2, 2)), 0.0, 0, until, 5e-7, segment)


def test_a_gap_of_a_camera_is_no_jump_once_its_clock_is_heard_again(bench):
    items = []
    for view in capture(bench, 6, lambda c, t: t):
        true_s = view.stamp_ns / SECOND
        if view.camera == "a" and abs(true_s * 4 - round(true_s * 4)) < 1e-3:
            items += [_model(c, 0, view.stamp_ns, 0) for c in "abc"]
        if not (view.camera == "b" and 11.9 < true_s < 13.1):
            items.append(view)
    frames, _, warnings = groups(bench, bench.stage(clocks=("*=a", "b=b", "c=c")), items)
    assert warnings == [] and len(frames) == 180
    assert all(len(set(f.values())) == 1 for f in frames)
    assert sum("b" in f for f in frames) == 180 - 35


def test_a_gap_while_nothing_is_heard_is_trusted_after_two_seconds(bench):
    items = [_model(c, 0, 11 * SECOND, 0) for c in "abc"]
    items += [
        v
        for v in capture(bench, 8, lambda c, t: t)
        if not (v.camera == "b" and 12 * SECOND < v.stamp_ns < 13 * SECOND)
    ]
    frames, _, warnings = groups(bench, bench.stage(clocks=("a=a", "b=b", "c=c")), items)
    assert warnings == ["sync.clock_silent"] * 3  # each is told once
    assert len(frames) == 240 and sum("b" in f for f in frames) == 240 - 29
    assert all(len(set(f.values())) == 1 for f in frames)


@pytest.mark.parametrize("step", [6.0, 86_400.0])
def test_a_clock_that_jumps_while_nothing_is_heard_hurts_no_other_camera(bench, step):
    """Its frames are held, and come all at once: that is not a pause of all cameras."""
    step_ns = round(step * SECOND)
    items = [_model(c, 0, 11 * SECOND, 0) for c in "abc"]
    items += capture(bench, 8, lambda c, t: t + (step_ns if c == "b" and t > 12 * SECOND else 0))
    heard = _model("b", -step_ns, 16 * SECOND + step_ns, 1)
    items.insert(3 + 3 * 190, replace(heard, from_ns=15 * SECOND + step_ns))
    sync = bench.stage(clocks=("a=a", "b=b", "c=c"), deadline_s=0.5)
    frames, _, warnings = groups(bench, sync, items)
    assert len(frames) == 240 and all(len(set(f.values())) == 1 for f in frames)
    assert warnings.count("sync.clock_off") == 1 and "sync.late_frame" not in warnings
    assert all({"a", "c"} <= f.keys() for f in frames) and "b" in frames[-1]


@pytest.mark.parametrize("step", [0.033, -0.3, -5.0, 3600.0])
def test_frames_before_a_jump_that_nobody_knew_of_are_left_out(bench, step):
    """The clock jumps before its first model: what is known of it holds from there on."""
    step_ns, jump = round(step * SECOND), 10 * SECOND + 410_000_000
    start = 7200 * SECOND
    items = capture(bench, 4, lambda c, t: start + t + (step_ns if c == "b" and t > jump else 0))
    first = replace(_model("b", -step_ns, start + jump + step_ns + SECOND, 1), from_ns=start + jump + step_ns)
    items.insert(3 * 45, first)
    frames, _, warnings = groups(bench, bench.stage(clocks=("b=b",)), items)
    assert all(len(set(f.values())) == 1 for f in frames) and len(frames) == 120
    assert sum("b" in f for f in frames) == 120 - 13 and warnings == ["sync.no_clock"] * 13


def test_a_swap_of_two_cameras(bench):
    """Names swap with the clocks: both are held until their new lines are known."""
    offsets = {"a": 0, "b": 500 * SECOND, "c": -20 * SECOND}
    swapped = {"a": "b", "b": "a", "c": "c"}
    base = 7200 * SECOND
    items, told = [], False
    for k in range(180):
        true_ns = base + round(SECOND * k / RATE)
        after = k >= 60
        if k % 30 == 0 and not after:
            items += [_model(c, -offsets[c], true_ns + offsets[c], 0) for c in "abc"]
        if k >= 70 and not told:
            told = True
            for c in "ab":
                own = offsets[swapped[c]]
                model = _model(c, -own, true_ns + own, 1)
                items.append(replace(model, from_ns=base + 2 * SECOND + own))
        for c in "abc":
            items.append(bench.view(c, true_ns + offsets[swapped[c] if after else c], k))
    frames, _, warnings = groups(bench, bench.stage(clocks=("a=a", "b=b", "c=c")), items)
    assert all(len(set(f.values())) == 1 for f in frames) and sum(len(f) for f in frames) == 540
    assert warnings == ["sync.clock_silent"] * 3  # that they are not heard any more


def test_a_model_that_cannot_be_right_costs_frames_and_nothing_else(bench):
    items = [_model("b", -7200 * SECOND, 10 * SECOND, 0)]
    items += capture(bench, 3, lambda c, t: t)
    items.insert(1 + 3 * 45, _model("b", 0, 12 * SECOND, 1))
    sync = bench.stage(clocks=("b=b",), deadline_s=0.5)
    frames, _, warnings = groups(bench, sync, items)
    assert set(warnings) == {"sync.no_clock", "sync.camera_silent"} and len(frames) == 90
    assert all(len(set(f.values())) == 1 for f in frames) and sum("b" in f for f in frames) >= 40


@pytest.mark.parametrize("live", [0.0, 0.3])
def test_a_clock_set_back_just_after_a_camera_has_ended(bench, live):
    start = 7200 * SECOND
    items = capture(bench, 8, lambda c, t: start + t - (5 * SECOND if t > 12 * SECOND else 0))
    items = [v for v in items if v.camera != "c" or v.frame_number < 58]
    frames, stamps, warnings = groups(bench, bench.stage(deadline_s=live), items)
    assert "sync.clock_set_back" in warnings and all(len(set(f.values())) == 1 for f in frames)
    assert len(frames) >= 230 and (np.diff(stamps) > 0).all()


def test_a_camera_whose_clock_jumped_does_not_rule_when_the_others_have_ended(bench):
    start = 7200 * SECOND
    items = capture(bench, 8, lambda c, t: start + t + (50 * SECOND if c == "b" and t > 12 * SECOND else 0))
    items = [v for v in items if v.camera == "b" or v.frame_number < 120]
    frames, stamps, warnings = groups(bench, bench.stage(deadline_s=0.3), items)
    assert all(len(set(f.values())) == 1 for f in frames)
    assert len(frames) == 120 and max(stamps) < start + 15 * SECOND
    assert "sync.clock_off" in warnings


@settings(max_examples=40, deadline=None)
@given(
    steps=st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 150), st.floats(-20, 20)), max_size=6),
    live=st.sampled_from([0.0, 0.2]),
    clocks=st.booleans(),
    resampling=st.sampled_from(["nearest", "interpolate"]),
)
def test_whatever_clocks_do_frames_are_used_once_and_sets_never_go_back(steps, live, clocks, resampling):
    own = globals()["_bench"]

    def clock(c, t):
        jumps = [s for name, k, s in steps if name == c and t > (10 + k / RATE) * SECOND]
        return 7200 * SECOND + t + round(SECOND * sum(jumps))

    items = capture(own, 6, clock)
    if clocks:
        items = [_model(c, 0, 7300 * SECOND, 0) for c in "abc"] + items
    sync = own.stage(deadline_s=live, resampling=resampling)
    results = [sync.step(item) for item in items] + [sync.flush()]
    sets = [s for r in results for s in r.outputs]
    assert (np.diff([s.stamp_ns for s in sets]) > 0).all()
    assert [s.index for s in sets] == list(range(len(sets)))
    used = [(v.camera, v.frame_number) for s in sets for v in s.views]
    assert len(used) == len(set(used))


@pytest.fixture(autouse=True)
def _for_properties(bench):
    globals()["_bench"] = bench
