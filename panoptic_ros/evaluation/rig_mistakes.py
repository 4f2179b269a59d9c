"""Usual mistakes of a calibration, each as a change that undoes it.

`suspects` lists the possible mistakes of a rig. Applying a suspect to rig and views returns the corrected
ones, if the suspicion is true. `rig_check` tests this by the distances of the rays.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import Camera, Rig, ViewDetections
from panoptic_ros.geometry import Intrinsics, Rigid

Array = np.ndarray
Instant = Mapping[str, ViewDetections]
Instants = list[Instant]
SCALES = (0.25, 0.5, 2.0 / 3.0, 0.75, 4.0 / 3.0, 1.5, 2.0, 4.0)
ALL_ORDERS = 4  # largest number of suspicious cameras for which every order is tried
# largest number of suspicious cameras for which cyclic exchanges of three are tried; beyond it, only pairs
ALL_TRIPLES = 8


@dataclass(frozen=True)
class RigMistake:
    """One possible mistake.

    Args:
        code: Code of the notice.
        cameras: Cameras whose residuals the mistake affects.
        text: Description of the mistake, with the cameras' names.
        undo: Function that returns rig and views without the mistake.
    """

    code: str
    cameras: tuple[str, ...]
    text: str
    undo: Callable[[Rig, Instants], tuple[Rig, Instants]]


def suspects(rig: Rig, bad: tuple[str, ...], mirror: tuple[int, ...]) -> Iterator[list[RigMistake]]:
    """Yield groups of possible mistakes, the simplest first, given the cameras that disagree with the others.

    Args:
        bad: Cameras that disagree.
        mirror: See `SkeletonModel.mirror`.
    """
    names = rig.names
    everywhere = [
        RigMistake(code, names, f"all cameras {what.format(s='')}", _change(names, undo))
        for code, what, undo in _POSES
    ]
    for scale in SCALES:
        text = f"the intrinsics of all cameras look like those of images {_size(scale)}"
        everywhere.append(RigMistake("rig.image_size", names, text, _change(names, _scaled(scale))))
    if all(could_be_reordered(camera.intrinsics) for camera in rig.cameras):
        text = f"the distortion of all cameras {_REORDERED}"
        everywhere.append(RigMistake("rig.distortion_order", names, text, _change(names, in_our_order)))
    if 2 * len(bad) > len(names):  # a mistake of all cameras leaves few that agree
        yield everywhere
    yield [suspect for name in bad for suspect in _of_one_camera(rig.camera(name), mirror)]
    yield list(_orders(rig, bad))
    others = [name for name in names if name not in bad]  # these may agree by chance
    yield [suspect for pair in itertools.product(bad, others) for suspect in _exchanges(rig, *pair)]


def _of_one_camera(camera: Camera, mirror: tuple[int, ...]) -> Iterator[RigMistake]:
    name = camera.name
    for code, what, undo in _POSES:
        yield RigMistake(code, (name,), f"camera {name} {what.format(s='s')}", _change((name,), undo))
    if could_be_reordered(camera.intrinsics):
        text = f"the distortion of camera {name} {_REORDERED}"
        yield RigMistake("rig.distortion_order", (name,), text, _change((name,), in_our_order))
    for scale in SCALES:
        text = f"the intrinsics of camera {name} look like those of images {_size(scale)}"
        yield RigMistake("rig.image_size", (name,), text, _change((name,), _scaled(scale)))
    for what, turn in _turns(mirror):
        text = f"the images of camera {name} look {what}"
        yield RigMistake("rig.image_turned", (name,), text, _turn_views(name, turn))


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
    ("rig.pose_centre", "seem{s} to have the camera's position instead of t (-R times it)", _from_centre),
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

_REORDERED = "looks like k1 k2 k3 p1 p2, where k1 k2 p1 p2 k3 is expected"


def could_be_reordered(intrinsics: Intrinsics) -> bool:
    """Return whether a lens has the five terms of Brown's model, and the last three are not all equal."""
    terms = intrinsics.distortion
    return intrinsics.lens == "brown" and len(terms) >= 5 and not terms[5:].any() and len(set(terms[2:5])) > 1


def in_our_order(camera: Camera) -> Camera:
    """Return the camera with terms k1 k2 k3 p1 p2, read as k1 k2 p1 p2 k3, put into the expected order."""
    terms = camera.intrinsics.distortion.copy()
    terms[2:5] = terms[[3, 4, 2]]
    intrinsics = replace(camera.intrinsics, distortion=terms)
    return replace(camera, intrinsics=intrinsics, covariance=None)


def _scaled(scale: float) -> Callable[[Camera], Camera]:
    def apply(camera: Camera) -> Camera:
        return replace(camera, intrinsics=scaled_intrinsics(camera.intrinsics, scale))

    return apply


