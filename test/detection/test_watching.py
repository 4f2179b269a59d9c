"""What comes of every image where looks are rationed, with a made network that sees blobs."""

from dataclasses import replace

import numpy as np
import pytest
from blobs import SKELETON, Blobs
from stage_cases import CELLS, SECOND, known_people, watched, watcher

from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.detection.full_image import FullImageNetwork
from panoptic_ros.detection.model import DetectorModel
from panoptic_ros.detection.stage import DetectionStage
from panoptic_ros.domain import TrackSet, ViewFrame
from panoptic_ros.errors import ConfigError, DataError
from panoptic_ros.stage import StageContext

PLACES = 4.0 * CELLS + 1.5
SIZES = {"input_side": 256, "smallest_input": 64, "adapt_input": False}
PERIOD = 40_000_000


def stage(**values):
    return DetectionStage(DetectionConfig(**{**SIZES, **values}), watcher())


def image(places, k, camera="left"):
    frame = Blobs.frame(Blobs.picture((192, 256), places, 4.0), k, camera)
    return replace(frame, stamp_ns=SECOND + k * PERIOD)


def tell(one, places, k):
    one.step(known_people(places, SECOND + k * PERIOD, k))


def views(one, frames, places=PLACES, cameras=("left", "right", "third")):
    """Records (camera, frame) of people who stand still, and whom tracking knows from the second frame on."""
    found = {}
    for k in range(frames):
        for camera in cameras:
            (found[camera, k],) = one.step(image(places, k, camera)).outputs
        tell(one, places, k)
    return found


def test_everybody_is_in_every_record_and_carried_ones_say_so():
    found = views(stage(looks_per_s=9.0), 20)
    settled = {key: view for key, view in found.items() if key[1] >= 4}
    for view in settled.values():
        assert len(view.points) == 2
        places = view.points[np.argsort(view.points[:, 0, 0]), :3]
        np.testing.assert_allclose(places, PLACES, atol=2.5)
    ages = [0.0 if view.carried is None else view.carried.max() for view in settled.values()]
    assert 0.25 < np.mean(np.array(ages) == 0.0) < 0.5  # 9 looks of 25 images
    assert max(ages) <= 2.5 * PERIOD * 1e-9
    assert all(view.maps is None for view in settled.values() if view.carried is not None)
    assert all(view.maps is not None for view in settled.values() if view.carried is None)


def test_looks_at_people_who_are_known_cost_less(monkeypatch):
    cost = []
    run = FullImageNetwork._run

    def counted(self, picture, size, **how):
        cost.append(size[0] * size[1])
        return run(self, picture, size, **how)

    monkeypatch.setattr(FullImageNetwork, "_run", counted)
    views(stage(regions="on", region_height=64), 8)
    first, last = cost[:3], cost[-3:]
    assert max(last) < 0.5 * min(first)


@pytest.mark.parametrize(("shown", "runs"), [(2, 1), (1, 2)])
def test_a_crowd_of_which_somebody_is_missing_is_looked_at_more_closely(monkeypatch, shown, runs):
    crowd = np.stack([PLACES[0], PLACES[0] + (28.0, 0.0)])
    one = stage(regions="on", region_height=64)
    views(one, 8, crowd)
    sizes = []
    run = FullImageNetwork._run

    def counted(self, picture, size, **how):
        sizes.append(size[0] * size[1])
        return run(self, picture, size, **how)

    monkeypatch.setattr(FullImageNetwork, "_run", counted)
    (view,) = one.step(image(crowd[:shown], 8, "right")).outputs
    assert len(sizes) == runs and sorted(sizes) == sizes
    assert len(view.points) == shown


@pytest.mark.parametrize("values", [{"regions": "on"}, {"looks_per_s": 9.0}])
def test_somebody_new_makes_all_cameras_look(values):
    one = stage(**values)
    views(one, 8)
    stranger = np.concatenate([PLACES, PLACES[:1] + (130.0, 60.0)])
    found = []
    for k in range(8, 30):
        for camera in ("left", "right", "third"):
            (view,) = one.step(image(stranger, k, camera)).outputs
            found.append((k, len(view.points) > 2, view.carried is None))
        tell(one, PLACES, k)  # tracking does not know him
    first = next(k for k, more, _ in found if more)
    assert first - 8 <= 12  # the scans of three cameras, twelve a second
    assert all(more and now for k, more, now in found if k in (first + 1, first + 2))
    assert not all(more for k, more, _ in found if k == first + 4)  # he is minded again later


def test_another_scene_is_looked_at_at_once():
    one = stage(looks_per_s=1.0)
    views(one, 4, cameras=("left",))
    bright = image(PLACES, 4)
    turned = replace(bright, image=255 - bright.image)
    assert one.step(turned).outputs[0].carried is None


def test_without_guidance_whole_images_are_looked_at_in_turn():
    found = views(stage(looks_per_s=9.0, regions="off"), 12)
    looked = [view.carried is None for (_, k), view in found.items() if k >= 2]
    assert 0.25 < np.mean(looked) < 0.5


def test_off_takes_tracks_and_leaves_them():
    one, other = stage(), stage()
    for item in watched(count=6):
        result = one.step(item)
        if not isinstance(item, TrackSet):
            (alone,) = other.step(item).outputs
            (found,) = result.outputs
            assert alone.points.tobytes() == found.points.tobytes() and found.carried is None


def test_networks_of_one_size_cannot_look_at_regions():
    card = Blobs.heads_card(input={"name": "image", "layout": "NHWC", "dtype": "uint8", "size": [192, 256]})
    extras = {**watcher().extras, "detector": DetectorModel(card, watcher().extras["detector"].onnx_bytes)}
    context = StageContext(watcher().rig, SKELETON, extras)
    with pytest.raises(ConfigError, match="regions = 'on'.*one size"):
        DetectionStage(DetectionConfig(regions="on"), context)
    DetectionStage(DetectionConfig(looks_per_s=8.0), context)  # takes turns alone


def test_tracks_of_another_skeleton_are_refused():
    one, tracks = stage(looks_per_s=9.0), known_people(PLACES, SECOND)
    with pytest.raises(DataError, match="tracks of skeleton other"):
        one.step(replace(tracks, skeleton_hash="other"))
    few = {name: getattr(tracks, name)[:, :3] for name in ("states", "variances", "ages", "unagreed")}
    with pytest.raises(DataError, match="with 3 joints"):
        one.step(replace(tracks, **few))


def test_carried_people_are_checked():
    (view,) = stage().step(ViewFrame("left", 5, 0, image(PLACES, 0).image)).outputs
    with pytest.raises(DataError, match="carried"):
        replace(view, carried=np.array([-0.1, 0.0]))
    assert replace(view, carried=np.array([0.1, 0.0])).carried[0] == 0.1
