"""Stamps that cannot be right cost the frame that has them and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

SECOND = 10**9
DAY = 86_400 * SECOND
START = 1_795_000_000 * SECOND
RATE = 30.0


def capture(bench, stamps_of, seconds=8):
    """Frames of three triggered cameras; `stamps_of(camera, frame, true_ns)`: with which stamps one comes."""
    return [
        bench.view(c, stamp, k)
        for k in range(int(seconds * RATE))
        for c in "abc"
        for stamp in stamps_of(c, k, START + round(SECOND * k / RATE))
    ]


def grouped(bench, items, live):
    """Frame numbers by camera of every set, the sets' stamps, and how often each notice came."""
    sync = bench.stage(deadline_s=live)
    results = [sync.step(item) for item in items] + [sync.flush()]
    sets = [s for r in results for s in r.outputs]
    codes = [n.code for r in results for n in r.notices]
    assert all(v.stamp_ns >= START for s in sets for v in s.views)
    frames = [{v.camera: v.frame_number for v in s.views} for s in sets]
    assert all(len(set(f.values())) == 1 for f in frames)
    return frames, [s.stamp_ns for s in sets], {code: codes.count(code) for code in codes}


@pytest.mark.parametrize("live", [0.0, 0.5])
@pytest.mark.parametrize("when", [0, 1, 2, 100, 238, 239])
@pytest.mark.parametrize("stamp", [0, START + 20 * SECOND, START + DAY, (2**31 - 1) * SECOND])
@pytest.mark.parametrize("count", [1, 2])
def test_bad_stamps_between_good_ones_are_dropped_and_counted(bench, live, when, stamp, count):
    bad = [stamp + i for i in range(count)]
    items = capture(bench, lambda c, k, t: [*bad, t] if c == "b" and k == when else [t])
    frames, _, codes = grouped(bench, items, live)
    assert len(frames) == 240 and sum(len(f) for f in frames) >= 720 - (2 if when < 3 else 0)
    assert count <= codes.pop("sync.stray_stamp") <= count + 2 and not codes


@pytest.mark.parametrize("live", [0.0, 0.5])
@pytest.mark.parametrize("stamp", [0, START + DAY])
def test_a_stamp_that_stands_still_far_away_is_dropped_until_it_is_right_again(bench, live, stamp):
    items = capture(bench, lambda c, k, t: [stamp] if c == "b" and 60 <= k < 120 else [t])
    frames, _, codes = grouped(bench, items, live)
    assert len(frames) == 240 and sum("b" in f for f in frames) == 180
    if live:
        assert codes == {
            "sync.clock_off": 1,
            "sync.out_of_time": 60,
            "sync.clock_agrees": 1,
            "sync.camera_silent": 1,
            "sync.camera_back": 1,
        }
    else:
        assert codes == {"sync.stray_stamp": 60}


@pytest.mark.parametrize("live", [0.0, 0.5])
@pytest.mark.parametrize("step", [3600 * SECOND, DAY])
def test_a_pause_of_all_cameras_costs_no_frame(bench, live, step):
    items = capture(bench, lambda c, k, t: [t + step * (k >= 100)])
    frames, stamps, codes = grouped(bench, items, live)
    assert [f["a"] for f in frames] == list(range(240)) and not codes
    assert sum(len(f) for f in frames) == 720 and np.diff(stamps).max() > 0.99 * step


@pytest.mark.parametrize("live", [0.0, 0.5])
def test_all_clocks_a_day_ahead_and_right_again(bench, live):
    """Told as a clock that was set back; master time runs on."""
    items = capture(bench, lambda c, k, t: [t + DAY * (60 <= k < 120)])
    frames, stamps, codes = grouped(bench, items, live)
    assert len(frames) >= 238 and sum(len(f) for f in frames) >= 715
    assert codes["sync.clock_set_back"] == 1 and (np.diff(stamps) > 0).all()


@pytest.mark.parametrize("period_s", [0.01, 1.0, 5.0, 100.0])
def test_cameras_of_any_rate_lose_nothing(bench, period_s):
    items = [bench.view(c, START + round(k * period_s * SECOND), k) for k in range(7) for c in "abc"]
    frames, _, codes = grouped(bench, items, 0.0)
    assert len(frames) == 7 and all(len(f) == 3 for f in frames) and not codes


@pytest.mark.parametrize("count", [1, 2])
def test_the_only_frames_of_a_camera_are_given_at_the_end(bench, count):
    items = [bench.view(c, START + k * SECOND // 30, k) for k in range(count) for c in "abc"]
    frames, _, codes = grouped(bench, items, 0.0)
    assert len(frames) == count and all(len(f) == 3 for f in frames) and not codes
