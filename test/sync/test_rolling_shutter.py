"""Sets of cameras with rolling shutters stand at the exposures of middle rows."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.domain import Rig
from panoptic_ros.stage import StageContext
from panoptic_ros.sync import SyncConfig, SyncStage

SECOND = 10**9
PERIOD = SECOND // 30
LINE_DELAY_US = 200.0  # images have 100 rows: the middle is 9.9 ms after the timestamp
MIDDLE = 9_900_000  # ns


def stage(bench, rolling, **parameters):
    """Sync of three cameras of which some have a rolling shutter."""
    context = bench.context()
    cameras = [
        replace(camera, line_delay_us=LINE_DELAY_US if camera.name in rolling else 0.0)
        for camera in context.rig.cameras
    ]
    return SyncStage(SyncConfig(**parameters), StageContext(Rig(tuple(cameras)), bench.skeleton))


def frames(bench, stamps):
    """Views of cameras with these first timestamps, in the order of all timestamps."""
    items = [bench.view(name, at + k * PERIOD, k) for name, at in stamps.items() for k in range(20)]
    return sorted(items, key=lambda view: view.stamp_ns)


def test_equal_stamps_of_rolling_cameras_give_sets_at_their_middle_rows(bench):
    sets, codes = bench.run(stage(bench, "abc"), frames(bench, dict.fromkeys("abc", SECOND)))
    assert not codes and len(sets) == 20
    for index, stamp, views in sets:
        first = SECOND + index * PERIOD
        assert stamp == first + MIDDLE and {at for _, at in views} == {first}


def test_views_of_one_set_are_nearest_by_their_middle_rows(bench):
    """By timestamps of first rows, the next frames of the rolling camera would be nearer."""
    stamps = {"a": SECOND, "b": SECOND, "c": SECOND + PERIOD // 2 + 3_000_000}
    sets, _ = bench.run(stage(bench, "ab"), frames(bench, stamps))
    for _, stamp, views in sets[1:-1]:
        assert [name for name, _ in views] == ["a", "b", "c"]
        for name, at in views:
            assert abs(at + (MIDDLE if name in "ab" else 0) - stamp) < PERIOD // 2
    _, _, views = sets[1]
    assert dict(views)["c"] - dict(views)["a"] == PERIOD // 2 + 3_000_000


def test_people_are_interpolated_to_the_instant_of_the_middle_row(bench):
    def people(row_ns):
        return np.array([[[10.0, 10.0], [20.0, 60.0]]]) + 1e-8 * (row_ns - SECOND)

    stamps = {"a": SECOND, "b": SECOND + 5_000_000, "c": SECOND + 11_000_000}
    items = []
    for name, at in stamps.items():
        for k in range(20):
            middle = at + k * PERIOD + (MIDDLE if name == "b" else 0)
            items.append(bench.view(name, at + k * PERIOD, k, people(middle)))
    items.sort(key=lambda view: view.stamp_ns)
    sync = stage(bench, "b", resampling="interpolate")
    sets = [s for item in items for s in sync.step(item).outputs]
    assert len(sets) > 10
    for item in sets[2:]:
        for view in item.views:
            assert view.stamp_ns == item.stamp_ns - (MIDDLE if view.camera == "b" else 0)
            assert view.points == pytest.approx(people(item.stamp_ns), abs=1e-6)
