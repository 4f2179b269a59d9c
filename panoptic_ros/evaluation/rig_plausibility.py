"""Plausibility checks of a rig: its numbers, the sizes of the images, and the size of people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from panoptic_ros.domain import Camera, Rig, SkeletonModel, ViewDetections
from panoptic_ros.domain.bone_shares import (
    STATURE_M,
    STATURE_SD_M,
    bones_of,
    log_scale,
)
from panoptic_ros.evaluation.rig_mistakes import could_be_reordered, in_our_order
from panoptic_ros.stage import Notice

Array = np.ndarray
UNITS = {"feet": 3.281, "inches": 39.37, "centimetres": 100.0, "millimetres": 1000.0, "kilometres": 0.001}
# m; usual largest distance between two joints of a person, who may be half hidden or sitting
USUAL_EXTENT = 1.4
POSSIBLE_EXTENT = (0.5, 3.0)  # m; plausible range of this distance
FAR_APART = 200.0  # m; largest plausible span of a rig
# largest shift of an image corner by tangential terms, as a share of its radius; poor lenses reach 0.01
MOST_TANGENTIAL = 0.03
# share of the rig's span; closer cameras are treated as one pose, since even stereo heads are wider
ONE_PLACE = 1e-3
BONES_SD = 0.08  # relative, of the mean scale by bones: real detectors are off by 0.01 to 0.15
CERTAIN = 2.0  # standard deviations of a scale that is reported
ONE_DIRECTION = np.radians(0.5)  # rad; closer rotations are treated as one pose, too


def implausible_cameras(rig: Rig) -> list[Notice]:
    """Return notices on values that no real camera has."""
    found = [note for camera in rig.cameras for note in (_view_angle(camera), _principal_point(camera))]
    notices = [note for note in found if note] + _reordered(rig)
    centres = np.stack([camera.centre for camera in rig.cameras])
    span = float(np.ptp(centres, axis=0).max())
    if span > FAR_APART:
        text = f"the cameras lie {span:.0f} m apart: the unit of length is probably mm or cm, not m"
        notices.append(Notice("rig.units", "warning", text, {"span_m": span}))
    if len(rig) > 1 and span < 1e-3:
        text = "all cameras are at the same place: the poses are missing, or in km"
        notices.append(Notice("rig.units", "warning", text, {"span_m": span}))
    elif len(rig) > 1:
        notices += _at_one_pose(rig, ONE_PLACE * span)
    return notices


def _at_one_pose(rig: Rig, near: float) -> list[Notice]:
    """Return notices on cameras with equal orientation and centres within `near`, in the unit of the rig."""
    groups: list[list[Camera]] = []
    for camera in rig.cameras:
        group = next((own for own in groups if _is_alike(own[0], camera, near)), None)
        if group is None:
            groups.append([camera])
        else:
            group.append(camera)
    notices = []
    for group in groups:
        if len(group) > 1:
            names = [camera.name for camera in group]
            text = (
                f"cameras {', '.join(names[:-1])} and {names[-1]} have one and the same pose: one was "
                "probably copied; calibrate it, or leave it out with --cameras"
            )
            notices.append(Notice("rig.same_pose", "warning", text, {"cameras": names}))
    return notices


def _is_alike(a: Camera, b: Camera, near: float) -> bool:
    turn = a.cam_from_world.rotation @ b.cam_from_world.rotation.T
    angle = np.arccos(np.clip(0.5 * (np.trace(turn) - 1.0), -1.0, 1.0))
    return bool(np.linalg.norm(a.centre - b.centre) <= near and angle <= ONE_DIRECTION)


def _view_angle(camera: Camera) -> Notice | None:
    focal = camera.intrinsics.matrix[0, 0]
    fisheye = camera.intrinsics.lens == "fisheye"
    half = 0.5 * camera.image_size[0] / focal  # half angle in rad for a fisheye lens
    angle = float(np.degrees(2.0 * (half if fisheye else np.arctan(half))))
    if 5.0 <= angle <= (230.0 if fisheye else 150.0):
        return None
    text = (
        f"camera {camera.name}: a focal length of {focal:.4g} px with {camera.image_size[0]} px of width "
        f"is a field of view of {angle:.3g} degrees; is it in mm, or for images of another size?"
    )
    return Notice("rig.intrinsics", "warning", text, {"cameras": [camera.name], "degrees": angle})


def _reordered(rig: Rig) -> list[Notice]:
    """Return a notice if the tangential terms shift points by more than lenses do.

    Radial terms stored in the place of tangential ones cause such shifts. The other order of terms must shift
    points less, else it does not explain them better.
    """
    shares = [(_tangential_share(camera), camera) for camera in rig.cameras]
    odd = [
        camera
        for share, camera in shares
        if share > MOST_TANGENTIAL and _tangential_share(in_our_order(camera)) < share
    ]
    if not odd:
        return []
    names, (p1, p2) = [camera.name for camera in odd], odd[0].intrinsics.distortion[2:4]
    which = "all cameras" if len(odd) == len(rig) > 1 else f"camera{'s' * (len(odd) > 1)} {', '.join(names)}"
    text = (
        f"{which}: the tangential terms (p1 = {p1:.4g}, p2 = {p2:.4g} of {names[0]}) are larger than those "
        "of lenses; the distortion looks like k1 k2 k3 p1 p2, where k1 k2 p1 p2 k3 is expected"
    )
    return [Notice("rig.distortion_order", "warning", text, {"cameras": names})]


def _tangential_share(camera: Camera) -> float:
    """Return the largest shift of an image corner by tangential terms, as a share of its radius."""
    lens = camera.intrinsics
    if not could_be_reordered(lens):
        return 0.0
    corner = 0.5 * np.array(camera.image_size) / np.diag(lens.matrix)[:2]
    return float(3.0 * np.hypot(*lens.distortion[2:4]) * np.linalg.norm(corner))  # see brown.distort


def _principal_point(camera: Camera) -> Notice | None:
    width, height = camera.image_size
    cx, cy = camera.intrinsics.matrix[:2, 2]
    across, down = cx / (0.5 * width), cy / (0.5 * height)
    if max(abs(across - 1.0), abs(down - 1.0)) <= 0.5:
        return None
    why = "is it for images of another size?"
    if abs(across / max(down, 1e-9) - 1.0) < 0.15 and across > 0.0:
        why = f"the intrinsics look like those of images {across:.2g} times as large"
    elif abs(2 * cx / height - 1.0) < 0.15 and abs(2 * cy / width - 1.0) < 0.15:
        why = f"the intrinsics look like those of {height} x {width} images (portrait and landscape)"
    text = (
        f"camera {camera.name}: the principal point ({cx:.0f}, {cy:.0f}) is far from the middle of "
        f"{width} x {height} px; {why}"
    )
    return Notice("rig.image_size", "warning", text, {"cameras": [camera.name]})


def sizes_that_differ(rig: Rig, instants: Sequence[Mapping[str, ViewDetections]]) -> list[Notice]:
    """Return notices on images whose size differs from the rig's."""
    notices = []
    for camera in rig.cameras:
        sizes = {instant[camera.name].image_size for instant in instants if camera.name in instant}
        for width, height in sorted(sizes - {camera.image_size}):
            wanted = camera.image_size
            why = "they are cropped or stretched"
            if (height, width) == wanted:
                why = "they are turned by 90 degrees (portrait and landscape)"
            elif abs(width * wanted[1] / (height * wanted[0]) - 1.0) < 0.02:
                why = f"they are {width / wanted[0]:.3g} times the size; scale the intrinsics or the images"
            text = (
                f"camera {camera.name}: the images have {width} x {height} px, but the rig states "
                f"{wanted[0]} x {wanted[1]}; {why}"
            )
            notices.append(Notice("rig.image_size", "warning", text, {"cameras": [camera.name]}))
    return notices


