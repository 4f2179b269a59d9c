"""Live: one camera whose clock is off never rules the graph; it is named, and used again when it agrees."""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from itertools import pairwise

import pytest

from panoptic_ros.stage import Notice

SECOND = 10**9
EPOCH = 1_795_000_000 * SECOND
BOOT = 653 * SECOND
WRAP = 2**32
KINDS = {
    "5 s ahead": lambda t: t + 5 * SECOND,
    "60 s ahead": lambda t: t + 60 * SECOND,
    "1 h ahead": lambda t: t + 3600 * SECOND,
    "5 s behind": lambda t: t - 5 * SECOND,
    "1 h behind": lambda t: t - 3600 * SECOND,
    "2^32 ns ahead": lambda t: t + WRAP,
    "2^32 ns behind": lambda t: t - WRAP,
    "2^32 us behind": lambda t: t - 1000 * WRAP,
    "2^32 ms behind": lambda t: t - 1_000_000 * WRAP,
    "wrapped at 2^32 ns": lambda t: t % WRAP,
    "wrapped at 2^32 us": lambda t: t % (1000 * WRAP),
    "since boot": lambda t: t - EPOCH + BOOT,
    "zero": lambda t: 0,
}
RATES = (1.5, 4.0, 10.0, 30.0)


@dataclass
class Take:
    """What a live sync stage made of frames; times are true ones, ns."""

    frames: list  # (time at which it came, camera, number, time at which it was taken)
    sets: list = field(default_factory=list)  # (time at which it came, set)
    notices: list[tuple[int, Notice]] = field(default_factory=list)

    def about_clocks(self):
        """The first warning of each text, as the terminal has it."""
        firsts = {}
        for at, note in self.notices:
            if note.code.startswith("sync.clock") and note.severity != "info":
                firsts.setdefault(note.text, (at, note))
        return list(firsts.values())


def live(
    bench,
    cameras="abcd",
    rate=30.0,
    seconds=20.0,
    stamp=lambda camera, t: t,
    lost=0.0,
    latency_s=None,
    told=True,
    seed=0,
    jitter_s=0.0,
    late=lambda camera, t: 0,
    rates=None,
):
    """Let cameras give frames at one moment each; stamps are `stamp(camera, true time)`.

    A frame comes late by `late(camera, true time)` ns; None: it is lost.
    """
    rng = random.Random(seed)
    latency_s = min(0.3, 1.8 / rate) if latency_s is None else latency_s
    frames = []
    for camera in cameras:
        own, before = (rates or {}).get(camera, rate), 0
        for k in range(int(seconds * own)):
            t = EPOCH + round(k * SECOND / own + jitter_s * rng.gauss(0.0, SECOND))
            delay = late(camera, t)
            if rng.random() >= lost and delay is not None:
                came = t + round((0.02 + latency_s * rng.random()) * SECOND) + delay
                before = max(came, before + 1)  # images of a camera come in order
                frames.append((before, camera, k, t))
    sync, take = bench.stage(cameras, deadline_s=0.5), Take(frames)
    for came, camera, k, t in sorted(frames):
        if told:
            sync.arrived(came - EPOCH + 7 * SECOND, came)
        result = sync.step(bench.view(camera, stamp(camera, t), k))
        take.sets += [(came, item) for item in result.outputs]
        take.notices += [(came, note) for note in result.notices]
    return take


def check_others(take, good, rate, seconds, lost=0.0):
    """The good cameras are grouped throughout, with right stamps."""
    period = SECOND / rate
    stamps = [item.stamp_ns for _, item in take.sets]
    assert all(EPOCH - period <= stamp <= EPOCH + (seconds + 1) * SECOND for stamp in stamps)
    full = [item.stamp_ns for _, item in take.sets if set(good) <= {view.camera for view in item.views}]
    ending = EPOCH + (seconds - 0.5) * SECOND
    grouped = [view for _, item in take.sets for view in item.views if view.camera in good]
    given = sum(t < ending for _, camera, _, t in take.frames if camera in good)
    assert sum(view.stamp_ns < ending for view in grouped) >= 0.98 * given - len(good)
    if not lost:
        assert max(b - a for a, b in pairwise(full)) < 3.1 * period


def check_named(take, rate, begin_ns, end_ns, bad="c"):
    """No frame of the accident is grouped; the camera is named once, in time."""
    period = SECOND / rate
    assert not [
        view
        for _, item in take.sets
        for view in item.views
        if view.camera == bad and begin_ns <= EPOCH + round(view.frame_number * period) < end_ns
    ]
    ((at, note),) = take.about_clocks()
    assert note.code == "sync.clock_off" and f"camera {bad} " in note.text
    assert note.values["device"] == bad
    assert at - begin_ns <= max(SECOND, 3 * period) + 0.35 * SECOND  # with the latency of detection