def scaled_intrinsics(intrinsics: Intrinsics, scale: float) -> Intrinsics:
    """Return the intrinsics for images resized by `scale`; the image corner stays at -0.5, -0.5."""
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
        other = list(mirror)  # a detector labels a mirrored left hand as a right hand
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


# --- exchanged cameras


Order = Mapping[str, str]  # camera -> camera under whose name its own views, intrinsics or pose are stored
Undo = Callable[[Rig, Instants], tuple[Rig, Instants]]


def _orders(rig: Rig, bad: tuple[str, ...]) -> Iterator[RigMistake]:
    """Yield exchanges of two cameras, or of their intrinsics or poses.

    With few suspects, it also yields longer permutations.
    """
    for pair in itertools.combinations(bad, 2):
        yield from _exchanges(rig, *pair)
    for moved in _longer_orders(bad):
        for kind in _KINDS if len(bad) <= ALL_ORDERS else _KINDS[:1]:
            if kind.could_be(rig, tuple(moved)):
                turns = ", ".join(f"{source} is really {name}" for name, source in moved.items())
                yield RigMistake("rig.exchanged", tuple(moved), f"{kind.several}: {turns}", kind.undo(moved))


def _exchanges(rig: Rig, *pair: str) -> Iterator[RigMistake]:
    """Yield exchanges of two cameras, of their intrinsics and of their poses."""
    a, b = sorted(pair, key=rig.index)
    for kind in _KINDS:
        if kind.could_be(rig, pair):
            text = kind.pair.format(a=a, b=b)
            yield RigMistake("rig.exchanged", (a, b), text, kind.undo({a: b, b: a}))


def _longer_orders(bad: tuple[str, ...]) -> Iterator[dict[str, str]]:
    """Yield permutations that move three or more cameras, as {name: source of its views}."""
    if len(bad) <= ALL_ORDERS:
        for order in itertools.permutations(bad):
            moved = {name: other for name, other in zip(bad, order) if name != other}
            if len(moved) > 2:
                yield moved
    elif len(bad) <= ALL_TRIPLES:
        for a, b, c in itertools.combinations(bad, 3):
            yield {a: b, b: c, c: a}
            yield {a: c, c: b, b: a}


def _views_of(source: Order) -> Undo:
    """Return a change that gives camera `name` the views of source[name].

    The views themselves stay unchanged.
    """

    def apply(rig: Rig, instants: Instants) -> tuple[Rig, Instants]:
        origins = {name: source.get(name, name) for name in rig.names}
        return rig, [
            {name: instant[origin] for name, origin in origins.items() if origin in instant}
            for instant in instants
        ]

    return apply


def _fields_of(field: str) -> Callable[[Order], Undo]:
    """Return a function that builds the change giving camera `name` a field of the camera source[name]."""

    def undo(source: Order) -> Undo:
        def apply(rig: Rig, instants: Instants) -> tuple[Rig, Instants]:
            cameras = tuple(
                replace(item, covariance=None, **{field: getattr(rig.camera(source[item.name]), field)})
                if item.name in source
                else item
                for item in rig.cameras
            )
            return replace(rig, cameras=cameras), instants

        return apply

    return undo


def _any(rig: Rig, names: Sequence[str]) -> bool:
    return True


def _differ_within_a_size(rig: Rig, names: Sequence[str]) -> bool:
    """Return whether cameras have one image size and one kind of lens, but different intrinsics."""
    cameras = [rig.camera(name) for name in names]
    first = cameras[0]
    return all(
        other.image_size == first.image_size
        and other.intrinsics.lens == first.intrinsics.lens
        and not np.array_equal(other.intrinsics.matrix, first.intrinsics.matrix)
        for other in cameras[1:]
    )


@dataclass(frozen=True)
class _ExchangeKind:
    """Kind of exchange.

    Args:
        pair: Message text for two cameras.
        several: Message text for several cameras.
        undo: Function that builds the change undoing an exchange.
        could_be: Test whether the exchange is possible between given cameras.
    """

    pair: str
    several: str
    undo: Callable[[Order], Undo]
    could_be: Callable[[Rig, Sequence[str]], bool] = _any


_KINDS = (  # if two kinds explain the same views, the first is reported
    _ExchangeKind("cameras {a} and {b} look exchanged", "cameras look mixed up", _views_of),
    _ExchangeKind(
        "the intrinsics of cameras {a} and {b} look exchanged",
        "the intrinsics of cameras look mixed up",
        _fields_of("intrinsics"),
        _differ_within_a_size,
    ),
    _ExchangeKind(
        "the poses of cameras {a} and {b} look exchanged",
        "the poses of cameras look mixed up",
        _fields_of("cam_from_world"),
    ),
)
