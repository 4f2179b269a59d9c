"""The usual mistakes of a calibration, each as a change that would undo it.

`suspects` lists for a rig what may have been mixed up; applying a suspect to rig and views gives
those that would be right if the suspicion holds. Whether it does, the meeting rays tell (`rig_check`).
"""
from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import Camera, Rig, SkeletonModel, ViewDetections
from panoptic_ros.geometry import Intrinsics, Rigid

Array = np.ndarray
Instant = Mapping[str, ViewDetections]
Instants = list[Instant]
SCALES = (0.25, 0.5, 2.0 / 3.0, 0.75, 4.0 / 3.0, 1.5, 2.0, 4.0)
ALL_ORDERS = 4  # suspicious cameras whose every order is tried
ALL_TRIPLES = 8  # and of which every three are tried in turn; of more only two


@dataclass(frozen=True)
class Suspect:
    """One possible mistake.

    Args:
        code: of the notice.
        cameras: whose residuals it would change.
        text: what is wrong, with the cameras' names.
        undo: rig and views without the mistake.
    """

    code: str
    cameras: tuple[str, ...]
    text: str
    undo: Callable[[Rig, Instants], tuple[Rig, Instants]]


def suspects(
    rig: Rig, bad: tuple[str, ...], mirror: tuple[int, ...]
) -> Iterator[list[Suspect]]:
    """What may be wrong, given the cameras that do not agree with the others; the simplest first.

    Args:
        mirror: `SkeletonModel.mirror`.
    """
    names = rig.names
    everywhere = [Suspect(code, names, f"all cameras {what.format(s='')}", _change(names, undo))
                  for code, what, undo in _POSES]  # fmt: skip
    for scale in SCALES:
        text = f"the intrinsics of all cameras look like those of images {_size(scale)}"
        everywhere.append(Suspect("rig.image_size", names, text, _change(names, _scaled(scale))))
    yield everywhere
    yield [suspect for name in bad for suspect in _of_one_camera(name, mirror)]
    yield list(_orders(bad))


def _of_one_camera(name: str, mirror: tuple[int, ...]) -> Iterator[Suspect]:
    for code, what, undo in _POSES:
        yield Suspect(code, (name,), f"camera {name} {what.format(s='s')}", _change((name,), undo))
    for scale in SCALES:
        text = f"the intrinsics of camera {name} look like those of images {_size(scale)}"
        yield Suspect("rig.image_size", (name,), text, _change((name,), _scaled(scale)))
    for what, turn in _turns(mirror):
        text = f"the images of camera {name} look {what}"
        yield Suspect("rig.image_turned", (name,), text, _turn_views(name, turn))


def _size(scale: float) -> str:
    return f"{1 / scale:.3g} times as large" if scale < 1.0 else f"{scale:.3g} times smaller"


# --- poses


def _inverse(camera: Camera) -> Camera:
    return replace(camera, cam_from_world=camera.cam_from_world.inverse())


def _from_centre(camera: Camera) -> Camera:
    rotation, centre = camera.cam_from_world.rotation, camera.cam_from_world.translation
    return replace(camera, cam_from_world=Rigid(rotation, -rotation @ centre))


def _transposed(camera: Camera) -> Camera:
    pose = camera.cam_from_world
    return replace(camera, cam_from_world=Rigid(pose.rotation.T, pose.translation))


_POSES: tuple[tuple[str, str, Callable[[Camera], Camera]], ...] = (
    ("rig.pose_inverted", "seem{s} to have R and t of world_from_cam instead of cam_from_world", _inverse),
    ("rig.pose_centre", "seem{s} to have the camera's position in place of t (-R times it)", _from_centre),
    ("rig.pose_transposed", "seem{s} to have R transposed", _transposed),
)


def _change(
    names: tuple[str, ...], undo: Callable[[Camera], Camera]
) -> Callable[[Rig, Instants], tuple[Rig, Instants]]:
    def apply(rig: Rig, instants: Instants) -> tuple[Rig, Instants]:
        cameras = tuple(undo(item) if item.name in names else item for item in rig.cameras)
        return replace(rig, cameras=cameras), instants

    return apply


# --- images


def _scaled(scale: float) -> Callable[[Camera], Camera]:
    def apply(camera: Camera) -> Camera:
        return replace(camera, intrinsics=scaled_intrinsics(camera.intrinsics, scale))

    return apply


