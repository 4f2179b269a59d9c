"""What the stage promises, with a made network of centre heads."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.detection.model import DetectorModel
from panoptic_ros.detection.stage import DetectionStage
from panoptic_ros.domain import DepthFrame, JointMap
from panoptic_ros.errors import BackendError, ContractError
from panoptic_ros.params import load, to_mapping
from panoptic_ros.stage import StageContext

CELLS = np.array([[[10, 10], [12, 20], [14, 30]], [[40, 10], [42, 20], [44, 30]]])
PLACES = 4.0 * CELLS + 1.5


@pytest.fixture
def network(blobs):
    return blobs.heads_network([-10, -2, 0, 0, 10, 2])


@pytest.fixture
def picture(blobs):
    return blobs.picture((192, 256), PLACES, 4.0)


def stage(blobs, network, card=None, **config):
    config = {"input_side": 256, "smallest_input": 64, **config}
    return blobs.stage(card or blobs.heads_card(), network, **config)


def fingerprint(result):
    found = result.outputs[0]
    maps = found.maps
    return (
        found.camera,
        found.stamp_ns,
        found.points.tobytes(),
        found.scores.tobytes(),
        found.person_scores.tobytes(),
        maps.data.tobytes(),
        maps.corners.tobytes(),
        maps.grid_size,
        maps.persons.tobytes(),
        tuple(note.text for note in result.notices),
    )


def test_the_record_carries_what_came_with_the_image(blobs, network, picture):
    found = stage(blobs, network).step(blobs.frame(picture, 7, "door")).outputs[0]
    assert (found.camera, found.stamp_ns, found.frame_number) == ("door", 7000, 7)
    assert found.image_size == (256, 192) and found.skeleton_hash == blobs.skeleton.hash


def test_an_empty_image_gives_an_empty_record(blobs, network):
    found = stage(blobs, network).step(blobs.frame(np.zeros((192, 256, 3), np.uint8))).outputs[0]
    assert found.points.shape == (0, 4, 2) and found.maps.data.size == 0


def frames(blobs, picture):
    rng = np.random.default_rng(0)
    for number in range(12):
        moved = np.roll(picture, int(rng.integers(-20, 20)), axis=1)
        camera = "left" if number % 2 else "right"
        yield blobs.frame(np.zeros_like(picture) if number in (4, 5, 6, 7) else moved, number, camera)


def test_reset_and_flush_make_the_stage_as_new(blobs, network, picture):
    one = stage(blobs, network)
    first = [fingerprint(one.step(frame)) for frame in frames(blobs, picture)]
    one.reset()
    assert [fingerprint(one.step(frame)) for frame in frames(blobs, picture)] == first
    assert one.flush().outputs == ()
    assert [fingerprint(one.step(frame)) for frame in frames(blobs, picture)] == first
    assert [fingerprint(stage(blobs, network).step(next(frames(blobs, picture))))] == first[:1]


def test_cameras_do_not_influence_each_other(blobs, network, picture):
    one = stage(blobs, network)
    both = {fingerprint(one.step(frame)) for frame in frames(blobs, picture)}
    for camera in ("left", "right"):
        alone = stage(blobs, network)
        for frame in frames(blobs, picture):
            if frame.camera == camera:
                assert fingerprint(alone.step(frame)) in both


def test_the_image_is_left_alone(blobs, network, picture):
    before = picture.copy()
    stage(blobs, network).step(blobs.frame(picture))
    np.testing.assert_array_equal(picture, before)


def test_thresholds_come_from_the_card_unless_given(blobs, network, picture):
    weak = (picture * 0.4).astype(np.uint8)  # joints of score 0.4, people of 0.16
    card = blobs.heads_card(person_threshold=0.2)
    assert len(stage(blobs, network, card).step(blobs.frame(weak)).outputs[0].points) == 0
    found = stage(blobs, network, card, person_threshold=0.05).step(blobs.frame(weak)).outputs[0]
    assert len(found.points) == 2 and found.scores.max() < 0.45
    strict = stage(blobs, network, card, person_threshold=0.05, joint_threshold=0.9)
    assert len(strict.step(blobs.frame(weak)).outputs[0].points) == 0


def test_joints_below_the_threshold_are_missing_and_so_are_means_of_them(blobs, network, picture):
    picture[..., 0] = picture[..., 0] * 0.1  # the blue joint
    found = stage(blobs, network).step(blobs.frame(picture)).outputs[0]
    assert np.isnan(found.points[:, 2:]).all() and (found.scores[:, 2:] == 0).all()
    assert np.isfinite(found.points[:, :2]).all()


def test_maps_can_be_left_out(blobs, network, picture):
    assert stage(blobs, network, maps=False).step(blobs.frame(picture)).outputs[0].maps is None


def test_people_that_stay_too_large_are_said_once(blobs, network, picture):
    card = blobs.heads_card(person_px=[10, 40])  # they are 80 px tall
    one = stage(blobs, network, card, adapt_input=False)
    notices = [n for i in range(60) for n in one.step(blobs.frame(picture, i)).notices]
    assert [n.code for n in notices] == ["detection.person_size"] and "left" in notices[0].text
    assert notices[0].values["largest_px"] > 40


def test_what_the_context_must_hold(blobs, network):
    context = StageContext(None, blobs.skeleton, {"joint_map": blobs.joint_map})
    with pytest.raises(ContractError, match="detector"):
        DetectionStage(DetectionConfig(), context)
    extras = {"detector": DetectorModel(blobs.heads_card(), network), "joint_map": JointMap(2, ((0,), (1,)))}
    with pytest.raises(ContractError, match="2 joints"):
        DetectionStage(DetectionConfig(), StageContext(None, blobs.skeleton, extras))


def test_a_provider_that_is_not_there_ends_the_construction(blobs, network):
    with pytest.raises(BackendError, match="NoSuch"):
        stage(blobs, network, providers=("NoSuchExecutionProvider",))


def test_the_configuration_survives_a_round_trip():
    config = DetectionConfig(threads=2, providers=("A", "B"), input_side=0)
    assert load(DetectionConfig, to_mapping(config)) == config


def test_what_the_camera_measures_limits_what_it_sees(blobs, network, picture):
    depth = np.full((96, 128), 2.0, np.float32)
    depth[:, 64:] = np.nan
    frame = replace(blobs.frame(picture), stamp_ns=10**9)
    detection = stage(blobs, network, depth_margin=0.3)
    for stamp_ns in (frame.stamp_ns - 9_000_000, frame.stamp_ns + 8_000_000):  # the first is another image's
        other = np.full((96, 128), 9.0, np.float32) if stamp_ns < frame.stamp_ns else depth
        assert detection.step(DepthFrame(frame.camera, stamp_ns, 0, other)).outputs == ()
    limit = detection.step(frame).outputs[0].limit
    assert limit.cells.shape == (96, 128)
    assert (limit.cells[:, :64] == 2300).all() and not limit.cells[:, 64:].any()
    assert stage(blobs, network).step(blobs.frame(picture)).outputs[0].limit is None
