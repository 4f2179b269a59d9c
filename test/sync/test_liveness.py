"""Live: cameras that die and come back, and stamps of one camera that must not cost the others anything."""

import pytest

SECOND = 10**9


def arrivals(bench, cameras, count, rates=None, start=0):
    """Frames of cameras at their rates, in the order of time."""
    rows = [
        bench.view(c, SECOND + round((start + k) * SECOND / rate), start + k)
        for c in cameras
        for rate in [(rates or {}).get(c, 30.0)]
        for k in range(round(count * rate / 30.0))
    ]
    return sorted(rows, key=lambda view: view.stamp_ns)


def latest(sync, items):
    """For each set: its cameras, and how much later than the set the frame was taken that completed it."""
    return [
        ("".join(v.camera for v in s.views), (item.stamp_ns - s.stamp_ns) / SECOND)
        for item in items
        for s in sync.step(item).outputs
    ]


def test_a_dead_camera_is_named_and_costs_nothing_after_three_periods(bench):
    sync = bench.stage(deadline_s=0.5)
    assert [who for who, _ in latest(sync, arrivals(bench, "abc", 60))] == ["abc"] * 60
    steps = [(item, sync.step(item)) for item in arrivals(bench, "ab", 60, start=60)]
    ((when, notice),) = [(item, note) for item, result in steps for note in result.notices]
    assert notice.code == "sync.camera_silent" and notice.severity == "warning"
    assert "camera c" in notice.text and notice.values == {"camera": "c"}
    named_after_s = (when.stamp_ns - SECOND) / SECOND - 60 / 30
    assert named_after_s < 0.25
    waits = [(item.stamp_ns - s.stamp_ns) / SECOND for item, r in steps for s in r.outputs]
    assert max(waits) < 0.25 and max(waits[8:]) < 1e-6


def test_its_return_is_told_and_costs_the_others_nothing(bench):
    sync = bench.stage(deadline_s=0.5)
    latest(sync, [*arrivals(bench, "abc", 60), *arrivals(bench, "ab", 30, start=60)])
    steps = [(item, sync.step(item)) for item in arrivals(bench, "abc", 60, start=90)]
    assert [n.code for _, r in steps for n in r.notices] == ["sync.camera_back", "sync.late_frame"]
    sets = [s for _, r in steps for s in r.outputs]
    assert len(sets) == 60 and all(len(s.views) == 3 for s in sets[1:])


def test_a_burst_of_old_frames_on_return_is_left_out(bench):
    sync = bench.stage(deadline_s=0.5)
    latest(sync, [*arrivals(bench, "abc", 60), *arrivals(bench, "ab", 30, start=60)])
    burst = [sync.step(view) for view in arrivals(bench, "c", 30, start=60)]
    assert sum(len(r.outputs) for r in burst) <= 1
    assert {n.code for r in burst for n in r.notices} == {"sync.camera_back", "sync.late_frame"}
    assert [who for who, _ in latest(sync, arrivals(bench, "abc", 30, start=90))][1:] == ["abc"] * 29


def test_slow_cameras_are_not_silent_between_their_frames(bench):
    sync = bench.stage(deadline_s=1.0)
    steps = [sync.step(item) for item in arrivals(bench, "abc", 300, {"c": 5.0})]
    assert not [n for r in steps for n in r.notices if n.code.startswith("sync.camera")]


def test_a_camera_that_never_came_is_named(bench):
    sync = bench.stage(deadline_s=0.5)
    steps = [sync.step(item) for item in arrivals(bench, "ab", 60)]
    assert [n.text for r in steps for n in r.notices] == [
        "camera c has sent no usable frame yet: sets do not wait for it"
    ]
    assert sum(len(r.outputs) for r in steps) == 60


@pytest.mark.parametrize("old_s", [1.0, 3.0])
@pytest.mark.parametrize("among", [1, 5])
def test_frames_that_nobody_can_use_keep_nobody_waiting(bench, old_s, among):
    """A publisher repeats old frames of a camera; one of so many of its own gets through among them."""
    sync, waits = bench.stage(deadline_s=0.5), []
    for k, items in enumerate(zip(*(arrivals(bench, c, 450) for c in "abc"), strict=True)):
        copies = [
            bench.view("b", items[0].stamp_ns - old_s * SECOND + (i + k) % 8 * SECOND / 30)
            for i in range(12 if 150 <= k < 300 else 0)
        ]
        good = [v for v in items if v.camera != "b" or not copies or k % among == 0]
        waits += [waited for _, waited in latest(sync, [*good, *copies])]
    assert len(waits) == 450 and max(waits) < 0.11


@pytest.mark.parametrize("ahead_s", [0.1, 0.6, 0.99, 1.9])
@pytest.mark.parametrize("count", [1, 2])
def test_wrong_stamps_of_one_camera_cost_the_others_no_set(bench, ahead_s, count):
    sync = bench.stage(deadline_s=0.5)
    items = arrivals(bench, "abc", 150)
    at = next(k for k, view in enumerate(items) if view.frame_number == 60)
    stamp = items[at].stamp_ns + round(ahead_s * SECOND)
    wrong = [bench.view("a", stamp + k, 1000 + k) for k in range(count)]
    sets = latest(sync, [*items[:at], *wrong, *items[at:]])
    assert len(sets) >= 149 and sum("b" in who and "c" in who for who, _ in sets) >= 149
