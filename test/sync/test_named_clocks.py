"""Clocks that the rig names, that nobody hears, that fall silent, or that are those of others."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.domain import ClockModel
from panoptic_ros.stage import StageContext
from panoptic_ros.sync import SyncConfig, SyncStage

SECOND = 10**9
PERIOD = SECOND // 25


def model(clock, offset_ns, until_ns, from_ns=0):
    return ClockModel(clock, until_ns, offset_ns, 0.0, np.zeros((2, 2)), 0.0, from_ns, until_ns, 5e-7)


def stage(bench, named, **parameters):
    """A stage of cameras a, b, ... that are stamped by these clocks."""
    context = bench.context("abc"[: len(named)])
    cameras = [replace(c, clock=clock) for c, clock in zip(context.rig.cameras, named)]
    rig = replace(context.rig, cameras=tuple(cameras))
    return SyncStage(SyncConfig(**parameters), StageContext(rig, context.skeleton))


def views(bench, clocks, seconds):
    """Frames at the same instants, from 100 s on, stamped by clocks that are so many seconds ahead."""
    return [
        bench.view("abc"[k], 100 * SECOND + ahead * SECOND + i * PERIOD, i)
        for i in range(seconds * 25)
        for k, ahead in enumerate(clocks)
    ]


def told(sync, items):
    results = [sync.step(item) for item in items] + [sync.flush()]
    return [s for r in results for s in r.outputs], [n for r in results for n in r.notices]


def test_the_clock_that_the_rig_names_moves_its_cameras(bench):
    clocks = [model("A", 0, 200 * SECOND), model("B", -17 * SECOND, 200 * SECOND)]
    sets, notices = told(stage(bench, "ABB"), clocks + views(bench, (0, 17, 17), 2))
    assert len(sets) == 50 and all(len(item.views) == 3 for item in sets) and not notices
    assert {view.stamp_ns - item.stamp_ns for item in sets for view in item.views} == {0}


def test_a_clock_of_a_name_goes_before_one_from_motion(bench):
    forever = replace(model("b", 5_000_000, 0), until_ns=2**63 - 1)
    items = [forever, model("B", -17 * SECOND, 200 * SECOND), forever, *views(bench, (0, 17), 2)]
    sets, _ = told(stage(bench, ("", "B")), items)
    assert {view.stamp_ns - item.stamp_ns for item in sets for view in item.views} == {0}
    alone, _ = told(stage(bench, ("", "B")), [forever, *views(bench, (0, 0), 2)])
    assert {v.stamp_ns - i.stamp_ns for i in alone for v in i.views if v.camera == "b"} == {5_000_000}


@pytest.mark.parametrize("deadline_s", [0.0, 0.5])
def test_a_clock_that_nobody_hears_is_told_once_and_groups_nothing(bench, deadline_s):
    sync = stage(bench, "ABB", clocks=("a=A", "b=B", "c=B"), deadline_s=deadline_s)
    sets, notices = told(sync, [model("A", 0, 200 * SECOND), *views(bench, (0, 17, 17), 4)])
    assert all({view.camera for view in item.views} == {"a"} for item in sets)
    unheard = [n.text for n in notices if n.code == "sync.clock_unheard"]
    assert (
        len(unheard) == 1
        and "clock B has no observations" in unheard[0]
        and unheard[0].endswith("clocks with observations: A")
    )
    assert sum(n.code == "sync.no_clock" for n in notices) == 200  # every frame is accounted for


def test_a_clock_that_falls_silent_is_told_once_each_time(bench):
    items = views(bench, (0, 0), 12)
    items.insert(0, model("A", 0, 101 * SECOND))
    items.insert(2 * 25 * 6, model("A", 0, 107 * SECOND))
    sets, notices = told(stage(bench, "AA", clocks=("*=A",)), items)
    assert [n.code for n in notices] == ["sync.clock_silent"] * 2 and len(sets) == 12 * 25


def test_stamps_far_from_all_that_was_heard_are_not_believed(bench):
    clocks = [
        model("A", 0, 110 * SECOND, 95 * SECOND),
        model("B", -3600 * SECOND, 3710 * SECOND, 3695 * SECOND),
    ]
    swapped = views(bench, (3600, 0), 3)
    sets, notices = told(stage(bench, "AB", clocks=("a=A", "b=B")), clocks + swapped)
    assert not sets
    far = [n.text for n in notices if n.code == "sync.clock_far"]
    assert len(far) == 2 and "camera a is stamped 3590 s from all observations of clock A" in far[0]


# ------------------------------------------------------------------ models that cannot be true


@pytest.mark.parametrize("drift", [1e9, -1.0, 0.01])
def test_a_model_that_cannot_be_true_is_left_out_and_told_once(bench, drift):
    bad = replace(model("b", 0, 200 * SECOND), drift=drift)
    sets, notices = told(stage(bench, ("", "")), [bad, bad, *views(bench, (0, 0), 2)])
    assert len(sets) == 50 and all(len(item.views) == 2 for item in sets)
    assert [(n.code, n.severity) for n in notices] == [
        ("sync.clock_implausible", "warning"),
        ("sync.clock_implausible", "info"),
    ]


@pytest.mark.parametrize("offset", [7 * SECOND, -7 * SECOND, 10**17, 2**63 - 1, 1 - 2**63])
@pytest.mark.parametrize("segment", [0, 5])
def test_a_wrong_model_is_forgotten_when_a_good_one_comes(bench, offset, segment):
    sync = stage(bench, ("", "", ""), deadline_s=0.5)
    items = views(bench, (0, 0, 0), 12)
    wrong = replace(model("b", offset, 200 * SECOND), segment=segment)
    good = model("b", 0, 200 * SECOND)
    sets, _ = told(sync, [*items[:225], wrong, *items[225:450], good, *items[450:]])
    assert len(sets) >= 299 and all({"a", "c"} <= {v.camera for v in item.views} for item in sets)
    after = [item for item in sets if item.stamp_ns > 107 * SECOND]
    assert len(after) >= 124 and all(len(item.views) == 3 for item in after)
