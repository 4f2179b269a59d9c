"""Skeletons name their 2D people: against captures of which the truth is known, through all of fusion."""

from dataclasses import replace
from functools import lru_cache

import invariances
import numpy as np
import pytest

from panoptic_ros.domain import RefinedPoseSet
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.pipeline import records_of
from panoptic_ros.simulation import NOISY, SKELETON, Ring, SimulatedScene, simulate
from panoptic_ros.simulation.drawn_maps import MapDrawing, with_drawn_maps
from panoptic_ros.stage import StageContext

NEAR = 0.25  # m, mean joint distance to the person whom a skeleton shows
FOUR = ("walk", "talk", "reach", "wave")


@lru_cache(maxsize=8)
def capture(noisy, maps, frames):
    more = {"degradation": NOISY} if noisy else {}
    take = simulate(SimulatedScene("test", FOUR, Ring(5), area=1.8, **more), 11, frames)
    sets = list(take.detection_sets())
    return take, [with_drawn_maps(item, MapDrawing((256, 144))) for item in sets] if maps else sets


def fused(rig, sets, last="refinement", settings=None):
    """The skeletons that the stage `last` of fusion gives."""
    topic = NODES[last].outputs[0]
    return records_of(topic, sets, configure(settings or {}), StageContext(rig, SKELETON))


def shown(take):
    """By set and camera: the person whom most joints of each 2D person show, -1 = nobody."""
    table = {}
    for index, views in take.sightings():
        for camera, view in zip(take.rig.cameras, views):
            people = [np.bincount(row[row >= 0]) for row in view.sources[..., 0]]
            table[index, camera.name] = [int(p.argmax()) if p.size else -1 for p in people]
    return table


def compared(take, items):
    """Numbers of (person, view) whose index is right, wrong, and missing although the person is shown."""
    right = wrong = missed = 0
    table = shown(take)
    for item in items:
        tick = take.schedule.ticks[item.index : item.index + 1]
        joints = np.stack([person.joints(tick)[0] for person in take.people])
        for k in range(len(item.positions)):
            gaps = np.nanmean(np.linalg.norm(joints - item.positions[k], axis=-1), axis=1)
            if gaps.min() > NEAR:
                continue
            for camera, frame, index in zip(
                item.sources.cameras, item.sources.frames, item.sources.persons[k]
            ):
                people = table[int(frame), camera]
                if index < 0:
                    missed += gaps.argmin() in people
                elif people[index] == gaps.argmin():
                    right += 1
                else:
                    wrong += 1
    return right, wrong, missed


@pytest.mark.parametrize("method", ["consensus", "dynamic_programming"])
def test_indices_are_those_of_the_true_2d_people(method):
    take, sets = capture(noisy=False, maps=method == "dynamic_programming", frames=12)
    items = fused(take.rig, sets, "assembly", {"assembly": {"method": method}})
    right, wrong, missed = compared(take, items)
    assert right >= 0.95 * 12 * 4 * 5
    assert right >= 0.99 * (right + wrong + missed)


def test_indices_of_a_detector_with_all_faults_are_mostly_right():
    take, sets = capture(noisy=True, maps=False, frames=30)
    right, wrong, missed = compared(take, fused(take.rig, sets, "assembly"))
    assert right >= 0.97 * (right + wrong)  # the rest: duplicates, which are nobody in the truth
    assert right >= 0.97 * (right + missed)


def test_views_are_named_by_camera_and_frame():
    take, sets = capture(noisy=False, maps=False, frames=12)
    sets = [replace(s, views=s.views[1:] if s.index == 3 else s.views) for s in sets]
    for item, given in zip(fused(take.rig, sets, "assembly"), sets, strict=True):
        assert item.sources.cameras == tuple(view.camera for view in given.views)
        assert item.sources.frames.tolist() == [view.frame_number for view in given.views]


@pytest.mark.parametrize("maps", [False, True])
def test_other_orders_give_the_same_2d_people(maps):
    take, sets = capture(noisy=True, maps=maps, frames=6)
    expected = fused(take.rig, sets, "tracking")
    rig, turned = invariances.other_order_of_cameras(take.rig, sets, [2, 0, 4, 1, 3])
    mixed = invariances.other_order_of_people(turned, np.random.default_rng(3))
    for item, other, old, new in zip(expected, fused(rig, mixed, "tracking"), sets, mixed, strict=True):
        points = [two_d_people(*pair) for pair in ((item, old), (other, new))]
        assert item.ids.tolist() == other.ids.tolist()
        assert other.sources.cameras == rig.names
        assert points[0] == points[1]


def two_d_people(item, given):
    """Their points as bytes by id and camera."""
    views = {view.camera: view for view in given.views}
    return {
        (int(number), camera): views[camera].points[index].tobytes()
        for number, row in zip(item.ids, item.sources.persons)
        for camera, index in zip(item.sources.cameras, row)
        if index >= 0
    }


@pytest.mark.parametrize("lag", [0.0, 0.12])
def test_indices_follow_people_through_tracking_and_refinement(lag):
    take, sets = capture(noisy=True, maps=False, frames=30)
    settings = {"refinement": {"lag": lag}}
    tracked = {item.index: item for item in fused(take.rig, sets, "tracking")}
    items = fused(take.rig, sets, settings=settings)
    assert len(items) == 30
    for item in items:
        before = tracked[item.index]
        assert isinstance(item, RefinedPoseSet) and item.sources.frames is not None
        assert item.sources.cameras == before.sources.cameras
        assert item.sources.frames.tolist() == before.sources.frames.tolist()
        rows = dict(zip(before.ids.tolist(), before.sources.persons.tolist()))
        for number, row in zip(item.ids.tolist(), item.sources.persons.tolist()):
            assert row == rows.get(number, [-1] * 5)


def test_people_who_are_filled_have_no_2d_people():
    take, sets = capture(noisy=False, maps=False, frames=12)
    gap = range(5, 7)
    hidden = [replace(s, views=tuple(nobody(v) for v in s.views)) if s.index in gap else s for s in sets]
    items = {item.index: item for item in fused(take.rig, hidden)}
    for index in gap:
        assert len(items[index].ids) == 4 and (items[index].sources.persons == -1).all()
    assert (items[4].sources.persons >= 0).mean() > 0.9


def nobody(view):
    return replace(view, points=view.points[:0], scores=view.scores[:0], person_scores=view.person_scores[:0])
