import numpy as np
import pytest

from panoptic_ros.errors import ConfigError
from panoptic_ros.voting.volume import Volume, volume_of_rig


def test_voxels_and_their_centres():
    volume = Volume.between((-0.1, 0.0, 0.0, 0.1, 0.12, 0.04), 0.04)
    assert volume.lower == (-3, 0, 0)
    assert volume.upper == (3, 3, 1)
    assert volume.centres(np.array([[-3, 0, 0]])) == pytest.approx(np.array([[-0.1, 0.02, 0.02]]))
    assert volume.contains(np.array([[0.11, 0.1, 0.02], [0.13, 0.1, 0.02]])).tolist() == [True, False]
    far = np.array([[-9.0, 1e3, 0.0], [1e9, 0.0, 0.0]])
    assert Volume.everywhere(0.04).contains(far).tolist() == [True, False]
    with pytest.raises(ConfigError, match="not a box"):
        Volume.between((0.0, 0.0, 0.0, 1.0, 1.0, 0.0), 0.04)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_the_volume_of_a_rig_holds_what_its_cameras_look_at(scenes, count):
    volume = volume_of_rig(scenes.ring(count), 0.1)
    joints = scenes.person(0.0, 0.0)
    assert volume.contains(joints).all()
    assert np.prod(volume.shape) * 0.1**3 < 20.0**3
