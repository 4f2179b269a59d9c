"""Biases are stated at the end, and nobody is lost before a gap."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.domain import JointState, Rig, SkeletonModel, TrackedPoseSet
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.refinement.stage import RefinementStage
from panoptic_ros.stage import StageContext

MODEL = SkeletonModel("arm", ("shoulder", "elbow"), 0, ((0, 1),), 0)
KNOWN = replace(MODEL, bias_floors=(0.02, 0.03))


def tracked(index, time, ids=(4,)):
    positions = np.array([[[time, 0.0, 1.4], [time, 0.3, 1.4]]])[: len(ids)]
    shape = positions.shape[:2]
    return TrackedPoseSet(
        index,
        round(1e9 * (1.0 + time)),
        MODEL.hash,
        positions,
        np.tile(1e-4 * np.eye(3), (*shape, 1, 1)),
        np.ones(shape),
        np.full(shape, 3),
        np.full(shape, JointState.MEASURED),
        np.ones(len(ids)),
        ids=np.array(ids, np.int64),
    )


def run(times, model=MODEL, **settings):
    stage = RefinementStage(RefinementConfig(**settings), StageContext(Rig(()), model))
    results = [stage.step(tracked(i, t)) for i, t in enumerate(times)] + [stage.flush()]
    return [output for result in results for output in result.outputs]


@pytest.mark.parametrize("enabled", [True, False])
@pytest.mark.parametrize(
    "model, asked, floors",
    [(KNOWN, -1.0, (0.02, 0.03)), (KNOWN, 0.05, (0.05, 0.05)), (MODEL, -1.0, (0.0, 0.0))],
)
def test_floors_are_added_to_what_smoothing_says(enabled, model, asked, floors):
    times = [i / 25 for i in range(20)]
    plain = run(times, KNOWN, enabled=enabled, bias_floor=0.0)
    stated = run(times, model, enabled=enabled, bias_floor=asked, lasting_share=0.0)
    for a, b in zip(plain, stated):
        assert np.array_equal(a.positions, b.positions)
        expected = np.array(floors)[:, None, None] ** 2 * np.eye(3)
        assert np.allclose(b.covariances[0] - a.covariances[0], expected, atol=1e-15)


def test_the_last_instants_before_a_long_gap_keep_their_people():
    times = [i / 25 for i in range(10)] + [3.0 + i / 25 for i in range(10)]
    assert [len(output.ids) for output in run(times)] == [1] * 20


def covariance_of_elbow(times, lost=(), views=3, **settings):
    """Of the last instant, with the elbow lost at some of them; views: of all joints."""
    stage = RefinementStage(RefinementConfig(**settings), StageContext(Rig(()), KNOWN))
    for i, t in enumerate(times):
        item = tracked(i, t)
        item = replace(item, views=np.where(item.views > 0, views, 0))
        if i in lost:
            gone = np.array([[False, True]])
            states = np.where(gone, JointState.MISSING, item.states)
            item = replace(
                item,
                positions=np.where(gone[..., None], np.nan, item.positions),
                states=states,
                scores=np.where(gone, 0.0, item.scores),
                views=np.where(gone, 0, item.views),
                covariances=np.where(gone[..., None, None], np.nan, item.covariances),
            )
        stage.step(item)
    return stage.flush().outputs[-1].covariances[0, 1]


@pytest.mark.parametrize("lost, views, kept", [((), 3, 0.3), ((), 2, 0.3), ((18, 19), 3, 1.0)])
def test_smoothing_leaves_the_share_of_errors_that_last(lost, views, kept):
    times = [i / 25 for i in range(20)]
    plain, stated = (covariance_of_elbow(times, lost, views, lasting_share=share) for share in (0.0, 0.3))
    arrived = 1e-4
    # lengths of bones are learnt by all errors, so what they take off differs by little
    assert np.allclose(stated - plain, kept * arrived * np.eye(3), atol=1e-2 * arrived)


def test_errors_of_detectors_without_known_biases_do_not_last():
    times = [i / 25 for i in range(20)]
    plain, same = (run(times, lasting_share=share)[-1] for share in (0.0, 0.5))
    assert np.array_equal(plain.covariances, same.covariances)
