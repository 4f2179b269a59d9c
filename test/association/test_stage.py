"""The association stage: who is found, who is followed, what is refused."""

from dataclasses import replace

import captures
import numpy as np
import pytest

from panoptic_ros.association.config import AssociationConfig
from panoptic_ros.association.stage import AssociationStage
from panoptic_ros.domain import DetectionSet, TrackSet
from panoptic_ros.errors import DataError

SECOND = 10**9
HASH, JOINTS = captures.SKELETON.hash, len(captures.SKELETON)


def seen(index):
    """Two people in four views at an instant."""
    stamp = SECOND + index * SECOND // 30
    views = tuple(captures.view(camera, index, stamp) for camera in captures.RIG.cameras)
    return DetectionSet(index, stamp, HASH, views)


def tracks(index, rows=(0, 1), joints=JOINTS, skeleton=HASH):
    """The people of an instant as tracking would follow them, standing."""
    people = captures.people(seen(index).stamp_ns / SECOND)[list(rows)][:, :joints]
    states = np.concatenate([people, np.zeros_like(people)], axis=-1)
    numbers = np.zeros(states.shape[:2])
    return TrackSet(
        index,
        seen(index).stamp_ns,
        skeleton,
        np.array(rows),
        states,
        np.full(people.shape, 1e-4),
        numbers,
        numbers.copy(),
        np.zeros(len(rows)),
    )


@pytest.fixture
def stage():
    return AssociationStage(AssociationConfig(), captures.CONTEXT)


def owners(found, index):
    """The person whose 2D people those of each row are; all views must say the same."""
    truth = captures.people(found.stamp_ns / SECOND)
    names = []
    for row in found.groups.member:
        nearest = set()
        for view, member in enumerate(row):
            camera = captures.RIG.cameras[found.evidence.cameras[view]]
            own = found.evidence.plane[member]
            local = camera.cam_from_world.apply(truth)
            gaps = np.linalg.norm(local[..., :2] / local[..., 2:] - own, axis=-1).mean(axis=1)
            nearest.add(int(gaps.argmin()))
        assert len(nearest) == 1
        names.append(nearest.pop())
    return names


def test_new_people_are_found_in_all_views(stage):
    (found,) = stage.step(seen(0)).outputs
    assert found.who.tolist() == [-1, -1] and sorted(owners(found, 0)) == [0, 1]
    assert not found.groups.mirrored.any() and len(found.prediction.positions) == 0


def test_who_is_followed_keeps_the_row_of_the_prediction_and_others_are_new(stage):
    stage.step(seen(0))
    stage.step(tracks(0, rows=(1,)))
    (found,) = stage.step(seen(1)).outputs
    assert found.who.tolist() == [0, -1] and owners(found, 1) == [1, 0]
    assert np.array_equal(found.places[0], found.prediction.positions[0])


def test_without_guidance_and_after_a_reset_everybody_is_new(stage):
    alone = AssociationStage(AssociationConfig(temporal_guidance=False), captures.CONTEXT)
    for each in (alone, stage):
        each.step(seen(0))
        each.step(tracks(0))
    stage.reset()
    for each in (alone, stage):
        (found,) = each.step(seen(1)).outputs
        assert found.who.tolist() == [-1, -1]


def test_nobody_is_found_in_nothing(stage):
    (found,) = stage.step(DetectionSet(0, SECOND, HASH, ())).outputs
    assert len(found.who) == 0 and found.evidence.views == 0


def test_sets_from_the_past_are_dropped_with_a_notice(stage):
    stage.step(seen(3))
    late = stage.step(seen(2))
    assert not late.outputs and late.notices[0].code == "association.old_stamp"


def test_stamps_of_views_count_unless_they_are_not_to_be_compensated():
    item = seen(1)
    views = (replace(item.views[0], stamp_ns=item.stamp_ns + 4_000_000), *item.views[1:])
    item = replace(item, views=views)
    for compensate, delay in ((True, 0.004), (False, 0.0)):
        config = AssociationConfig(compensate_stamps=compensate)
        (found,) = AssociationStage(config, captures.CONTEXT).step(item).outputs
        assert found.evidence.delays == pytest.approx([delay, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("wrong", [{"skeleton": "other"}, {"joints": 7}])
def test_tracks_of_another_skeleton_are_refused(stage, wrong):
    with pytest.raises(DataError, match="tracks of skeleton"):
        stage.step(tracks(0, **wrong))
    assert len(stage.step(seen(1)).outputs) == 1


def test_people_who_were_only_carried_are_nobody_new_but_go_on(stage):
    def carried(item):
        ages = [np.full(len(view.points), 0.04) for view in item.views]
        views = (replace(view, carried=age) for view, age in zip(item.views, ages))
        return replace(item, views=tuple(views))

    (found,) = stage.step(carried(seen(0))).outputs
    assert len(found.who) == 0
    stage.step(seen(1))
    stage.step(tracks(1))
    (found,) = stage.step(carried(seen(2))).outputs
    assert sorted(found.who.tolist()) == [0, 1]