def check_scale(people: Array, skeleton: SkeletonModel, at_once: int) -> list[Notice]:
    """Return a notice if the size of people implies another unit of length, or another scale.

    Args:
        people: Joints (M, J, 3) in the unit of the rig, NaN = missing.
        at_once: Usual number of people in a view, whose statures are averaged.
    """
    extents = [_extent(points[np.isfinite(points).all(-1)]) for points in people]
    extent = float(np.median(extents))
    if POSSIBLE_EXTENT[0] <= extent <= POSSIBLE_EXTENT[1]:
        return _stature(people, skeleton, at_once)
    unit = min(UNITS, key=lambda name: abs(np.log(extent / (USUAL_EXTENT * UNITS[name]))))
    text = f"people are {extent:.3g} m large in this rig: its lengths look like {unit}, not metres"
    return [Notice("rig.units", "warning", text, {"extent_m": extent, "unit": unit})]


def _stature(people: Array, skeleton: SkeletonModel, at_once: int) -> list[Notice]:
    """Return a notice if the bones give a mean stature that adults do not have."""
    scale = log_scale(people, bones_of(skeleton, range(len(skeleton.joint_names))))
    sd = float(np.hypot(BONES_SD, STATURE_SD_M / STATURE_M / np.sqrt(max(at_once, 1))))
    if not abs(scale) > CERTAIN * sd:
        return []
    stature = STATURE_M * np.exp(-scale)
    text = (
        f"people are {stature:.2f} m tall in this rig by their arms and legs, adults {STATURE_M:.2f} ± "
        f"{STATURE_M * sd:.2f} m: lengths are {np.exp(-scale):.2f} times the true ones, unless these are "
        "children; measure the distance of two cameras for `panoptic rig convert --distance`"
    )
    return [Notice("rig.scale", "info", text, {"factor": float(np.exp(scale))})]


def _extent(points: Array) -> float:
    return float(np.linalg.norm(points[:, None] - points[None], axis=-1).max())
