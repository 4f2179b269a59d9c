"""Bystanders and false people are left out."""

import numpy as np
import pytest
from free_cameras import FreeCapture

from panoptic_ros.continuous.bystanders import has_human_size
from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.stage import untold


class Scaled(FreeCapture):
    """The second person is smaller or larger, about a point between the cameras."""

    scale = 1.0

    def joints(self, time_s):
        first, second = super().joints(time_s)
        middle = second.mean(axis=0)
        return np.stack([first, middle + self.scale * (second - middle)])


class Tiny(Scaled):
    scale = 0.25


class Giant(Scaled):
    scale = 2.5


@pytest.mark.parametrize(("cls", "people"), [(Scaled, 2), (Tiny, 1), (Giant, 1)])
def test_people_without_human_size_are_left_out(cls, people):
    capture = cls(seconds=1.5)
    motion = ContinuousPass(ContinuousConfig(), capture.context).run(capture.recording, untold)
    assert len(motion.people) == people
    stage = make_stage(
        "continuous", configure({"continuous": {"active": True}})["continuous"], capture.context
    )
    sets = [out for item in capture.sets for out in stage.step(item.views[0]).outputs]
    assert [len(item.ids) for item in sets[25:]] == [people] * len(sets[25:]) and len(sets) > 50


def test_unknown_lengths_and_a_wild_joint_do_not_count():
    lengths = np.full(30, 0.3)
    assert has_human_size(lengths) and has_human_size(np.zeros(30)) and has_human_size(np.full(30, np.nan))
    lengths[:3] = 9.0, np.nan, 0.0
    assert has_human_size(lengths)
    lengths[3:8] = 9.0
    assert not has_human_size(lengths) and not has_human_size(np.full(30, 0.1))
