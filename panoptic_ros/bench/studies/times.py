"""The study of time: what one minute of capture costs, procedure by procedure, as in Table 2."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from panoptic_ros.bench.rendered import SKELETON as DETECTED
from panoptic_ros.bench.rendered import detected_sets, instants_of
from panoptic_ros.bench.stage1.world import VGA_MAPS
from panoptic_ros.bench.studies.cameras import AREA
from panoptic_ros.bench.studies.solving import solve
from panoptic_ros.bench.studies.takes import Method, Takes, of_people, shared_out
from panoptic_ros.domain import Rig, ViewFrame
from panoptic_ros.io.detector_context import detector_extras
from panoptic_ros.simulation import CLEAN, SKELETON, farthest_first, simulate
from panoptic_ros.simulation.drawn_maps import with_drawn_maps
from panoptic_ros.simulation.studio import RATE, relative_noise, study_scene
from panoptic_ros.stage import Progress, StageContext, each, part_of

TIMED, SEEN_BY = 2, 3  # instants and cameras whose images are rendered and detected
DETECTED_SHARE = 0.1  # of the time that the study takes


def study_time(
    rig: Rig, takes: Takes, methods: Sequence[Method], model: str, progress: Progress
) -> dict[str, Any]:
    """Seconds of one thread for one minute of capture, for every number of people and every method.

    Detection is timed on a few images of the rig's cameras, the rest on drawn score maps of all of them.

    Raises:
        UserError: if the detector cannot be loaded.
    """
    progress(0.0, "detection in a few images")
    image_s, solving = _detection_s(rig, takes, model), part_of(progress, DETECTED_SHARE, 1.0)
    instants = round(60.0 * RATE)
    rows = []
    for number, told in zip(takes.people, shared_out(solving, takes.people)):
        take = simulate(study_scene(rig, number, AREA, relative_noise(takes.noise)), takes.seed, takes.frames)
        sets = [with_drawn_maps(item, VGA_MAPS) for item in take.detection_sets()]
        for method, part in zip(methods, shared_out(of_people(number, told), [1.0] * len(methods))):
            timed = each(sets, len(sets), part, f"solving {len(rig)} cameras, {method.name}")
            seconds = {"detection": len(rig) * image_s, **solve(method, take.rig, SKELETON, timed).seconds}
            rows.append(
                {
                    "people": number,
                    "cameras": len(rig),
                    "method": method.name,
                    "seconds": {stage: instants * value for stage, value in seconds.items()},
                }
            )
    return {
        "study": "time",
        "model": model,
        "instants": instants,
        "frames": takes.frames,
        "seed": takes.seed,
        "rows": rows,
    }


def seconds_per_image(context: StageContext, instants: Sequence[Sequence[ViewFrame]]) -> float:
    """Mean processor time (s) of the detector for an image, without the images of the first instant."""
    list(detected_sets(context, instants[:1]))
    begun = time.process_time()
    list(detected_sets(context, instants[1:]))
    return (time.process_time() - begun) / sum(len(frames) for frames in instants[1:])


def _detection_s(rig: Rig, takes: Takes, model: str) -> float:
    """Seconds for one image of the rig, with as many people as the study has at most."""
    take = simulate(study_scene(rig, max(takes.people), AREA, CLEAN), takes.seed, 1 + TIMED)
    skeleton, extras = detector_extras(model, DETECTED)
    instants = list(instants_of(take, farthest_first(rig, SEEN_BY).names))
    return seconds_per_image(StageContext(take.rig, skeleton, extras), instants)
