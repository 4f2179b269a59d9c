"""Cameras on their side: images turned upright, and what is found turned back."""

from dataclasses import replace

import numpy as np
import pytest
from blobs import JOINT_MAP, SKELETON, Blobs

from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.detection.full_image import FullImageNetwork
from panoptic_ros.detection.model import DetectorModel
from panoptic_ros.detection.preprocess import turn_by
from panoptic_ros.detection.stage import DetectionStage
from panoptic_ros.detection.upright import NOT_KNOWN, UPRIGHT, rolls_of
from panoptic_ros.domain import Camera, Rig, TrackSet
from panoptic_ros.errors import ConfigError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.stage import StageContext

CELLS = np.array([[[10, 10], [12, 20], [14, 30]], [[40, 10], [42, 20], [44, 30]]])
PLACES = 4.0 * CELLS + 1.5
SIZES = {"input_side": 256, "smallest_input": 64, "adapt_input": False}
SECOND, PERIOD = 10**9, 40_000_000
FOCAL, DEPTH = 200.0, 4.0
# Level cameras in one place, in a world with z up: x right, y forward
LEVEL_POSE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def turning(degrees):
    """Return the map of directions (2, 2) when an image turns counter-clockwise."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, s], [-s, c]])


def camera(name, degrees=0.0, heading=0.0, size=(256, 192)):
    """Make a camera whose image, turned counter-clockwise, is that of a level one of a size (w, h)."""
    middle = (np.array(size) - 1.0) / 2.0
    turn = turn_by(-degrees, size)  # upright to rolled
    centre = turn.pixels(middle)
    matrix = np.array([[FOCAL, 0.0, centre[0]], [0.0, FOCAL, centre[1]], [0.0, 0.0, 1.0]])
    a = np.radians(heading)
    about_z = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
    pose = LEVEL_POSE @ about_z.T
    pose[:2] = turning(-degrees) @ pose[:2]
    return Camera(name, turn.size, Intrinsics(matrix, np.zeros(5)), Rigid(pose, np.zeros(3)))


def rig(**degrees):
    return Rig(tuple(camera(name, turn) for name, turn in degrees.items()))


def stage(cameras, **values):
    network = Blobs.heads_network([-10, -2, 0, 0, 10, 2])  # upright people: red over green over blue
    card = Blobs.heads_card()
    card = replace(card, input=replace(card.input, pad=0))  # the network takes anything grey for people
    extras = {"detector": DetectorModel(card, network), "joint_map": JOINT_MAP}
    return DetectionStage(DetectionConfig(**{**SIZES, **values}), StageContext(cameras, SKELETON, extras))


def frame(picture, name, k=0):
    return replace(Blobs.frame(picture, k, name), stamp_ns=SECOND + k * PERIOD)


def picture(places=PLACES):
    return Blobs.picture((192, 256), places, 4.0)


# ---------------------------------------------------------------- turns


@pytest.mark.parametrize("degrees", [90.0, 180.0, -90.0, -180.0, 270.0])
@pytest.mark.parametrize("size", [(7, 4), (5, 5), (2, 9)])
def test_a_quarter_turn_moves_every_pixel_where_its_map_says(degrees, size):
    image = np.random.default_rng(1).integers(0, 256, (*size[::-1], 3)).astype(np.uint8)
    turn = turn_by(degrees, size)
    turned = turn.image(image, 0)
    assert turned.shape == (*turn.size[::-1], 3)
    np.testing.assert_array_equal(turned, np.rot90(image, int(degrees // 90)))
    rows, columns = np.mgrid[: size[1], : size[0]]
    before = np.stack([columns, rows], axis=-1).astype(float)
    after = turn.pixels(before)
    assert (after == np.rint(after)).all()
    x, y = after.astype(int).reshape(-1, 2).T
    np.testing.assert_array_equal(turned[y, x], image.reshape(-1, 3))
    assert (turn.back(after) == before).all()


@pytest.mark.parametrize("degrees", [30.0, -45.0, 117.0, -160.0])
def test_any_turn_moves_a_blob_where_its_map_says(degrees):
    place = np.array([150.25, 60.5])
    image = Blobs.picture((192, 256), [place] * 3, 6.0)
    turn = turn_by(degrees, (256, 192))
    turned = turn.image(image, 0)[..., 0].astype(float)
    rows, columns = np.mgrid[: turned.shape[0], : turned.shape[1]]
    found = np.array([(turned * columns).sum(), (turned * rows).sum()]) / turned.sum()
    np.testing.assert_allclose(found, turn.pixels(place), atol=0.02)
    np.testing.assert_allclose(turn.back(turn.pixels(place)), place, atol=1e-9)
    corners = turn.pixels(np.array([[-0.5, -0.5], [255.5, -0.5], [255.5, 191.5], [-0.5, 191.5]]))
    assert (corners >= -0.51).all() and (corners <= np.array(turn.size) - 0.49).all()  # all of it is in


def test_what_lies_beyond_the_image_is_padding():
    turned = turn_by(45.0, (40, 40)).image(np.full((40, 40, 3), 200, np.uint8), 114)
    assert (turned[0, 0] == 114).all() and (turned[28, 28] == 200).all()


# ---------------------------------------------------------------- the stage


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_people_of_a_rolled_camera_are_those_of_the_upright_one_turned(quarters):
    """Quarter turns change no pixel, so everything is equal but for rounding."""
    (upright,) = stage(rig(a=0.0)).step(frame(picture(), "a")).outputs
    degrees = 90.0 * quarters
    turn = turn_by(-degrees, (256, 192))
    (rolled,) = stage(rig(a=degrees)).step(frame(turn.image(picture(), 0), "a")).outputs
    assert rolled.image_size == turn.size and len(rolled.points) == 2
    np.testing.assert_allclose(rolled.points, turn.pixels(upright.points), atol=1e-9)
    np.testing.assert_array_equal(rolled.scores, upright.scores)
    np.testing.assert_array_equal(rolled.person_scores, upright.person_scores)
    for name in ("grid_size", "data", "corners", "sizes", "joints", "persons"):
        np.testing.assert_array_equal(getattr(rolled.maps, name), getattr(upright.maps, name))
    cells = [
        maps.grid_from_image[:, :2] @ point + maps.grid_from_image[:, 2]
        for maps, point in ((rolled.maps, rolled.points[0, 0]), (upright.maps, upright.points[0, 0]))
    ]
    np.testing.assert_allclose(cells[0], cells[1], atol=1e-9)


@pytest.mark.parametrize("degrees", [35.0, -60.0, 150.0])
def test_people_of_a_camera_at_any_angle_are_where_they_are(degrees):
    turn = turn_by(-degrees, (256, 192))
    places = turn.pixels(PLACES)
    side = 32 * round(max(turn_by(degrees, turn.size).size) / 32)  # net px are about px
    one = stage(rig(a=degrees), input_side=side)
    (found,) = one.step(frame(Blobs.picture(turn.size[::-1], places, 4.0), "a")).outputs
    assert len(found.points) == 2 and found.image_size == turn.size
    order = np.argsort(np.linalg.norm(found.points[:, 0] - places[0, 0], axis=-1))
    np.testing.assert_allclose(found.points[order, :3], places, atol=3.5)  # half of a cell on both axes


def test_upright_cameras_are_unchanged_to_the_byte():
    """Compare with a stage without a rig, up to the angle up to which images stay."""
    (plain,) = stage(None).step(frame(picture(), "a")).outputs
    for degrees in (0.0, UPRIGHT - 1.0, 1.0 - UPRIGHT):
        result = stage(rig(a=degrees, b=90.0)).step(frame(picture(), "a"))
        (found,) = result.outputs
        assert found.points.tobytes() == plain.points.tobytes()
        assert found.maps.data.tobytes() == plain.maps.data.tobytes()
        assert found.maps.grid_from_image.tobytes() == plain.maps.grid_from_image.tobytes()


def known(places, stamp_ns, index):
    """Make tracks of people with blobs at places (P, 3, 2) px of the level camera."""
    pixels = np.concatenate([places, places.mean(axis=1, keepdims=True)], axis=1)
    states = np.zeros((*pixels.shape[:2], 6))
    rays = np.concatenate([(pixels - (127.5, 95.5)) / FOCAL, np.ones((*pixels.shape[:2], 1))], axis=-1)
    states[..., :3] = DEPTH * rays @ LEVEL_POSE
    rest = np.zeros(pixels.shape[:2])
    return TrackSet(
        index,
        stamp_ns,
        SKELETON.hash,
        np.arange(len(places)),
        states,
        np.full((*rest.shape, 3), 1e-5),
        rest,
        rest,
        np.zeros(len(places)),
    )


@pytest.mark.parametrize("values", [{"regions": "on", "region_height": 64}, {"looks_per_s": 9.0}])
def test_guided_looks_and_carried_people_are_those_of_the_upright_rig(values, monkeypatch):
    """Regions, scans, alarms and flow work in the upright image."""
    sizes = []
    run = FullImageNetwork._run

    def counted(self, picture, size, **how):
        sizes[-1].append(size)
        return run(self, picture, size, **how)

    monkeypatch.setattr(FullImageNetwork, "_run", counted)
    turns = {"a": 90.0, "b": 180.0, "c": 0.0}
    found = []
    for rolled in (False, True):
        degrees = turns if rolled else dict.fromkeys(turns, 0.0)
        one, views = stage(rig(**degrees), **values), []
        sizes.append([])
        for k in range(14):
            places = PLACES + (1.5 * k + 0.37, 0.23)  # no border of a region lies between two pixels
            if k >= 9:  # a stranger
                places = np.concatenate([places, PLACES[:1] + (130.0, 60.0)])
            for name in turns:
                turn = turn_by(-degrees[name], (256, 192))
                image = picture(places) if degrees[name] == 0.0 else turn.image(picture(places), 0)
                (view,) = one.step(frame(image, name, k)).outputs
                views.append((turn, view))
            one.step(known(places[:2], SECOND + k * PERIOD, k))
        found.append(views)
    assert sizes[0] == sizes[1]
    for (_, upright), (turn, rolled) in zip(*found, strict=True):
        np.testing.assert_allclose(rolled.points, turn.pixels(upright.points), atol=1e-6)
        np.testing.assert_array_equal(rolled.scores, upright.scores)
        assert (rolled.carried is None) == (upright.carried is None)


# ---------------------------------------------------------------- which cameras, and what is said


def ring(*degrees, spread=90.0):
    return Rig(tuple(camera(f"cam{i}", turn, spread * i) for i, turn in enumerate(degrees)))


def in_world(given, world, up):
    """Move a rig to a world whose coordinates are world (3, 3) @ ours."""
    poses = [c.cam_from_world for c in given.cameras]
    cameras = [
        replace(c, cam_from_world=Rigid(pose.rotation @ world.T, pose.translation))
        for c, pose in zip(given.cameras, poses)
    ]
    return Rig(tuple(cameras), up=up)


Y_DOWN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # of the world with z up


def test_cameras_are_turned_one_by_one():
    rolls = rolls_of(ring(0.0, 90.0, 180.0, -90.0))
    assert {name: angle % 360.0 for name, angle in rolls.degrees.items()} == {
        "cam1": 90.0,
        "cam2": 180.0,
        "cam3": 270.0,
    }
    assert rolls.notice.code == "detection.turned" and rolls.notice.severity == "info"
    assert "cam1 by 90 degrees counter-clockwise" in rolls.notice.text and "cam0" not in rolls.notice.text
    assert rolls_of(ring(85.0, -82.0, 12.0)).degrees == {"cam0": 90.0, "cam1": -90.0}
    assert rolls_of(ring(45.0, -75.0)).degrees == pytest.approx({"cam0": 45.0, "cam1": -75.0})


@pytest.mark.parametrize("turn", [90.0, 180.0, -90.0, 45.0, 60.0])
@pytest.mark.parametrize("count", [2, 3, 4])
@pytest.mark.parametrize("spread", [0.0, 25.0, 60.0, 90.0])
def test_rigs_of_which_all_cameras_are_rolled_are_turned(turn, count, spread):
    assert len(rolls_of(ring(*[turn] * count, spread=spread)).degrees) == count


def test_an_upright_rig_says_nothing():
    assert rolls_of(ring(0.0, 5.0, -9.0)) == rolls_of(Rig(()))
    assert rolls_of(ring(0.0, 0.0)).notice is None


def test_where_up_is_not_stated_nothing_is_turned_and_a_command_is_named():
    rolls = rolls_of(replace(ring(0.0, 90.0), up=None))
    assert not rolls.degrees and rolls.notice.severity == "warning"
    assert "panoptic rig check" in rolls.notice.text and "cam1" in rolls.notice.text
    assert "cam0" not in rolls.notice.text
    assert rolls_of(ring(0.0, 90.0), NOT_KNOWN).notice == rolls.notice
    upright = rolls_of(replace(ring(0.0, 0.0), up=None)).notice
    assert upright.severity == "info" and "panoptic rig check" in upright.text and "cam" not in upright.text
    assert rolls_of(replace(ring(0.0, 90.0), up=None), (0.0, 0.0, 1.0)).degrees == {"cam1": 90.0}


def test_another_up_direction_counts():
    up = tuple(Y_DOWN @ (0.0, 0.0, 1.0))
    assert rolls_of(in_world(ring(0.0, 0.0, 0.0), Y_DOWN, up)).notice is None
    assert rolls_of(in_world(ring(0.0, 90.0, 0.0), Y_DOWN, up)).degrees == pytest.approx({"cam1": 90.0})


def test_a_rig_whose_up_is_surely_another_is_left_alone_and_said():
    """Images that are upright along y are not turned by a z that is not a vertical."""
    rolls = rolls_of(in_world(ring(0.0, 0.0, 0.0, 0.0), Y_DOWN, (0.0, 0.0, 1.0)))
    assert not rolls.degrees and rolls.notice.severity == "warning"
    assert "along -y" in rolls.notice.text and "panoptic rig check" in rolls.notice.text


@pytest.mark.parametrize("up", [(1.0,), (0.0, np.nan, 1.0)])
def test_an_up_that_is_none_is_refused(up):
    with pytest.raises(ConfigError, match="DetectionConfig.up"):
        rolls_of(ring(0.0), up)


def test_the_stage_tells_once_what_it_turns():
    one = stage(rig(a=90.0, b=0.0))
    image = np.zeros((256, 192, 3), np.uint8)
    codes = [note.code for k in range(3) for note in one.step(frame(image, "a", k)).notices]
    assert codes == ["detection.turned"]
    one.reset()
    assert [note.code for note in one.step(frame(image, "a")).notices] == ["detection.turned"]


# ---------------------------------------------------------------- the default detector


def rolled(given, degrees):
    """Turn a camera clockwise about the middle of its image."""
    turn = turn_by(-degrees, given.image_size)
    matrix = given.intrinsics.matrix.copy()
    if degrees % 180.0:
        matrix[[0, 1], [0, 1]] = matrix[[1, 0], [1, 0]]
    matrix[:2, 2] = turn.pixels(matrix[:2, 2])
    pose, about = given.cam_from_world, np.eye(3)
    about[:2, :2] = turning(-degrees)
    k1, k2, p1, p2, k3 = given.intrinsics.distortion
    p2, p1 = turning(-degrees) @ (p2, p1)  # tangential terms turn as a vector
    return replace(
        given,
        image_size=turn.size,
        intrinsics=Intrinsics(matrix, [k1, k2, p1, p2, k3]),
        cam_from_world=Rigid(about @ pose.rotation, about @ pose.translation),
    )


def test_the_default_detector_finds_people_in_rolled_cameras_as_in_upright_ones():
    """Quarter turns: the same people, with the same scores; any other angle: about as exactly."""
    from panoptic_ros.errors import BackendError
    from panoptic_ros.io.detector_context import detector_extras
    from panoptic_ros.simulation import SCENES, simulate
    from panoptic_ros.simulation.rendering import Studio

    try:
        skeleton, extras = detector_extras("movenet-multipose", "panoptic19")
    except BackendError as error:
        pytest.skip(str(error))
    take = simulate(SCENES["rendered-4p6v"], 1, 1)
    names, joints = take.rig.names[:3], np.stack([p.joints(np.zeros(1))[0] for p in take.people])

    def drawn(cameras):
        studio = Studio(replace(take, rig=cameras))
        return {name: next(studio.camera(name).render(np.zeros(1))).image for name in names}

    def found(cameras, images):
        one = DetectionStage(DetectionConfig(), StageContext(cameras, skeleton, extras))
        for k in range(4):  # the size of the input follows the people
            views = {name: one.step(frame(images[name], name, k)).outputs[0] for name in names}
        return views

    def errors(cameras, views):
        """Pixels between joints of a person and those of the 2D person who shows him, of all cameras."""
        gaps = []
        for name in names:
            for pixels in cameras.camera(name).project(joints)[0]:
                distances = np.linalg.norm(views[name].points - pixels, axis=-1)
                gaps.append(distances[np.nanmedian(distances, axis=1).argmin()])
        return np.concatenate(gaps)

    def turned(*degrees):
        return Rig(tuple(rolled(take.rig.camera(name), turn) for name, turn in zip(names, degrees)))

    upright = turned(0.0, 0.0, 0.0)
    images = drawn(upright)
    plain = found(upright, images)
    for turns in ((90.0, 180.0, -90.0), (0.0, 180.0, 0.0)):
        ways = {name: turn_by(-turn, plain[name].image_size) for name, turn in zip(names, turns)}
        quarters = {name: way.image(images[name], 0) for name, way in ways.items() if way.degrees}
        for name, view in found(turned(*turns), images | quarters).items():
            np.testing.assert_allclose(view.points, ways[name].pixels(plain[name].points), atol=1e-6)
            np.testing.assert_array_equal(view.scores, plain[name].scores)
            assert view.maps.data.tobytes() == plain[name].maps.data.tobytes()
    at_angles = turned(35.0, -50.0, 140.0)
    gaps, level = errors(at_angles, found(at_angles, drawn(at_angles))), errors(upright, plain)
    assert np.nanmedian(gaps) < np.nanmedian(level) + 0.5
    assert np.isfinite(gaps).mean() > np.isfinite(level).mean() - 0.05
