"""Up direction of a rig's world, estimated from the posture of people or, without people, from cameras."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain import Rig, SkeletonModel
from panoptic_ros.evaluation.rig_frame import moved_rig
from panoptic_ros.geometry import Rigid
from panoptic_ros.stage import Notice

Array = np.ndarray
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
AGREED = 0.6  # smallest length of the cameras' mean up vector for which they agree
ALIKE = np.cos(np.radians(30.0))  # cosine of the largest angle between the directions of two upright people
AGREEING = 0.5  # share of people whose directions must be alike
MOST = 1000  # largest number of directions that are compared
LEVEL = np.cos(np.radians(45.0))  # cosine of the largest angle between up and the world's z
# cosine of the largest angle at which up is treated as an axis, since people lean by this much on average
ON_AXIS = np.cos(np.radians(8.0))
# cosine of the largest angle between thigh and shin, and between legs and trunk, of a standing person
STRAIGHT = np.cos(np.radians(30.0))
FEWEST_STANDING = 3


def directions_of_people(points: Array, skeleton: SkeletonModel) -> Array:
    """Return unit vectors (N, 3) along the bodies of people.

    They point from the ankles to the shoulders of standing people if there are enough, else along the trunk.

    Args:
        points: Joints (M, J, 3) of people in the rig's world; NaN = missing.

    Returns:
        Directions (N, 3) of the people for whom it is defined.
    """
    names = [name.lower() for name in skeleton.joint_names]

    def middle(word: str) -> Array:
        own = [points[:, k] for k, name in enumerate(names) if word in name]
        return np.mean(own, axis=0) if own else np.full((len(points), 3), np.nan)

    hips, top = middle("hip"), middle("shoulder")
    hips = np.where(np.isfinite(hips), hips, points[:, skeleton.root])
    top = np.where(np.isfinite(top), top, points[:, skeleton.head])
    knees, ankles = middle("knee"), middle("ankle")
    shins, thighs, trunks = _unit(knees - ankles), _unit(hips - knees), _unit(top - hips)
    with np.errstate(invalid="ignore"):
        stands = ((shins * thighs).sum(-1) > STRAIGHT) & ((_unit(hips - ankles) * trunks).sum(-1) > STRAIGHT)
    found = _unit(top - ankles)[stands] if stands.sum() >= FEWEST_STANDING else trunks
    known: Array = found[np.isfinite(found).all(-1)]
    return known


def up_of(directions: Array) -> Array | None:
    """Return the common direction (3,) of unit vectors (N, 3); None if fewer than half of them agree."""
    if not len(directions):
        return None
    alike = directions[:MOST] @ directions[:MOST].T > ALIKE
    best = alike[int(alike.sum(1).argmax())]
    if best.mean() < AGREEING:
        return None
    mean = directions[:MOST][best].mean(axis=0)
    up: Array = mean / np.linalg.norm(mean)
    return up


def up_of_cameras(rig: Rig) -> Array | None:
    """Return the mean up vector (3,) of the images; None if it is short, as for rotated cameras."""
    up = np.array([-camera.cam_from_world.rotation[1] for camera in rig.cameras]).reshape(-1, 3).mean(axis=0)
    length = float(np.linalg.norm(up))
    return None if length < AGREED else up / length


def check_up(rig: Rig, people: Array) -> list[Notice]:
    """Return a notice if up is not +z, with the command that rotates the rig.

    Args:
        people: Directions (N, 3), see `directions_of_people`. Without any, the cameras determine up.
    """
    by_people = len(people) > 0
    up = up_of(people) if by_people else up_of_cameras(rig)
    if up is None or up[2] > LEVEL:
        return []
    if not by_people and rig.up is not None and float(np.dot(up, rig.up)) < -LEVEL:
        text = (
            "the cameras are upside down, as this rig states up, and detection turns their images; if people "
            f"stand upright in them, `panoptic rig convert IN OUT --up={word_of(up)}` turns the rig"
        )
        return [Notice("rig.up", "info", text, {"up": up.tolist()})]
    whose = "people stand along" if by_people else "the cameras are upright only along"
    name, near = nearest_axis(up)
    where = name if near > ON_AXIS else f"({', '.join(f'{value:.2f}' for value in up)})"
    text = (
        f"{whose} {where}: the world of this rig does not have z up; "
        f"`panoptic rig convert IN OUT --up={word_of(up)}` turns it"
    )
    return [Notice("rig.up", "warning", text, {"up": up.tolist()})]


def assumed_up(rig: Rig) -> list[str]:
    """Return a line if the rig does not state its up direction."""
    if rig.up is not None or not rig.cameras:
        return []
    return [
        "+z is assumed to be up, as the rig does not state it; "
        "`panoptic rig check RIG --detections FILE` finds it from people"
    ]


def nearest_axis(up: Array) -> tuple[str, float]:
    """Return the axis nearest to a direction (3,), e.g. "-y", and the cosine of their angle."""
    k = int(np.argmax(np.abs(up)))
    return "+-"[int(up[k] < 0.0)] + "xyz"[k], float(abs(up[k]))


def word_of(up: Array) -> str:
    """Return a direction (3,) as text that `direction_of` reads: an axis name if it is close to one."""
    name, near = nearest_axis(up)
    return name.removeprefix("+") if near > ON_AXIS else ",".join(f"{value:.3f}" for value in up)


def direction_of(word: str) -> Array | None:
    """Return the unit vector (3,) of x, -y, ... or of three comma-separated numbers; None for other text."""
    axis = AXES.get(word.lstrip("+-"))
    if axis is not None and len(word.lstrip("+-")) >= len(word) - 1:
        return (-1.0 if word.startswith("-") else 1.0) * np.array(axis)
    try:
        values = np.array([float(part) for part in word.split(",")])
    except ValueError:
        return None
    length = float(np.linalg.norm(values))
    return values / length if values.shape == (3,) and np.isfinite(length) and length > 0.0 else None


def turned_up(rig: Rig, up: Sequence[float] | Array) -> Rig:
    """Return the rig in a world rotated the shortest way so that `up` (3,) of the old world becomes +z."""
    from scipy.spatial.transform import Rotation  # takes long to load, and most runs do not need it

    z = np.array(AXES["z"])
    axis, cosine = np.cross(up, z), float(np.dot(up, z))
    sine = float(np.linalg.norm(axis))
    axis = axis / sine if sine > 1e-12 else np.array(AXES["x"])
    new_from_old = Rotation.from_rotvec(np.arctan2(sine, cosine) * axis).as_matrix()

    return moved_rig(rig, Rigid(new_from_old, np.zeros(3)))


def _unit(vectors: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        unit: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit
