"""Recordings: cameras whose stamps are of another time are left out and named."""

import pytest

from panoptic_ros.domain import EndOfStream

SECOND = 10**9
EPOCH = 1_795_000_000 * SECOND
KINDS = {
    "since boot": lambda t: t - EPOCH + 653 * SECOND,
    "zero on": lambda t: t - EPOCH,
    "1 h ahead": lambda t: t + 3600 * SECOND,
    "1 h behind": lambda t: t - 3600 * SECOND,
    "2^32 us behind": lambda t: t - 1000 * 2**32,
    "20 s ahead": lambda t: t + 20 * SECOND,
}


def recorded(bench, cameras, stamp, seconds=4, rate=30.0, begin=lambda camera: 0.0, parameters=None):
    """Sets and notices of a recording; the first four frames of each camera come first."""
    frames = []
    for c in cameras:
        own = [
            bench.view(c, stamp(c, EPOCH + round(k * SECOND / rate)), k)
            for k in range(int(seconds * rate))
            if k / rate >= begin(c)
        ]
        frames += [((0 if k < 4 else 1, v.stamp_ns, c), v) for k, v in enumerate(own)]
        frames.append(((1, own[-1].stamp_ns + 1, c), EndOfStream(c)))
    sync = bench.stage(cameras, **(parameters or {}))
    results = [sync.step(item) for _, item in sorted(frames, key=lambda entry: entry[0])] + [sync.flush()]
    return [s for r in results for s in r.outputs], [n for r in results for n in r.notices]


def warnings(notices):
    return [n for n in notices if n.severity != "info" and n.code.startswith("sync.clock")]


@pytest.mark.parametrize("parameters", [{}, {"rate_hz": 30.0}, {"resampling": "interpolate"}])
@pytest.mark.parametrize("bad", ["a", "c", "ce"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_minority_is_left_out_and_named(bench, kind, bad, parameters):
    sets, notices = recorded(
        bench, "abcde", lambda c, t: KINDS[kind](t) if c in bad else t, parameters=parameters
    )
    sets = [item for item in sets if len(item.views) > 1]
    good = set("abcde") - set(bad)
    grouped = [item for item in sets if good <= {view.camera for view in item.views}]
    assert len(grouped) in (120, 121) and EPOCH - SECOND < grouped[0].stamp_ns
    if kind == "20 s ahead" and len(bad) > 1:
        return  # two cameras that begin 20 s later could be right
    assert all(EPOCH - SECOND < item.stamp_ns < EPOCH + 5 * SECOND for item in sets)
    assert [n.values["camera"] for n in warnings(notices)] == sorted(bad)


@pytest.mark.parametrize("cameras", ["ab", "abcd"])
def test_without_a_majority_the_first_camera_of_the_rig_stays(bench, cameras):
    bad = cameras[len(cameras) // 2 :]
    sets, notices = recorded(bench, cameras, lambda c, t: t + 3600 * SECOND * (c in bad))
    assert len(sets) == 120 and all({v.camera for v in s.views} == set(cameras) - set(bad) for s in sets)
    assert [n.values["camera"] for n in warnings(notices)] == list(bad)
    assert all("come first in the rig" in n.text and "camera a" in n.text for n in warnings(notices))


@pytest.mark.parametrize("late_s", [1.0, 3.0, 10.0])
def test_a_camera_that_starts_later_is_used(bench, late_s):
    sets, notices = recorded(
        bench, "abc", lambda c, t: t, seconds=15, begin=lambda c: late_s if c == "b" else 0.0
    )
    assert not warnings(notices) and len(sets) == 450
    assert sum(len(item.views) == 3 for item in sets) == 450 - 30 * late_s


def test_a_single_camera_is_as_it_was(bench):
    sets, notices = recorded(bench, "a", lambda c, t: t - EPOCH)
    assert len(sets) == 120 and not warnings(notices)