def wrong(kind, begin_s, end_s=1e6, bad="c"):
    """Stamps of an accident of one camera, and when it begins and ends, ns."""
    begin, end = EPOCH + round(begin_s * SECOND), EPOCH + round(end_s * SECOND)
    return lambda c, t: KINDS[kind](t) if c in bad and begin <= t < end else t, begin, end


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("kind", KINDS)
def test_a_clock_that_goes_wrong_for_good(bench, kind, rate):
    seconds = 7.0 if rate > 9.0 else 12.0
    stamp, begin, end = wrong(kind, 4.0)
    take = live(bench, "abcd", rate, seconds, stamp)
    check_others(take, "abd", rate, seconds)
    check_named(take, rate, begin, end)


@pytest.mark.parametrize("rate", [1.5, 4.0, 30.0])
@pytest.mark.parametrize("kind", KINDS)
def test_a_clock_that_is_wrong_from_the_start(bench, kind, rate):
    seconds = 5.0 if rate > 9.0 else 10.0
    stamp, begin, end = wrong(kind, 0.0)
    take = live(bench, "abc", rate, seconds, stamp)
    check_others(take, "ab", rate, seconds)
    check_named(take, rate, begin, end)


@pytest.mark.parametrize("rate", [4.0, 15.0])
@pytest.mark.parametrize("kind", KINDS)
def test_a_clock_that_is_wrong_for_two_seconds_is_used_again(bench, kind, rate):
    stamp, begin, end = wrong(kind, 3.0, 5.0)
    take = live(bench, "abcd", rate, 8.0, stamp)
    check_others(take, "abd", rate, 8.0)
    check_named(take, rate, begin, end)
    again = [at for at, note in take.notices if note.code == "sync.clock_agrees"]
    assert len(again) == 1 and again[0] - end <= SECOND / rate + 0.4 * SECOND
    late = [item for _, item in take.sets if item.stamp_ns > end + 2 * SECOND / rate]
    assert len(late) >= 2.0 * rate and all(len(item.views) == 4 for item in late[2:])


@pytest.mark.parametrize("kind", ["5 s ahead", "1 h ahead", "since boot", "zero", "2^32 ns behind"])
@pytest.mark.parametrize("cameras", ["abc", "abcdefgh"])
def test_lossy_images_of_eight_cameras(bench, cameras, kind):
    stamp, begin, _ = wrong(kind, 4.0)
    take = live(bench, cameras, 6.0, 12.0, stamp, lost=0.3, jitter_s=0.003, seed=3)
    check_others(take, set(cameras) - {"c"}, 6.0, 12.0, lost=0.3)
    ((at, note),) = take.about_clocks()
    assert "camera c " in note.text and at - begin < 2 * SECOND


def test_a_camera_that_stays_wrong_stays_on_diagnostics(bench):
    """A status forgets a warning after 10 s, so it comes again in the same words."""
    take = live(bench, "abc", 4.0, 40.0, wrong("1 h ahead", 4.0)[0])
    times = [at for at, note in take.notices if note.code == "sync.clock_off"]
    assert len(take.about_clocks()) == 1
    assert len(times) >= 5 and max(b - a for a, b in pairwise(times)) < 9 * SECOND


# ------------------------------------------------------------------ no majority


@pytest.mark.parametrize("kind", [kind for kind in KINDS if "wrapped" not in kind])
@pytest.mark.parametrize("begin_s", [0.0, 4.0])
def test_of_two_cameras_the_host_decides_and_both_are_named(bench, kind, begin_s):
    for bad, good in ("ab", "ba"):
        stamp, begin, _ = wrong(kind, begin_s, bad=bad)
        take = live(bench, "ab", 6.0, 8.0, stamp)
        check_others(take, good, 6.0, 8.0)
        ((at, note),) = take.about_clocks()
        assert f"camera {bad} " in note.text and f"camera {good}, for which the host" in note.text
        assert at - begin < 1.5 * SECOND


@pytest.mark.parametrize("begin_s", [0.0, 4.0])
def test_two_against_two(bench, begin_s):
    stamp, _, _ = wrong("1 h ahead", begin_s, bad="ab")
    take = live(bench, "abcd", 6.0, 8.0, stamp)
    check_others(take, "cd", 6.0, 8.0)
    texts = [note.text for _, note in take.about_clocks()]
    assert len(texts) == 2 and all("camera c and d, for which the host" in text for text in texts)
    assert "camera a " in texts[0] + texts[1] and "camera b " in texts[0] + texts[1]


