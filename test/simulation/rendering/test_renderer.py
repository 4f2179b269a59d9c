"""Rendered takes: pictures, depth and ids fit the exact truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.domain import Camera, ViewFrame, VisibilityLimit
from panoptic_ros.errors import BackendError
from panoptic_ros.geometry import Intrinsics
from panoptic_ros.simulation import SCENES, Lens, Ring, simulate
from panoptic_ros.simulation.rendering import RenderedView, Studio
from panoptic_ros.simulation.rendering.renderer import pixel_plane, shape_boxes
from panoptic_ros.simulation.rendering.room import RenderedRoom

SMALL = Lens((160, 120), (106.0, 110.0), distorted_every=2)  # every second camera
SCENE = replace(SCENES["rendered-4p6v"], rig=Ring(2, radius=3.9, heights=(1.2, 2.6), lens=SMALL))
TIMES = np.array([0.0, 0.4, 0.8])


def visible_joints(view: RenderedView, camera: Camera, joints: np.ndarray, slack: float = 0.16) -> np.ndarray:
    """Which joints (P, J, 3) m of the take's people are visible, (P, J).

    The joint's pixel belongs to its person, and the surface there is at most `slack` m in front of
    the joint, which lies inside of the limb.
    """
    pixels, seen = camera.project(joints)
    seen = seen & camera.contains(pixels)
    height, width = view.depth.shape
    columns = np.clip(np.rint(np.nan_to_num(pixels[..., 0])), 0, width - 1).astype(int)
    rows = np.clip(np.rint(np.nan_to_num(pixels[..., 1])), 0, height - 1).astype(int)
    own = view.people[rows, columns] == np.arange(1, len(joints) + 1)[:, None]
    depth = camera.cam_from_world.apply(joints)[..., 2]
    visible: np.ndarray = seen & own & (view.depth[rows, columns] > depth - slack)
    return visible


@pytest.fixture(scope="module")
def take():
    return simulate(SCENE, 0, 3)


def views(take, name="cam00", times=TIMES):
    return list(Studio(take).camera(name).render(times))


def test_the_same_seed_gives_the_same_pictures(take):
    first, second = views(take), views(simulate(SCENE, 0, 3))
    for a, b in zip(first, second):
        assert (a.image == b.image).all() and (a.depth == b.depth).all() and (a.people == b.people).all()
    assert (first[0].image != views(simulate(SCENE, 1, 3))[0].image).mean() > 0.5


def test_a_view_does_not_depend_on_those_rendered_before(take):
    alone = views(take, times=TIMES[1:2])[0]
    assert (alone.image == views(take)[1].image).all()


@pytest.mark.parametrize("name", ["cam00", "cam01"])
def test_people_are_drawn_round_their_joints(take, name):
    camera = take.rig.camera(name)
    shown = []
    for time, view in zip(TIMES, views(take, name)):
        joints = np.stack([person.joints(np.array([time]))[0] for person in take.people])
        visible = visible_joints(view, camera, joints)
        shown.append(visible.mean())
        pixels = np.rint(camera.project(joints)[0][visible]).astype(int)
        surface = view.depth[pixels[:, 1], pixels[:, 0]]
        depth = camera.cam_from_world.apply(joints)[..., 2][visible]
        assert (surface < depth + 0.10).all(), "the skin is in front of the joint"
        rows, columns = np.nonzero(view.people)
        place = camera.centre + view.depth[rows, columns, None] * rays_of(camera)[rows, columns]
        for number in range(len(take.people)):
            own = place[view.people[rows, columns] == number + 1]
            if len(own):
                gaps = np.linalg.norm(own[:, None] - joints[number][None], axis=-1).min(1)
                assert gaps.max() < 0.35, "a pixel far from its person"
    assert np.mean(shown) > 0.35


def rays_of(camera):
    plane = pixel_plane(camera)
    rays = np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)
    return rays @ camera.cam_from_world.rotation


def test_the_room_is_where_its_walls_are(take):
    camera = take.rig.camera("cam01")
    room = RenderedRoom.draw(np.random.default_rng(0), take.rig)
    backdrop = room.seen_by(camera, pixel_plane(camera))
    points = camera.centre + backdrop.depth[..., None] * rays_of(camera)
    gaps = np.stack([np.abs(points[..., wall.axis] - wall.value) for wall in room.walls])
    assert gaps.min(axis=0).max() < 1e-4
    floor = np.abs(points[..., 2]) < 1e-4
    assert backdrop.floor[floor] == pytest.approx(points[floor][:, :2], abs=1e-4)
    assert (np.abs(points[..., :2]) < room.half + 1e-4).all()


def fisheyes(take, focal):
    """The take through fisheyes of another focal length (relative to the cameras')."""
    cameras = []
    for camera in take.rig.cameras:
        matrix = camera.intrinsics.matrix * np.array([[focal, 1, 1], [1, focal, 1], [1, 1, 1]])
        lens = Intrinsics(matrix, [0.02, -0.01, 3e-3, -1e-3], "fisheye")
        cameras.append(replace(camera, intrinsics=lens))
    return replace(take, rig=replace(take.rig, cameras=tuple(cameras)))


def test_a_fisheye_shows_every_surface_where_it_is(take):
    wide = fisheyes(take, 0.4)
    camera = wide.rig.camera("cam00")
    plane = pixel_plane(camera)
    blind = np.isnan(plane[..., 0])
    (view,) = views(wide, times=TIMES[:1])
    assert 0 < blind.sum() < 0.4 * blind.size  # the corners, beyond 90 degrees
    assert np.isinf(view.depth[blind]).all() and not view.people[blind].any()
    assert np.median(view.image[blind]) < 5 < 50 < np.median(view.image[~blind])
    points = camera.centre + view.depth[~blind][:, None] * rays_of(camera)[~blind]
    pixels, seen = camera.project(points)
    rows, columns = np.nonzero(~blind)
    assert seen.all() and np.abs(pixels - np.stack([columns, rows], -1)).max() < 1e-2
    person = view.people[~blind] == 1
    joints = wide.people[0].joints(TIMES[:1])[0]
    gaps = np.linalg.norm(points[person][:, None] - joints[None], axis=-1).min(1)
    assert len(gaps) > 20 and gaps.max() < 0.35


@pytest.mark.parametrize("focal", [None, 1.0, 0.4])
def test_boxes_hold_all_that_a_shape_covers(take, focal):
    take = take if focal is None else fisheyes(take, focal)
    studio = Studio(take)
    for name in take.rig.names:
        renderer = studio.camera(name)
        shapes, _ = renderer._shapes(TIMES[:1])
        everyone = np.ones(len(take.people), bool)
        _, hits = renderer._cast(shapes, 0, everyone)
        boxes = shape_boxes(renderer.camera, shapes, 0)
        width, height = renderer.camera.image_size
        full = np.tile([0, 0, width, height], (len(boxes), 1))
        full[(boxes == 0).all(1)] = 0
        depth, wanted = renderer._backdrop.depth.copy(), np.full(hits.shape, -1, np.int16)
        renderer._cast_into(shapes, 0, full, depth, wanted)
        assert (hits == wanted).all()


def test_absent_people_are_not_drawn(take):
    gone = replace(take.people[1], present=(10.0, 20.0))
    alone = replace(take, people=(take.people[0], gone, *take.people[2:]))
    there, absent = views(take)[0], views(alone)[0]
    assert (there.people == 2).any() and not (absent.people == 2).any()


def test_the_default_detector_finds_rendered_people():
    from panoptic_ros.detection.config import DetectionConfig
    from panoptic_ros.detection.stage import DetectionStage
    from panoptic_ros.io.detector_context import detector_extras
    from panoptic_ros.stage import StageContext

    try:
        skeleton, extras = detector_extras("movenet-multipose", "panoptic19")
    except BackendError as error:
        pytest.skip(str(error))
    take = simulate(SCENES["rendered-4p6v"], 1, 1)
    context = StageContext(rig=take.rig, skeleton=skeleton, extras=extras)
    stage = DetectionStage(DetectionConfig(maps=False, person_threshold=0.2), context)
    found, wanted, gaps = 0, 0, []
    for name in take.rig.names[:3]:
        camera = take.rig.camera(name)
        view = next(Studio(take).camera(name).render(np.zeros(1)))
        joints = np.stack([person.joints(np.zeros(1))[0] for person in take.people])
        visible = visible_joints(view, camera, joints)
        people = stage.step(ViewFrame(name, 0, 0, view.image)).outputs[0].points
        for pixels, shows in zip(camera.project(joints)[0], visible):
            if shows.sum() < 12:
                continue
            errors = np.linalg.norm(people - pixels, axis=-1)[:, shows]
            best = errors[np.nanmedian(errors, axis=1).argmin()]
            wanted, found = wanted + 1, found + (np.nanmedian(best) < 10.0)
            gaps.append(best)
    assert wanted >= 6 and found >= 0.85 * wanted
    assert np.nanmedian(np.concatenate(gaps)) < 4.0


def test_the_depth_of_a_view_limits_it_to_what_it_shows():
    """A joint is beyond the limit if somebody else is drawn over it, and hardly any other is."""
    take = simulate(replace(SCENE, area=1.2, rig=replace(SCENE.rig, cameras=4)), 2, 1)
    shown, covered = [], []
    for camera in take.rig.cameras:
        view = views(take, camera.name, TIMES[:1])[0]
        limit = VisibilityLimit.of_depths(view.depth, 0.4)
        joints = np.stack([person.joints(TIMES[:1])[0] for person in take.people])
        pixels, ahead = camera.project(joints)
        inside = ahead & camera.contains(pixels)
        depths = camera.cam_from_world.apply(joints)[..., 2]
        seen = limit.sees(np.where(inside[..., None], pixels, 0.0), depths, camera.image_size)
        column, row = np.clip(np.rint(np.where(inside[..., None], pixels, 0.0)), 0, [159, 119]).astype(int).T
        drawn = view.people[row, column].T
        own = np.arange(1, len(take.people) + 1)[:, None]
        far = depths > view.depth[row, column].T + 0.5
        shown += seen[inside & (drawn == own)].tolist()
        covered += seen[inside & (drawn != own) & (drawn > 0) & far].tolist()
    assert len(shown) > 100 and np.mean(shown) > 0.95
    assert len(covered) > 5 and np.mean(covered) < 0.25
