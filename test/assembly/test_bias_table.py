"""Known biases are taken out of what is published, and do not reach guidance."""

import numpy as np
import pytest
from fed_stages import FedAssembly

from panoptic_ros.domain import BiasTable
from panoptic_ros.errors import ContractError
from panoptic_ros.io.biases import torso_of
from panoptic_ros.stage import StageContext


def test_published_joints_are_corrected_in_every_frame(scenes):
    rig, skeleton = scenes.ring(4), scenes.skeleton
    person = scenes.person(0.3, 0.1, turn=1.0)
    offsets = np.zeros((len(skeleton), 3))
    offsets[skeleton.joint("lHip")] = 0.2, 0.0, 0.0  # 10 cm, more than guidance would stand
    table = BiasTable("made", offsets, torso_of(skeleton.joint_names, "it"))
    context = StageContext(rig, skeleton, {"bias_table": table})
    stage = FedAssembly(context, bias_table="made")
    for index in range(5):
        pose = stage.step(scenes.proposals(rig, [person], index=index)).outputs[0]
        assert np.allclose(pose.positions[0], table.corrected(person[None])[0], atol=1e-6)
        assert (pose.views == 4).all()
        assert np.allclose(pose.positions - pose.corrections, person, atol=1e-6)
    (followed,) = stage.association.step(scenes.proposals(rig, [person], index=5).detections).outputs
    assert np.abs(followed.prediction.positions[0] - person).max() < 0.01  # where the images show the hip


def test_a_table_that_is_not_there_is_refused(scenes):
    with pytest.raises(ContractError, match="bias_table"):
        FedAssembly(scenes.context(scenes.ring(3)), bias_table="made")
