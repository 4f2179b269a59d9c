"""What counts after a pause: who is where, and how devices sit, but no motion."""

import numpy as np
from stage_cases import cases, chain

from panoptic_ros.stage import LastingStateStage


def items():
    frames = chain(20)
    return [item for pair in zip(frames["detection_sets"], frames["refinement"]) for item in pair]


def test_bodies_go_on_from_it_and_it_is_small():
    case, given = cases()["kinematics"], items()
    stage, whole, fresh = (case.stage(rate_hz=30.0, lag=0.1) for _ in range(3))
    for item in given[:20]:
        stage.step(item)
    before = stage.state()
    lasting = stage.lasting_state()
    assert isinstance(stage, LastingStateStage) and stage.state() == before and len(lasting) < len(before) / 5
    whole.begin(before)
    fresh.begin(lasting)
    bodies = {}
    for name, one in (("whole", whole), ("fresh", fresh)):
        found = [o for item in given[20:] for o in one.step(item).outputs] + list(one.flush().outputs)
        bodies[name] = {body.stamp_ns: body for body in found}
    stamps = sorted(set(bodies["whole"]) & set(bodies["fresh"]))
    assert len(stamps) >= 8
    for stamp in stamps[2:]:
        first, second = bodies["whole"][stamp], bodies["fresh"][stamp]
        assert first.ids.tolist() == second.ids.tolist()
        assert np.abs(first.positions - second.positions).max() < 0.05