def test_the_host_decides_for_the_camera_that_was_wrong_so_far(bench):
    """Two cameras are on another clock; then one of them is set to the host's time."""
    set_at = EPOCH + 5 * SECOND
    take = live(bench, "ab", 6.0, 10.0, lambda c, t: t if c == "a" and t > set_at else t - 60 * SECOND)
    codes = [note.code for _, note in take.about_clocks()]
    assert codes == ["sync.clock_tie", "sync.clock_off"]
    assert take.sets[-1][1].stamp_ns > EPOCH + 9 * SECOND
    assert {view.camera for _, item in take.sets[-10:] for view in item.views} == {"a"}


def test_a_camera_that_nobody_confirms_does_not_begin(bench):
    """One of two cameras is there, with stamps since boot; the other comes after 12 s."""
    take = live(
        bench,
        "ab",
        4.0,
        16.0,
        lambda c, t: t - EPOCH + BOOT if c == "a" else t,
        late=lambda c, t: None if c == "b" and t < EPOCH + 12 * SECOND else 0,
    )
    assert all(item.stamp_ns >= EPOCH for _, item in take.sets) and take.sets
    assert ["camera a " in note.text for _, note in take.about_clocks()] == [True]


# ------------------------------------------------------------------ clocks that are right


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("rate", [0.5, 0.8, 1.2, 6.0])
def test_ten_minutes_of_lossy_images_give_no_line(bench, rate, told):
    for seed in range(2 if rate < 5.0 else 1):
        seconds = 600.0 if rate < 5.0 else 120.0
        take = live(bench, "abcd", rate, seconds, lost=0.3, latency_s=0.6, told=told, seed=seed)
        assert take.about_clocks() == []
        assert not [note for _, note in take.notices if note.code in ("sync.stray_stamp", "sync.out_of_time")]


def test_cameras_of_other_rates_give_no_line(bench):
    take = live(bench, "abcd", 30.0, 20.0, lost=0.1, rates={"a": 60.0, "b": 6.0, "d": 1.0})
    assert take.about_clocks() == []


def test_a_stall_of_one_camera_and_the_burst_after_it_give_no_line(bench):
    """Images of one camera come up to 4 s late, all at once."""

    def late(camera, t):
        since = t - EPOCH - 5 * SECOND
        return max(0, 4 * SECOND - since) if camera == "b" and since >= 0 else 0

    take = live(bench, "abcd", 30.0, 15.0, late=late)
    assert take.about_clocks() == []
    check_others(take, "acd", 30.0, 15.0)


@pytest.mark.parametrize("pause_s", [3.0, 60.0, 3600.0])
@pytest.mark.parametrize("who", ["abcd", "b"])
def test_a_pause_gives_no_line(bench, pause_s, who):
    """Cameras of 6 and 1 Hz pause."""

    def late(camera, t):
        return None if camera in who and 0 <= t - EPOCH - 5 * SECOND < pause_s * SECOND else 0

    seconds = min(pause_s, 60.0) + 12.0
    if pause_s > seconds:  # frames of the pause are not made
        take = live(
            bench,
            "abcd",
            6.0,
            12.0,
            lambda c, t: t + (3600 * SECOND if t > EPOCH + 6 * SECOND else 0),
            late=lambda c, t: 3600 * SECOND if t > EPOCH + 6 * SECOND else 0,
            rates={"d": 1.0},
        )
    else:
        take = live(bench, "abcd", 6.0, seconds, late=late, rates={"d": 1.0})
    assert take.about_clocks() == []
    assert {view.camera for _, item in take.sets[-8:] for view in item.views} == set("abcd")


@pytest.mark.parametrize("step_s", [-0.5, -5.0, -3600.0, 5.0, 3600.0])
def test_the_host_s_clock_is_set(bench, step_s):
    """All cameras are stamped by it; ahead the stamps follow, back they run on."""
    moved = round(step_s * SECOND)
    take = live(
        bench,
        "abcd",
        15.0,
        10.0,
        lambda c, t: t + (moved if t > EPOCH + 5 * SECOND else 0),
        latency_s=0.05,
        rates={"d": 5.0} if abs(step_s) > 1.0 else None,
    )
    codes = [note.code for _, note in take.about_clocks()]
    assert codes == (["sync.clock_set_back"] if step_s < 0 else [])
    assert len(take.sets) >= 140
    stamps = [item.stamp_ns for _, item in take.sets]
    assert all(b > a for a, b in pairwise(stamps))
    assert {view.camera for _, item in take.sets[-8:] for view in item.views} == set("abcd")
