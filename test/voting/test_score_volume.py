import numpy as np
import pytest

from panoptic_ros.errors import ConfigError
from panoptic_ros.voting import kernels, score_volume
from panoptic_ros.voting.scene import build_scene
from panoptic_ros.voting.volume import EVERYWHERE, Volume, volume_of_rig

BOX = Volume.between((-0.6, -0.6, 0.8, 0.6, 0.6, 1.8), 0.05)


@pytest.fixture
def scene(scenes):
    rig = scenes.ring(4, (-0.1, 0.02))
    people = [scenes.person(0.2, 0.1), scenes.person(-0.2, -0.3, 2.0)]
    return build_scene(rig.cameras, scenes.detect(rig, people, "mixed").views, 19)


def test_peaks_are_the_voxels_that_beat_their_neighbours(scene):
    threshold, enough = 0.1, 2
    peaks = score_volume.dense_peaks(scene, BOX, threshold, 0.1, enough)
    votes, support = kernels.vote_block(scene, np.array(BOX.lower), BOX.shape, BOX.side, 0.1)
    expected = set()
    eligible = np.where(support >= enough, votes, -1.0)
    for j, x, y, z in np.argwhere(eligible > threshold):
        window = eligible[j, max(x - 1, 0) : x + 2, max(y - 1, 0) : y + 2, max(z - 1, 0) : z + 2]
        if eligible[j, x, y, z] >= window.max():
            expected.add((j, *(np.array([x, y, z]) + BOX.lower).tolist()))
    found = {(j, *voxel) for j, voxel in zip(peaks.joints.tolist(), peaks.voxels.tolist())}
    assert found == expected
    assert len(found) > 30


def test_slabs_make_no_difference(scene, monkeypatch):
    whole = score_volume.dense_peaks(scene, BOX, 0.05, 0.1, 2)
    monkeypatch.setattr(score_volume, "BLOCK_VALUES", 19 * 24 * 20 * 3)
    slabs = score_volume.dense_peaks(scene, BOX, 0.05, 0.1, 2)
    for a, b in zip(whole, slabs):
        assert np.array_equal(a, b)


def test_of_a_plateau_one_voxel_is_the_peak():
    rank = np.zeros((1, 4, 3, 3))
    rank[0, 1:3, 1, 1] = 0.5
    at = np.argwhere(rank > 0.0)
    assert score_volume._is_maximum(rank, at).tolist() == [True, False]


def test_voxels_and_their_centres():
    volume = Volume.between((-0.1, 0.0, 0.0, 0.1, 0.12, 0.04), 0.04)
    assert volume.lower == (-3, 0, 0)
    assert volume.upper == (3, 3, 1)
    assert volume.centres(np.array([[-3, 0, 0]])) == pytest.approx(np.array([[-0.1, 0.02, 0.02]]))
    assert volume.voxels(np.array([[-0.01, 0.05, 1e9]])).tolist() == [[-1, 1, EVERYWHERE]]
    assert volume.contains(np.array([[2, 2, 0], [3, 2, 0]])).tolist() == [True, False]
    with pytest.raises(ConfigError, match="no box"):
        Volume.between((0.0, 0.0, 0.0, 1.0, 1.0, 0.0), 0.04)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_the_volume_of_a_rig_holds_what_its_cameras_look_at(scenes, count):
    volume = volume_of_rig(scenes.ring(count), 0.1)
    joints = scenes.person(0.0, 0.0)
    assert volume.contains(volume.voxels(joints)).all()
    assert np.prod(volume.shape) * 0.1**3 < 20.0**3