def scaled_intrinsics(intrinsics: Intrinsics, scale: float) -> Intrinsics:
    """The intrinsics for images resized by `scale`; the corner of the image stays at -0.5, -0.5."""
    matrix = intrinsics.matrix.copy()
    matrix[:2] *= scale
    matrix[:2, 2] += 0.5 * (scale - 1.0)
    return replace(intrinsics, matrix=matrix)


Turn = Callable[[ViewDetections], ViewDetections]


def _turns(mirror: tuple[int, ...]) -> list[tuple[str, Turn]]:
    def turned(view: ViewDetections, x: Array, y: Array, swap: bool) -> ViewDetections:
        size = view.image_size[::-1] if swap else view.image_size
        return replace(view, points=np.stack([x, y], -1), image_size=size, maps=None)

    def upside_down(view: ViewDetections) -> ViewDetections:
        width, height = view.image_size
        return turned(view, width - 1 - view.points[..., 0], height - 1 - view.points[..., 1], False)

    def mirrored(view: ViewDetections) -> ViewDetections:
        other = list(mirror)  # a mirrored left hand is taken for a right one
        points, scores = view.points[:, other], view.scores[:, other]
        x = view.image_size[0] - 1 - points[..., 0]
        return replace(view, points=np.stack([x, points[..., 1]], -1), scores=scores, maps=None)

    def clockwise(view: ViewDetections) -> ViewDetections:
        return turned(view, view.points[..., 1], view.image_size[0] - 1 - view.points[..., 0], True)

    def anticlockwise(view: ViewDetections) -> ViewDetections:
        return turned(view, view.image_size[1] - 1 - view.points[..., 1], view.points[..., 0], True)

    return [
        ("upside down against its calibration", upside_down),
        ("mirrored left to right", mirrored),
        ("turned clockwise by 90 degrees (portrait and landscape)", clockwise),
        ("turned anticlockwise by 90 degrees (portrait and landscape)", anticlockwise),
    ]


def _turn_views(name: str, turn: Turn) -> Callable[[Rig, Instants], tuple[Rig, Instants]]:
    def apply(rig: Rig, instants: Instants) -> tuple[Rig, Instants]:
        def turned(instant: Instant) -> Instant:
            return {key: turn(view) if key == name else view for key, view in instant.items()}

        return rig, [turned(instant) for instant in instants]

    return apply


# --- who is who


def _orders(bad: tuple[str, ...]) -> Iterator[Suspect]:
    """Exchanges of two cameras; also other orders, if the suspects are few."""
    for a, b in itertools.combinations(bad, 2):
        text = f"cameras {a} and {b} look exchanged"
        yield Suspect("rig.exchanged", (a, b), text, _reorder({a: b, b: a}))
    for moved in _longer_orders(bad):
        turns = ", ".join(f"{source} is really {name}" for name, source in moved.items())
        text = f"cameras look mixed up: {turns}"
        yield Suspect("rig.exchanged", tuple(moved), text, _reorder(moved))


def _longer_orders(bad: tuple[str, ...]) -> Iterator[dict[str, str]]:
    """Orders that move three cameras or more, as {name: where its views are}."""
    if len(bad) <= ALL_ORDERS:
        for order in itertools.permutations(bad):
            moved = {name: other for name, other in zip(bad, order) if name != other}
            if len(moved) > 2:
                yield moved
    elif len(bad) <= ALL_TRIPLES:
        for a, b, c in itertools.combinations(bad, 3):
            yield {a: b, b: c, c: a}
            yield {a: c, c: b, b: a}


def _reorder(source: Mapping[str, str]) -> Callable[[Rig, Instants], tuple[Rig, Instants]]:
    """Camera `name` gets the views that are called source[name]; the views themselves stay as they are."""

    def apply(rig: Rig, instants: Instants) -> tuple[Rig, Instants]:
        origins = {name: source.get(name, name) for name in rig.names}
        return rig, [
            {name: instant[origin] for name, origin in origins.items() if origin in instant}
            for instant in instants
        ]

    return apply


def joints_above_and_below(skeleton: SkeletonModel) -> tuple[list[int], list[int]]:
    """Joints of the head and of the hips: their difference points up in whoever stands or sits."""
    hips = [i for i, name in enumerate(skeleton.joint_names) if "hip" in name.lower()]
    return [skeleton.head], hips or [skeleton.root]
