"""Sync: sets by stamps, independent of the order of arrival."""
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.domain import Camera, ClockModel, EndOfStream, Rig, SkeletonModel, ViewDetections
from panoptic_ros.errors import DataError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.stage import StageContext
from panoptic_ros.sync import SyncConfig, SyncStage

SKELETON = SkeletonModel("dot", ("a", "b"), 0, ((0, 1),), 0)
K = Intrinsics(np.array([[100.0, 0, 50], [0, 100, 50], [0, 0, 1]]), np.zeros(5))
RIG = Rig(tuple(Camera(name, (100, 100), K, Rigid.identity()) for name in ("a", "b", "c")))
CONTEXT = StageContext(RIG, SKELETON)


def view(camera, stamp, number=0):
    return ViewDetections(
        camera, stamp, number, (100, 100), SKELETON.hash,
        np.zeros((0, 2, 2)), np.zeros((0, 2)), np.zeros(0),
    )  # fmt: skip


def stage(**parameters):
    return SyncStage(SyncConfig(**{"window_s": 10e-9, **parameters}), CONTEXT)


def run(sync, items):
    results = [sync.step(item) for item in items] + [sync.flush()]
    sets = [s for r in results for s in r.outputs]
    codes = [n.code for r in results for n in r.notices]
    return [(s.index, s.stamp_ns, tuple((v.camera, v.stamp_ns) for v in s.views)) for s in sets], codes


def test_complete_set_is_given_at_once_in_rig_order():
    sync = stage()
    assert not sync.step(view("c", 103)).outputs
    assert not sync.step(view("a", 100)).outputs
    (result,) = sync.step(view("b", 105)).outputs
    assert [v.camera for v in result.views] == ["a", "b", "c"]
    assert (result.index, result.stamp_ns) == (0, 103)


def test_lost_frame_leaves_its_camera_absent():
    items = [view(c, s) for s in (100, 200) for c in "abc" if (c, s) != ("b", 100)]
    sets, codes = run(stage(), items)
    assert [[c for c, _ in s[2]] for s in sets] == [["a", "c"], ["a", "b", "c"]]
    assert codes == []


def test_end_of_a_camera_lets_the_others_go_on():
    sync = stage()
    sync.step(view("a", 100))
    sync.step(view("b", 100))
    (result,) = sync.step(EndOfStream("c")).outputs
    assert [v.camera for v in result.views] == ["a", "b"]


def test_deadline_gives_what_is_there_and_counts_late_frames():
    sync = stage(deadline_s=150e-9)
    sync.step(view("a", 100))
    sync.step(view("b", 100))
    sync.step(view("a", 200))
    (result,) = sync.step(view("a", 300)).outputs
    assert [v.camera for v in result.views] == ["a", "b"]
    late = sync.step(view("c", 101))
    assert not late.outputs and [n.code for n in late.notices] == ["sync.late_frame"]


def test_stamp_that_goes_back_is_dropped_and_reported():
    sync = stage()
    sync.step(view("a", 100))
    assert [n.code for n in sync.step(view("a", 100)).notices] == ["sync.stamp_back"]


def test_second_frame_in_a_window_is_surplus():
    sets, codes = run(stage(), [view("a", 100), view("a", 105), view("b", 101), view("c", 102)])
    assert codes == ["sync.surplus_frame"]
    assert sets == [(0, 101, (("a", 100), ("b", 101), ("c", 102)))]


def test_queue_is_bounded():
    sync = stage(queue_limit=3)
    codes = [n.code for i in range(6) for n in sync.step(view("a", 100 * i)).notices]
    assert codes == ["sync.queue_full"] * 3


def test_few_views_are_dropped_and_counted():
    sets, codes = run(stage(minimum_views=2), [view("a", 100), view("b", 200), view("c", 201)])
    assert len(sets) == 1 and codes == ["sync.few_views"]


def test_unknown_camera_and_foreign_skeleton_are_refused_without_a_trace():
    sync = stage()
    with pytest.raises(DataError, match="'x'"):
        sync.step(view("x", 1))
    bad = ViewDetections("a", 1, 0, (9, 9), "00000000", np.zeros((0, 2, 2)), np.zeros((0, 2)), np.zeros(0))
    with pytest.raises(DataError, match="00000000"):
        sync.step(bad)
    assert sync.flush().outputs == ()


def test_clock_models_move_stamps_to_the_master_time_line():
    epoch = 1_700_000_000_000_000_001
    models = [
        ClockModel("a", epoch, -epoch, 0.0, np.zeros((2, 2))),
        ClockModel("b", 0, 7, 0.0, np.zeros((2, 2))),
        ClockModel("somebody else", 0, 1000, 0.0, np.zeros((2, 2))),
    ]
    sets, codes = run(stage(), [*models, view("a", epoch + 100), view("b", 94), view("c", 102)])
    assert codes == []
    assert sets == [(0, 101, (("a", 100), ("b", 101), ("c", 102)))]


@settings(max_examples=60, deadline=None)
@given(
    jitter=st.lists(st.integers(0, 9), min_size=12, max_size=12),
    lost=st.sets(st.integers(0, 11), max_size=6),
    order=st.permutations(range(12)),
)
def test_arrival_order_between_cameras_does_not_matter(jitter, lost, order):
    frames = [
        view(c, 100 * (1 + i) + jitter[3 * i + k], i)
        for (i, (k, c)) in itertools.product(range(4), enumerate("abc"))
        if 3 * i + k not in lost
    ]
    reference, _ = run(stage(), frames)
    shuffled = sorted(range(len(frames)), key=lambda i: order[i])
    shuffled = [frames[i] for i in shuffled]
    per_camera = {c: sorted((v for v in frames if v.camera == c), key=lambda v: v.stamp_ns) for c in "abc"}
    arrival = [per_camera[v.camera].pop(0) for v in shuffled]  # each camera's own order is kept
    assert run(stage(), arrival)[0] == reference
    used = [entry for s in reference for entry in s[2]]
    assert len(used) == len(set(used)) == len(frames)
