"""Everybody's filters at once are as everybody's alone."""

import numpy as np
import pytest

from panoptic_ros.domain import JointState, Rig, SkeletonModel, TimeShift, TrackedPoseSet
from panoptic_ros.refinement import tuning
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.refinement.stage import RefinementStage
from panoptic_ros.stage import StageContext

MODEL = SkeletonModel("arm", ("shoulder", "elbow", "wrist"), 0, ((0, 1), (1, 2)), 0)
REST = np.array([[0.0, 0.0, 1.4], [0.0, 0.3, 1.3], [0.1, 0.5, 1.2]])


def there(number, frame):
    """Who is in which set: 9 comes late and is lost for a while, 4 leaves and comes back, 2 flickers."""
    return {7: True, 9: frame > 6 and frame not in (20, 21), 4: not 12 < frame < 30, 2: frame % 3 > 0}[number]


def joints_of(number, frame):
    """Of a person who walks, some of them missing at times."""
    rng = np.random.default_rng([number, frame])
    joints = REST + [number, 0.04 * frame, 0.0] + rng.normal(0.0, 0.01, (3, 3))
    joints[rng.random(3) < 0.1] = np.nan
    return joints


def tracked(numbers, frame, moving):
    """The set of a frame, with its people in an order of their own."""
    ids = np.random.default_rng(frame).permutation([n for n in numbers if there(n, frame)]).astype(np.int64)
    positions = np.array([joints_of(n, frame) for n in ids]).reshape(-1, 3, 3)
    known = np.isfinite(positions[..., 0])
    eyes = np.where(known[..., None, None], np.eye(3), 0.0)
    speeds = np.where(known[..., None], [0.0, 1.2, 0.0], 0.0)
    shift = TimeShift(0.01 * eyes, 0.5 * speeds, speeds, 3.0 * eyes) if moving else None
    covariances = np.where(known[..., None, None], 1e-4 * np.eye(3), np.nan)
    return TrackedPoseSet(
        frame,
        10**9 + frame * 33_333_333,
        MODEL.hash,
        positions,
        covariances,
        0.8 * known,
        3 * known,
        np.where(known, JointState.MEASURED, JointState.MISSING),
        np.full(len(ids), 0.9),
        time_shift=shift,
        ids=ids,
    )


def refined(numbers, moving, lag):
    """{(person, frame): all that is told of the person then}, and how many filters are kept at the end."""
    stage = RefinementStage(RefinementConfig(lag=lag), StageContext(Rig(()), MODEL))
    outputs = [o for frame in range(45) for o in stage.step(tracked(numbers, frame, moving)).outputs]
    kept = stage._bank.people.ids.tolist()
    told = {}
    for output in [*outputs, *stage.flush().outputs]:
        assert output.ids.tolist() == sorted(output.ids.tolist())
        for row, number in enumerate(output.ids.tolist()):
            arrays = output.positions, output.covariances, output.scores, output.views, output.states
            told[number, output.index] = [array[row].tolist() for array in arrays]
    return told, kept


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("lag", [0.0, 0.05, 0.12])
def test_people_do_not_depend_on_who_else_is_there(moving, lag, monkeypatch):
    """But for errors that last, which are learnt from all people."""
    monkeypatch.setattr(tuning, "LASTING_GAIN", 0.0)
    together, kept = refined([7, 9, 4, 2], moving, lag)
    assert sorted(kept) == [2, 4, 7, 9] and {number for number, _ in together} == {2, 4, 7, 9}
    for number in (7, 9, 4, 2):
        alone, _ = refined([number], moving, lag)
        own = {key: value for key, value in together.items() if key[0] == number}
        assert own.keys() == alone.keys() and len(own) > 25
        assert str(own) == str(alone)  # to the last digit, NaN included


def test_who_has_left_is_forgotten_but_for_bones():
    stage = RefinementStage(RefinementConfig(), StageContext(Rig(()), MODEL))
    known = []
    for frame in range(28):
        stage.step(tracked([7, 4], frame, False))
        known.append(stage._bank.people.ids.tolist())
    assert known[22] == [7, 4] and known[27] == [7]  # 0.42 s after the last measurement, not before
    lengths, frames = stage._bank.departed[4]
    assert np.allclose(lengths, np.linalg.norm(np.diff(REST, axis=0), axis=1), atol=0.02)
    for frame in range(28, 40):
        stage.step(tracked([7, 4], frame, False))
    assert stage._bank.people.ids.tolist() == [7, 4] and not stage._bank.departed
    assert (stage._bank.people.frames[1] > frames).all()
