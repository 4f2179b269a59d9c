"""Quality of a calibration from people: predicted errors, reasons for doubt, and refusals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.calibration.people.frame import HIPS, LEAN_SD, Bodies, Scale, bodies_of, body_axis
from panoptic_ros.calibration.people.solve import CalibratedPeople
from panoptic_ros.calibration.projection import OFFSET
from panoptic_ros.calibration.quality import (
    ASYNCHRONOUS_S,
    GOOD_ERROR_M,
    REFUSED,
    CameraQuality,
    Quality,
    coverage_of,
    predicted_errors,
    space_of,
)

Array = np.ndarray
GOOD_NOISE_PX = 6.0  # px per axis of HD images; detectors have 1 to 4, wrong intrinsics show as more
GOOD_COVERAGE = 0.3  # share of the cells of an image in which people were seen
GOOD_WALK_M, REFUSED_WALK_M = 0.4, 0.1  # m, spread of the people's places along the shorter axis of the floor
SCALE_DOUBT = 3.0  # standard deviations between a measured distance and the people's bones


class PeopleQuality(NamedTuple):
    """Quality of a calibration from people.

    Args:
        rig: Quality of the cameras; predicted errors after alignment with scale.
        scale: Scale, with its standard deviation.
        people: Greatest number of people at once.
        walk_m: Spread (m) of their places along the shorter axis of the floor.
        standing: Whether a person stands, which gives the up direction.
    """

    rig: Quality
    scale: Scale
    people: int
    walk_m: float
    standing: bool


def quality_of_people(found: CalibratedPeople, scale: Scale) -> PeopleQuality:
    """Return the quality of a calibration whose lengths are m."""
    rig = found.rig
    errors = predicted_errors(rig, space_of(rig), scaled=True)
    own = rig.seen.cameras[rig.seen.views]
    offsets = rig.state.cameras.offsets - np.median(rig.state.cameras.offsets)
    cameras = tuple(
        CameraQuality(
            name=given.name,
            views=len(np.unique(found.joints.instants[rig.seen.targets[own == c]])),
            points=int((own == c).sum()),
            outliers=int(rig.outliers[c]),
            rejected=0,
            noise_px=float(rig.noise[c]),
            coverage=coverage_of(rig.seen.pixels[own == c], given.size),
            focal_sd=0.0,
            centre_sd_px=0.0,
            offset_s=float(offsets[c]),
            offset_sd_s=float(rig.sd(c, slice(OFFSET, OFFSET + 1))[0]),
            jitter_s=0.0,
        )
        for c, given in enumerate(rig.inputs)
    )
    quality = Quality(cameras, float(np.sqrt((errors**2).mean())), float(np.percentile(errors, 95.0)))
    bodies = bodies_of(found)
    at_once = int(np.isfinite(bodies.positions[..., 0]).any(axis=2).sum(axis=0).max())
    return PeopleQuality(quality, scale, at_once, walk_of(bodies), body_axis(bodies)[1] <= LEAN_SD)


def walk_of(bodies: Bodies) -> float:
    """Return the spread (m) of the people's places along the second of their three main axes."""
    places = bodies.positions[:, :, HIPS].reshape(-1, 3)
    places = places[np.isfinite(places).all(axis=1)]
    if len(places) < 2:
        return 0.0
    return float(np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(places.T))[1], 0.0)))


def doubts_of_people(quality: PeopleQuality) -> list[str]:
    """Return one line per limit of a good calibration that is exceeded, with the remedy."""
    lines = []
    if quality.rig.error_m > GOOD_ERROR_M:
        lines.append(
            f"positions are predicted to be wrong by {1e3 * quality.rig.error_m:.1f} mm, more than "
            f"{1e3 * GOOD_ERROR_M:g} mm; let people walk longer, in all directions and through all views"
        )
    if quality.walk_m < GOOD_WALK_M:
        lines.append(
            f"people stay within {quality.walk_m:.2f} m on the floor, so constant errors of the detector do "
            "not average out and errors may be 5 times the predicted ones; let them walk through the whole "
            "space"
        )
    if not quality.standing:
        lines.append(
            "nobody stands upright, so the up direction is that of trunks, wrong by 10 degrees or more; let "
            "somebody walk"
        )
    scale = quality.scale
    apart = abs(np.log(scale.factor / scale.by_people))
    if apart > SCALE_DOUBT * np.hypot(scale.sd, scale.by_people_sd):
        lines.append(
            f"the given distance makes people {scale.factor / scale.by_people - 1.0:+.0%} taller than "
            "expected; check it"
        )
    for camera in quality.rig.cameras:
        where = f"camera {camera.name}: "
        if camera.noise_px > GOOD_NOISE_PX:
            lines.append(
                f"{where}joints miss their rays by {camera.noise_px:.1f} px; check that its intrinsics are "
                "those of this lens, zoom and image size"
            )
        if camera.coverage < GOOD_COVERAGE:
            lines.append(
                f"{where}people were seen in {camera.coverage:.0%} of the image; let them walk in the rest"
            )
        if camera.offset_sd_s > 0.0 and abs(camera.offset_s) > ASYNCHRONOUS_S + 2.0 * camera.offset_sd_s:
            lines.append(
                f"{where}not synchronous: its images are {1e3 * abs(camera.offset_s):.0f} ms "
                f"{'older' if camera.offset_s < 0.0 else 'newer'} than their stamps against the others; "
                "apply the clocks file"
            )
    return lines


def refusals_of_people(quality: PeopleQuality) -> list[str]:
    """Return the reasons for which a calibration is not usable."""
    lines = []
    if quality.people < 2 and quality.walk_m < REFUSED_WALK_M:
        lines.append("one person stays on the spot; let people walk through the whole space")
    if quality.rig.error_m > REFUSED * GOOD_ERROR_M:
        lines.append(
            f"positions are predicted to be wrong by {1e3 * quality.rig.error_m:.0f} mm; let people walk "
            "longer, in all directions"
        )
    return lines


def predicted_line(quality: PeopleQuality) -> str:
    """Return the line about the predicted errors."""
    return (
        f"predicted error where people walked: {1e3 * quality.rig.error_m:.2f} mm, "
        f"{1e3 * quality.rig.worst_m:.2f} mm at the 95th percentile; scale ± {quality.scale.sd:.1%}"
    )
