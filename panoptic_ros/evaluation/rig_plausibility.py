"""What can be told from the numbers of a rig, the sizes of the images and the size of people."""
from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from panoptic_ros.domain import Camera, Rig, ViewDetections
from panoptic_ros.stage import Notice

Array = np.ndarray
UNITS = {"feet": 3.281, "inches": 39.37, "centimetres": 100.0, "millimetres": 1000.0, "kilometres": 0.001}
USUAL_EXTENT = 1.4  # m, largest distance of two joints of somebody, half of them hidden or sitting
POSSIBLE_EXTENT = (0.5, 3.0)  # m
FAR_APART = 200.0  # m
AXES = ("+x", "+y", "+z", "-x", "-y", "-z")


def implausible_cameras(rig: Rig) -> list[Notice]:
    """Notices on numbers that no camera has."""
    found = [note for camera in rig.cameras for note in (_view_angle(camera), _principal_point(camera))]
    notices = [note for note in found if note]
    centres = np.stack([camera.centre for camera in rig.cameras])
    span = float(np.ptp(centres, axis=0).max())
    if span > FAR_APART:
        text = f"the cameras lie {span:.0f} m apart: the unit of length is probably mm or cm, not m"
        notices.append(Notice("rig.units", "warning", text, {"span_m": span}))
    if len(rig) > 1 and span < 1e-3:
        text = "all cameras are at one and the same place: the poses are missing, or in km"
        notices.append(Notice("rig.units", "warning", text, {"span_m": span}))
    return notices


def _view_angle(camera: Camera) -> Notice | None:
    focal = camera.intrinsics.matrix[0, 0]
    fisheye = camera.intrinsics.lens == "fisheye"
    half = 0.5 * camera.image_size[0] / focal  # rad of a fisheye
    angle = float(np.degrees(2.0 * (half if fisheye else np.arctan(half))))
    if 5.0 <= angle <= (230.0 if fisheye else 150.0):
        return None
    text = (
        f"camera {camera.name}: a focal length of {focal:.4g} px with {camera.image_size[0]} px of width "
        f"is a field of view of {angle:.3g} degrees; is it in mm, or for images of another size?"
    )
    return Notice("rig.intrinsics", "warning", text, {"cameras": [camera.name], "degrees": angle})


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
    """Notices on images of another size than the rig says."""
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
                f"camera {camera.name}: the images have {width} x {height} px, the rig says "
                f"{wanted[0]} x {wanted[1]}; {why}"
            )
            notices.append(Notice("rig.image_size", "warning", text, {"cameras": [camera.name]}))
    return notices


def check_scale(people: Array) -> list[Notice]:
    """The unit of length, from people (M, J, 3) in the unit of the rig."""
    extents = [_extent(points[np.isfinite(points).all(-1)]) for points in people]
    extent = float(np.median(extents))
    if POSSIBLE_EXTENT[0] <= extent <= POSSIBLE_EXTENT[1]:
        return []
    unit = min(UNITS, key=lambda name: abs(np.log(extent / (USUAL_EXTENT * UNITS[name]))))
    text = f"people are {extent:.3g} m large in this rig: its lengths look like {unit}, not metres"
    return [Notice("rig.units", "warning", text, {"extent_m": extent, "unit": unit})]


def _extent(points: Array) -> float:
    return float(np.linalg.norm(points[:, None] - points[None], axis=-1).max())


def check_up(rig: Rig, from_hips_to_head: Array) -> list[Notice]:
    """Which way is up, from people's hips to their heads (M, 3); without people, from the cameras."""
    known = from_hips_to_head[np.isfinite(from_hips_to_head).all(-1)]
    if len(known):
        up = np.median(known / np.linalg.norm(known, axis=-1, keepdims=True), axis=0)
        whose = "people stand along"
    else:
        up = -np.mean([camera.cam_from_world.rotation[1] for camera in rig.cameras], axis=0)
        whose = "the cameras are upright only along"
    if np.linalg.norm(up) < 0.6 or up[2] > 0.7:
        return []  # lying people and cameras on their side tell nothing
    axis = AXES[int(np.argmax(np.concatenate([up, -up])))]
    if axis == "+z":
        tilt = float(np.degrees(np.arccos(up[2] / np.linalg.norm(up))))
        text = f"{whose} a direction {tilt:.0f} degrees off +z: the floor of this rig is not level"
    else:
        text = f"{whose} {axis}: the world of this rig does not have z up; turn it so that up is +z"
    return [Notice("rig.up", "warning", text, {"up": up.tolist()})]
