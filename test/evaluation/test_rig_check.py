"""Rigs broken on purpose: each mistake is named, and a right rig is left in peace."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from panoptic_ros.domain import Camera, DetectionSet, Rig, SkeletonModel, ViewDetections
from panoptic_ros.evaluation.rig_check import RigReport, check_rig
from panoptic_ros.evaluation.rig_mistakes import scaled_intrinsics
from panoptic_ros.geometry import Intrinsics, Rigid

Array = np.ndarray
# x forward, y left, z up, m
BODY: dict[str, tuple[float, float, float]] = {
    "pelvis": (0.0, 0.0, 0.95),
    "neck": (0.0, 0.0, 1.45),
    "nose": (0.1, 0.0, 1.58),
    "left_shoulder": (0.0, 0.18, 1.43),
    "left_elbow": (0.05, 0.22, 1.15),
    "left_wrist": (0.2, 0.22, 0.95),
    "left_hip": (0.0, 0.1, 0.95),
    "left_knee": (0.05, 0.1, 0.5),
    "left_ankle": (0.0, 0.1, 0.08),
    "right_shoulder": (0.0, -0.18, 1.43),
    "right_elbow": (0.0, -0.25, 1.15),
    "right_wrist": (0.1, -0.3, 0.92),
    "right_hip": (0.0, -0.1, 0.95),
    "right_knee": (0.0, -0.1, 0.5),
    "right_ankle": (-0.1, -0.1, 0.08),
}
NAMES = tuple(BODY)
LEFT = [name for name in NAMES if name.startswith("left")]
SIDES = tuple((NAMES.index(name), NAMES.index(name.replace("left", "right"))) for name in LEFT)
SKELETON = SkeletonModel("stick", NAMES, 0, tuple((0, i) for i in range(1, len(NAMES))), 2, SIDES)


def ring(count: int, size: tuple[int, int] = (1920, 1080)) -> Rig:
    """Cameras on a circle of 4 m, at different heights, looking at the middle."""
    rng = np.random.default_rng(count)
    cameras = []
    for i in range(count):
        angle = 2 * np.pi * (i + rng.uniform(0.1, 0.5)) / count
        centre = np.array([4 * np.cos(angle), 4 * np.sin(angle), rng.uniform(1.8, 2.8)])
        forward = np.array([0.0, 0.0, 1.0]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        focal = 0.75 * max(size)
        matrix = np.array([[focal, 0, size[0] / 2 + 5], [0, focal, size[1] / 2 - 4], [0, 0, 1]])
        lens = Intrinsics(matrix, np.array([-0.05, 0.02]))
        cameras.append(Camera(f"cam{i:02d}", size, lens, Rigid(rotation, -rotation @ centre)))
    return Rig(tuple(cameras))


def walkers(people: int, instants: int = 10) -> list[Array]:
    """(P, J, 3) m per instant: people who sway about, turn, and are of different heights."""
    rng = np.random.default_rng(people)
    place, yaw = rng.uniform(-1.2, 1.2, (people, 2)), rng.uniform(0.0, 6.0, people)
    result = []
    for _ in range(instants):
        place = np.clip(place + rng.normal(0, 0.1, place.shape), -1.3, 1.3)
        yaw = yaw + rng.normal(0, 0.1, people)
        turns = Rotation.from_rotvec(yaw[:, None] * [0.0, 0.0, 1.0]).as_matrix()
        bodies = np.array(list(BODY.values())) + rng.normal(0, 0.03, (people, len(NAMES), 3))
        heights = np.linspace(0.9, 1.1, people)[:, None, None]
        floor = np.concatenate([place, np.zeros((people, 1))], axis=1)[:, None]
        result.append(heights * np.einsum("pij,pkj->pki", turns, bodies) + floor)
    return result


def detect(
    rig: Rig,
    people: Sequence[Array],
    noise: float = 0.0,
    misfit: float = 0.0,
    ghosts: float = 0.0,
    misses: float = 0.0,
) -> list[DetectionSet]:
    """What a detector would say: shuffled people, noise, a constant shift per camera, ghosts, misses."""
    rng = np.random.default_rng(1)
    angles = rng.uniform(0, 2 * np.pi, len(rig))
    shifts = misfit * np.stack([np.cos(angles), np.sin(angles)], -1)
    sets = []
    for index, points in enumerate(people):
        views = []
        for camera, shift in zip(rig.cameras, shifts):
            pixels, seen = camera.project(points)[0], camera.sees(points)
            pixels = pixels + shift + noise * rng.standard_normal(pixels.shape)
            kept = [i for i in rng.permutation(len(points)) if rng.random() >= misses]
            found, scores = pixels[kept], np.where(seen[kept], 0.8, 0.0)
            count = rng.poisson(ghosts)
            places = rng.uniform((0, 0), camera.image_size, (count, 1, 2))
            found = np.concatenate([found, places + rng.normal(0, 60, (count, len(NAMES), 2))])
            scores = np.concatenate([scores, np.full((count, len(NAMES)), 0.5)])
            found = np.where(scores[..., None] > 0, found, np.nan)
            views.append(
                ViewDetections(
                    camera.name,
                    index,
                    index,
                    camera.image_size,
                    SKELETON.hash,
                    found,
                    scores,
                    np.full(len(found), 0.8),
                )
            )
        sets.append(DetectionSet(index, index, SKELETON.hash, tuple(views)))
    return sets


def with_views(
    sets: Sequence[DetectionSet], change: Callable[[ViewDetections], ViewDetections]
) -> list[DetectionSet]:
    return [replace(item, views=tuple(change(view) for view in item.views)) for item in sets]


def renamed(sets: Sequence[DetectionSet], names: dict[str, str]) -> list[DetectionSet]:
    return with_views(sets, lambda view: replace(view, camera=names.get(view.camera, view.camera)))


def with_cameras(rig: Rig, names: Sequence[str] | None, **change: Callable[[Camera], Any]) -> Rig:
    """Some cameras (None: all) with fields replaced."""
    cameras = []
    for camera in rig.cameras:
        if names is None or camera.name in names:
            camera = replace(camera, **{key: make(camera) for key, make in change.items()})
        cameras.append(camera)
    return Rig(tuple(cameras))


def check(rig: Rig, sets: Sequence[DetectionSet]) -> RigReport:
    return check_rig(rig, sets, SKELETON)


def only_warning(report: RigReport) -> tuple[str, str]:
    assert len(report.warnings) == 1, [note.text for note in report.notices]
    return report.warnings[0].code, report.warnings[0].text


NOISY = {"noise": 4.0, "misfit": 4.0, "ghosts": 0.4, "misses": 0.1}
HARD = {"noise": 10.0, "misfit": 12.0, "ghosts": 0.7, "misses": 0.15}
CASES = [(2, 2), (3, 1), (5, 3)]
cases = pytest.mark.parametrize(("cameras", "people"), CASES)


@cases
@pytest.mark.parametrize("faults", [{}, {"noise": 10.0, "misfit": 12.0}, HARD])
def test_a_right_rig_gives_no_warning(cameras: int, people: int, faults: dict[str, float]) -> None:
    rig = ring(cameras)
    report = check(rig, detect(rig, walkers(people), **faults))
    assert report.notices == ()
    assert all(fit.residual_px < 12.0 and fit.people > 5 for fit in report.cameras)


def test_residuals_are_those_of_the_noise() -> None:
    rig = ring(4)
    exact = check(rig, detect(rig, walkers(2)))
    assert all(fit.residual_px < 1e-6 for fit in exact.cameras)
    shifted = check(rig, detect(rig, walkers(2), misfit=12.0))
    assert all(0.5 < fit.residual_px < 12.0 for fit in shifted.cameras)


@cases
@pytest.mark.parametrize(
    ("scale", "unit"), [(1e3, "millimetres"), (100.0, "centimetres"), (3.281, "feet"), (1e-3, "kilometres")]
)
def test_wrong_unit_is_named(cameras: int, people: int, scale: float, unit: str) -> None:
    rig = ring(cameras)
    wrong = with_cameras(
        rig,
        None,
        cam_from_world=lambda c: Rigid(c.cam_from_world.rotation, scale * c.cam_from_world.translation),
    )
    report = check(wrong, detect(rig, walkers(people), **NOISY))
    texts = [note.text for note in report.warnings]
    assert {note.code for note in report.warnings} == {"rig.units"}
    assert any(f"lengths look like {unit}" in text for text in texts), texts


def test_wrong_unit_is_suspected_without_people() -> None:
    wrong = with_cameras(
        ring(3),
        None,
        cam_from_world=lambda c: Rigid(c.cam_from_world.rotation, 1000.0 * c.cam_from_world.translation),
    )
    code, text = only_warning(check(wrong, []))
    assert code == "rig.units" and "m apart" in text


def inverted(camera: Camera) -> Rigid:
    return camera.cam_from_world.inverse()


def centre_as_translation(camera: Camera) -> Rigid:
    return Rigid(camera.cam_from_world.rotation, camera.centre)


def transposed(camera: Camera) -> Rigid:
    return Rigid(camera.cam_from_world.rotation.T, camera.cam_from_world.translation)


@cases
@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        (inverted, "rig.pose_inverted"),
        (centre_as_translation, "rig.pose_centre"),
        (transposed, "rig.pose_transposed"),
    ],
)
def test_mistaken_poses_of_all_cameras(
    cameras: int, people: int, wrong: Callable[[Camera], Rigid], code: str
) -> None:
    rig = ring(cameras)
    report = check(with_cameras(rig, None, cam_from_world=wrong), detect(rig, walkers(people), **NOISY))
    found, text = only_warning(report)
    assert found == code and text.startswith("all cameras seem to have")


@pytest.mark.parametrize(("cameras", "people"), CASES[1:])
def test_one_inverted_camera(cameras: int, people: int) -> None:
    rig = ring(cameras)
    wrong = with_cameras(rig, ["cam01"], cam_from_world=inverted)
    code, text = only_warning(check(wrong, detect(rig, walkers(people), **NOISY)))
    assert code == "rig.pose_inverted"
    assert text.startswith("camera cam01 seems to have R and t of world_from_cam")


@cases
def test_exchanged_cameras(cameras: int, people: int) -> None:
    rig = ring(cameras)
    sets = renamed(detect(rig, walkers(people), **NOISY), {"cam00": "cam01", "cam01": "cam00"})
    code, text = only_warning(check(rig, sets))
    assert code == "rig.exchanged"
    assert text.startswith("cameras cam00 and cam01 look exchanged: the rays of people miss each other by")


def test_three_cameras_mixed_up() -> None:
    rig = ring(5)
    order = {"cam00": "cam01", "cam01": "cam03", "cam03": "cam00"}  # what cam00 saw is called cam01
    sets = renamed(detect(rig, walkers(3), **NOISY), order)
    code, text = only_warning(check(rig, sets))
    assert code == "rig.exchanged" and "cam01 is really cam00" in text and "cam00 is really cam03" in text


def test_two_mistakes_at_once() -> None:
    rig = ring(5)
    wrong = with_cameras(rig, ["cam04"], cam_from_world=inverted)
    sets = renamed(detect(rig, walkers(3), **NOISY), {"cam00": "cam01", "cam01": "cam00"})
    assert {note.code for note in check(wrong, sets).warnings} == {"rig.exchanged", "rig.pose_inverted"}


@cases
def test_intrinsics_of_images_of_half_the_size(cameras: int, people: int) -> None:
    rig = ring(cameras)
    wrong = with_cameras(rig, ["cam01"], intrinsics=lambda c: scaled_intrinsics(c.intrinsics, 0.5))
    report = check(wrong, detect(rig, walkers(people), **NOISY))
    assert {note.code for note in report.warnings} == {"rig.image_size"}
    assert any("camera cam01 look like those of images 2 times smaller" in n.text for n in report.warnings)


@cases
def test_smaller_images_than_the_rig_says(cameras: int, people: int) -> None:
    small, large = ring(cameras, (960, 540)), ring(cameras)
    code, text = {(n.code, n.text) for n in check(large, detect(small, walkers(people))).warnings}.pop()
    assert code == "rig.image_size" and "have 960 x 540 px, but the rig states 1920 x 1080" in text
    assert "0.5 times the size" in text


def turn_clockwise(view: ViewDetections) -> ViewDetections:
    width, height = view.image_size
    points = np.stack([height - 1 - view.points[..., 1], view.points[..., 0]], -1)
    return replace(view, points=points, image_size=(height, width))


def mirror(view: ViewDetections) -> ViewDetections:
    other = list(SKELETON.mirror)
    points = view.points[:, other]
    points = np.stack([view.image_size[0] - 1 - points[..., 0], points[..., 1]], -1)
    return replace(view, points=points, scores=view.scores[:, other])


def upside_down(view: ViewDetections) -> ViewDetections:
    return turn_clockwise(turn_clockwise(view))


@cases
@pytest.mark.parametrize(
    ("turn", "says"),
    [(turn_clockwise, "turned clockwise by 90 degrees"), (mirror, "mirrored"), (upside_down, "upside down")],
)
def test_turned_images(
    cameras: int, people: int, turn: Callable[[ViewDetections], ViewDetections], says: str
) -> None:
    rig = ring(cameras)
    sets = with_views(
        detect(rig, walkers(people), **NOISY), lambda view: turn(view) if view.camera == "cam01" else view
    )
    code, text = only_warning(check(rig, sets))
    assert code == "rig.image_turned" and "camera cam01" in text and says in text


@cases
def test_y_down_and_tilted_worlds(cameras: int, people: int) -> None:
    rig = ring(cameras)
    sets = detect(rig, walkers(people), **NOISY)

    def world(turn: Array) -> Rig:
        return with_cameras(
            rig,
            None,
            cam_from_world=lambda c: Rigid(c.cam_from_world.rotation @ turn.T, c.cam_from_world.translation),
        )

    y_down = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # new y = -old z
    code, text = only_warning(check(world(y_down), sets))
    assert code == "rig.up" and text.startswith("people stand along -y")
    assert only_warning(check(world(y_down), []))[1].startswith("the cameras are upright only along -y")
    tilted = Rotation.from_euler("x", 70, degrees=True).as_matrix()
    code, text = only_warning(check(world(tilted), sets))
    assert code == "rig.up" and ("floor of this rig is not level" in text or "stand along" in text)


@pytest.mark.parametrize(("cameras", "people"), CASES[1:])
def test_a_camera_that_was_pushed_is_named_but_not_explained(cameras: int, people: int) -> None:
    rig = ring(cameras)
    push = Rotation.from_rotvec([0.14, 0.0, 0.05]).as_matrix()
    wrong = with_cameras(
        rig,
        ["cam01"],
        cam_from_world=lambda c: Rigid(push @ c.cam_from_world.rotation, push @ c.cam_from_world.translation),
    )
    code, text = only_warning(check(wrong, detect(rig, walkers(people), **NOISY)))
    assert code == "rig.disagrees" and text.startswith("camera cam01 does not agree with the others")


@pytest.mark.parametrize(
    ("matrix", "code", "says"),
    [
        ([[4.2, 0, 960], [0, 4.2, 540], [0, 0, 1]], "rig.intrinsics", "of 179 degrees; is it in mm"),
        ([[1400, 0, 540], [0, 1400, 960], [0, 0, 1]], "rig.image_size", "portrait and landscape"),
        ([[2800, 0, 1920], [0, 2800, 1080], [0, 0, 1]], "rig.image_size", "images 2 times as large"),
        ([[1400, 0, 0], [0, 1400, 0], [0, 0, 1]], "rig.image_size", "far from the middle"),
    ],
)
def test_numbers_that_no_camera_has(matrix: list[list[float]], code: str, says: str) -> None:
    lens = Intrinsics(np.array(matrix), np.zeros(5))
    found, text = only_warning(check(with_cameras(ring(3), ["cam01"], intrinsics=lambda c: lens), []))
    assert found == code and says in text


def test_fields_of_view_of_fisheyes_are_those_of_fisheyes() -> None:
    def told(focal: float) -> tuple[str, ...]:
        lens = Intrinsics(np.array([[focal, 0, 960], [0, focal, 540], [0, 0, 1]]), np.zeros(4), "fisheye")
        rig = with_cameras(ring(3), ["cam01"], intrinsics=lambda c: lens)
        return tuple(note.text for note in check(rig, []).warnings)

    assert told(1920 / np.pi) == ()  # 180 degrees
    assert len(told(400.0)) == 1 and "of 275 degrees" in told(400.0)[0]


def test_nobody_and_missing_views() -> None:
    rig = ring(3)
    (note,) = check(rig, []).notices
    assert note.severity == "info" and "without 2D people" in note.text
    (note,) = check(rig, detect(rig, [np.zeros((0, len(NAMES), 3))] * 5)).notices
    assert note.severity == "info" and "too few people" in note.text
    sets = detect(rig, walkers(2))
    sparse = [replace(item, views=item.views[i % 3 :]) for i, item in enumerate(sets)]
    assert check(rig, sparse).warnings == ()


def test_many_cameras_are_checked_in_a_sparse_way() -> None:
    rig = ring(31)
    report = check(rig, detect(rig, walkers(2, 4), **NOISY))
    assert report.notices == () and all(fit.people > 10 for fit in report.cameras)


# --- noise, exchanged numbers, lenses


def varied(count: int, size: tuple[int, int] = (1920, 1080), seed: int = 0) -> Rig:
    """A ring whose cameras have lenses of their own: focal lengths of 0.6 to 1.1 widths, Brown distortion."""
    rng = np.random.default_rng([count, seed])
    focals = size[0] * np.linspace(0.6, 1.1, count)[rng.permutation(count)]
    cameras = []
    for camera, focal in zip(ring(count, size).cameras, focals):
        middle = np.array(size) / 2 + rng.normal(0.0, 0.01 * size[0], 2)
        matrix = np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1]])
        k1, k2, k3 = rng.uniform(-0.1, 0.1, 3) * (1.0, 0.5, 0.1)
        lens = Intrinsics(matrix, np.array([k1, k2, *rng.normal(0.0, 5e-4, 2), k3]))
        cameras.append(replace(camera, intrinsics=lens))
    return Rig(tuple(cameras))


def exchanged(rig: Rig, a: str, b: str, field: str) -> Rig:
    other = {a: rig.camera(b), b: rig.camera(a)}
    return with_cameras(rig, [a, b], **{field: lambda c: getattr(other[c.name], field)})


def most_different(rig: Rig) -> tuple[str, str]:
    """The cameras with the shortest and the longest focal length."""
    ordered = sorted(rig.cameras, key=lambda camera: float(camera.intrinsics.matrix[0, 0]))
    a, b = sorted((ordered[0].name, ordered[-1].name))
    return a, b


NOISES = (0.3, 1.0, 3.0, 6.0)  # px
RIGS = ((3, 1, 0.3), (3, 1, 6.0), (5, 3, 1.0), (8, 2, 0.3), (8, 2, 6.0), (12, 4, 3.0))  # cameras, people, px


@pytest.mark.parametrize(("cameras", "people", "noise"), RIGS)
def test_exchanged_intrinsics_are_named(cameras: int, people: int, noise: float) -> None:
    rig = varied(cameras)
    a, b = most_different(rig)
    sets = detect(rig, walkers(people), noise=noise, misses=0.1)
    code, text = only_warning(check(exchanged(rig, a, b, "intrinsics"), sets))
    assert code == "rig.exchanged"
    assert text.startswith(f"the intrinsics of cameras {a} and {b} look exchanged")


@pytest.mark.parametrize(("cameras", "people", "noise"), RIGS)
def test_exchanged_poses_are_named(cameras: int, people: int, noise: float) -> None:
    rig = varied(cameras)
    a, b = most_different(rig)
    sets = detect(rig, walkers(people), noise=noise, misses=0.1)
    code, text = only_warning(check(exchanged(rig, a, b, "cam_from_world"), sets))
    assert code == "rig.exchanged" and text.startswith(f"the poses of cameras {a} and {b} look exchanged")


def test_cameras_with_equal_lenses_are_exchanged_as_a_whole() -> None:
    rig = ring(5)
    sets = detect(rig, walkers(3), noise=1.0)
    code, text = only_warning(check(exchanged(rig, "cam01", "cam03", "cam_from_world"), sets))
    assert code == "rig.exchanged" and text.startswith("cameras cam01 and cam03 look exchanged")


def test_rays_that_miss_by_far_more_than_the_noise_do_not_agree() -> None:
    rig = varied(5)
    wide = with_cameras(
        rig,
        ["cam02"],
        intrinsics=lambda c: Intrinsics(
            np.diag([1.06, 1.06, 1.0]) @ c.intrinsics.matrix, c.intrinsics.distortion
        ),
    )
    for noise, warned in ((1.0, True), (15.0, False)):
        report = check(wide, detect(rig, walkers(3), noise=noise))
        assert bool(report.warnings) == warned, [note.text for note in report.notices]
        near = [fit.noise_px for fit in report.cameras]
        assert all(0.4 * noise < px < 1.2 * noise for px in near), near  # a half of the square of two views
    (note,) = check(wide, detect(rig, walkers(3), noise=1.0)).warnings
    assert note.code == "rig.disagrees" and "camera cam02 does not agree" in note.text
    assert "where the noise of 2D people explains" in note.text


@pytest.mark.parametrize(("noise", "seed"), list(zip(NOISES, (0, 1, 2, 0))))
@pytest.mark.parametrize(("cameras", "people"), [(2, 1), (2, 3), (4, 1), (6, 4), (16, 2)])
def test_right_rigs_of_many_kinds_give_no_warning(cameras: int, people: int, noise: float, seed: int) -> None:
    size = ((1920, 1080), (640, 480), (3840, 2160))[seed]
    rig = varied(cameras, size, seed)
    noise = noise * size[0] / 1920
    sets = detect(rig, walkers(people), noise=noise, misfit=0.5 * noise, misses=0.3, ghosts=0.3)
    assert [note.text for note in check(rig, sets).warnings] == []


def test_cut_people_give_no_warning() -> None:
    """Joints beyond the border are put inside with low scores, as networks do with people who are cut."""
    left = np.array([[0, 0, 410.0], [0, 0, 0], [0, 0, 0]])
    cut = with_cameras(
        varied(5),
        None,
        image_size=lambda c: (1100, 1080),
        intrinsics=lambda c: Intrinsics(c.intrinsics.matrix - left, c.intrinsics.distortion),
    )
    rng, sets = np.random.default_rng(0), []
    for index, points in enumerate(walkers(4)):
        views = []
        for camera in cut.cameras:
            pixels = camera.project(points)[0] + rng.normal(0.0, 3.0, (*points.shape[:2], 2))
            inside = camera.contains(pixels)
            kept = inside.mean(1) > 0.3
            squeezed = np.clip(pixels, 30.0, np.array(camera.image_size) - 30.0)
            pixels, scores = np.where(inside[..., None], pixels, squeezed), np.where(inside, 0.8, 0.25)
            views.append(
                ViewDetections(
                    camera.name,
                    index,
                    index,
                    camera.image_size,
                    SKELETON.hash,
                    pixels[kept],
                    scores[kept],
                    np.full(kept.sum(), 0.8),
                )
            )
        sets.append(DetectionSet(index, index, SKELETON.hash, tuple(views)))
    assert [note.text for note in check(cut, sets).warnings] == []


def test_a_world_with_y_down_is_all_that_is_told_of_one() -> None:
    rig = varied(5)
    y_down = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    turned = with_cameras(
        rig,
        None,
        cam_from_world=lambda c: Rigid(c.cam_from_world.rotation @ y_down.T, c.cam_from_world.translation),
    )
    code, text = only_warning(check(turned, detect(rig, walkers(3), noise=1.0)))
    assert code == "rig.up" and "`panoptic rig convert IN OUT --up=-y`" in text


@pytest.mark.parametrize("late_ms", [8, 16])
def test_images_between_those_of_other_cameras_agree(late_ms: int) -> None:
    """Cameras without a common trigger see people who walk at 1.3 m/s at other places."""
    rig = ring(4)
    late = {camera.name: late_ms * 1_000_000 * (k % 2) for k, camera in enumerate(rig.cameras)}
    paths = [points + [1.3 * 0.04 * k - 0.3, 0.0, 0.0] for k, points in enumerate(walkers(2, 12))]
    views = {
        ns: detect(rig, [points + [1.3e-9 * ns, 0.0, 0.0] for points in paths], noise=1.0)
        for ns in set(late.values())
    }
    sets = []
    for k in range(len(paths)):
        own = [
            replace(view, stamp_ns=40_000_000 * k + late[view.camera])
            for ns in views
            for view in views[ns][k].views
            if late[view.camera] == ns
        ]
        sets.append(DetectionSet(k, 40_000_000 * k, SKELETON.hash, tuple(own)))
    assert [note.text for note in check(rig, sets).warnings] == []


def reordered(camera: Camera) -> Intrinsics:
    """Terms k1 k2 p1 p2 k3 written as k1 k2 k3 p1 p2."""
    k1, k2, p1, p2, k3 = camera.intrinsics.distortion
    return Intrinsics(camera.intrinsics.matrix, np.array([k1, k2, k3, p1, p2]))


@pytest.mark.parametrize("names", [["cam01"], None])
def test_distortion_in_another_order_is_named(names: list[str] | None) -> None:
    strong = Intrinsics(
        np.array([[1000.0, 0, 960], [0, 1000.0, 540], [0, 0, 1]]), np.array([-0.2, 0.1, 1e-3, -5e-4, -0.03])
    )
    rig = with_cameras(ring(4), None, intrinsics=lambda c: strong)
    wrong = with_cameras(rig, names, intrinsics=reordered)
    sets = detect(rig, walkers(4, 12), noise=0.5)
    for report in (check(wrong, sets), check(wrong, [])):
        assert {note.code for note in report.warnings} == {"rig.distortion_order"}
        assert all("looks like k1 k2 k3 p1 p2" in note.text for note in report.warnings)
    (note,) = check(wrong, sets).warnings
    assert ("all cameras" if names is None else "camera cam01") in note.text
    assert check(rig, sets).warnings == () == check(rig, []).warnings


@pytest.mark.parametrize(
    "terms", [(0.28, -1.25, 6.46, 0.0, 7e-4), (-0.3, 0.1, -0.05, 1e-3, 2e-4), (0.1, -0.2, 0.08, 0.0, -1e-3)]
)
def test_terms_that_no_lens_has_are_warned_of_without_people(terms: tuple[float, ...]) -> None:
    lens = Intrinsics(np.array([[512.0, 0, 320], [0, 512.0, 240], [0, 0, 1]]), np.array(terms))
    rig = with_cameras(ring(3, (640, 480)), ["cam01"], intrinsics=lambda c: lens)
    code, text = only_warning(check(rig, []))
    assert code == "rig.distortion_order" and text.startswith("camera cam01: the tangential terms (p1 = ")


@pytest.mark.parametrize(
    "terms", [(-0.3, 0.12, 2e-3, -1e-3, -0.02), (0.1, -0.5, 8e-3, 5e-3, 0.9), (-0.28, 0.07, 6e-3, 4e-4, 0.0)]
)
def test_usual_lenses_are_left_in_peace(terms: tuple[float, ...]) -> None:
    lens = Intrinsics(np.array([[1400.0, 0, 960], [0, 1400.0, 540], [0, 0, 1]]), np.array(terms))
    assert check(with_cameras(ring(3), None, intrinsics=lambda c: lens), []).warnings == ()


def test_a_decentred_lens_whose_terms_fit_the_other_order_worse_is_left_in_peace() -> None:
    terms = np.array([0.17, -0.25, -7.5e-4, 0.0125, 0.156])  # a webcam, as its program calibrated it
    lens = Intrinsics(np.array([[637.0, 0, 657], [0, 634.0, 378], [0, 0, 1]]), terms)
    assert check(with_cameras(ring(3, (1280, 720)), None, intrinsics=lambda c: lens), []).warnings == ()


def test_two_cameras_at_one_pose() -> None:
    rig = ring(5)
    pose = rig.camera("cam03").cam_from_world
    nudged = Rigid(pose.rotation, pose.translation + 1e-4)
    copied = with_cameras(rig, ["cam01"], cam_from_world=lambda c: nudged)
    code, text = only_warning(check(copied, []))
    assert code == "rig.same_pose" and text.startswith("cameras cam01 and cam03 have one and the same pose")
    report = check(copied, detect(rig, walkers(3), noise=1.0))
    assert "rig.same_pose" in {note.code for note in report.warnings}
    beside = Rigid(pose.rotation, pose.translation + np.array([0.06, 0.0, 0.0]))  # a stereo head
    assert check(with_cameras(rig, ["cam01"], cam_from_world=lambda c: beside), []).warnings == ()
    turned = Rotation.from_rotvec([0.0, 0.3, 0.0]).as_matrix()  # two cameras on one stand
    other = Rigid(turned @ pose.rotation, turned @ pose.translation)
    assert check(with_cameras(rig, ["cam01"], cam_from_world=lambda c: other), []).warnings == ()


@pytest.mark.parametrize("noise", [0.5, 4.0])
def test_cameras_in_rooms_of_their_own_give_no_warning(noise: float) -> None:
    rig = ring(9)
    rooms = [detect(rig, walkers(people), noise=noise) for people in (2, 3, 4)]
    sets = []
    for together in zip(*rooms):
        views = tuple(together[k % 3].views[k] for k in range(len(rig)))
        sets.append(replace(together[0], views=views))
    assert check(rig, sets).warnings == ()
    pushed = with_cameras(rig, ["cam04"], cam_from_world=inverted)
    assert check(pushed, detect(rig, walkers(3), noise=noise)).warnings != ()


@pytest.mark.parametrize(("factor", "wrong"), [(1.0, False), (0.97, False), (1.2, True), (0.8, True)])
def test_statures_tell_a_wrong_scale(factor: float, wrong: bool) -> None:
    rig = ring(4)
    sets = detect(rig, walkers(4, 12), noise=0.5)
    scaled = with_cameras(
        rig,
        None,
        cam_from_world=lambda c: Rigid(c.cam_from_world.rotation, factor * c.cam_from_world.translation),
    )
    report = check(scaled, sets)
    found = [note for note in report.notices if note.code == "rig.scale"]
    assert not report.warnings  # children and short recordings give the same figures
    assert len(found) == wrong
    assert all(note.values["factor"] == pytest.approx(1.0 / factor, rel=0.08) for note in found)
