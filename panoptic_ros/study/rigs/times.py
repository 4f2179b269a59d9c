"""The study `time`: seconds for one minute of capture, by procedure (Joo et al. 2017, Table 2)."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

from panoptic_ros.domain import Rig, ViewFrame
from panoptic_ros.io.detector_context import detector_extras
from panoptic_ros.simulation import CLEAN, SKELETON, farthest_first, simulate
from panoptic_ros.simulation.drawn_maps import with_drawn_maps
from panoptic_ros.simulation.studio import RATE, relative_noise, study_scene
from panoptic_ros.stage import Progress, StageContext, each
from panoptic_ros.study.rigs.cameras import AREA, MODEL, RigStudy, of_type
from panoptic_ros.study.rigs.solving import solve
from panoptic_ros.study.study import Case, Column, Result, Row, shared_out
from panoptic_ros.study.world import DETECTED, VGA_MAPS, detected_sets, instants_of

# number of timed images per camera, and number of cameras that are rendered and detected
TIMED, SEEN_BY = 2, 3
INSTANTS = round(60.0 * RATE)
PROCEDURES = {  # rows of Table 2, by the stage that does the same here
    "detection": "2D pose detection (5.1)",
    "association": "association of 2D people (not there)",
    "voting": "node and part proposals (5.1-5.2)",
    "assembly": "skeletal proposals, refined (5.3)",
}


class Time(RigStudy):
    """Detection is timed on a few images of the rig's cameras, the rest on drawn score maps of all."""

    people, frames = "5", 5
    columns = (
        Column("people", "people"),
        Column("cameras", "cameras"),
        Column("method", ""),
        *(Column(f"{stage}_text", text) for stage, text in PROCEDURES.items()),
    )
    across = True

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        (people, seed), given = case.request, self.options
        rig, methods = of_type(given.rig, "vga"), self.methods
        progress(0.0, "detection in a few images")
        image_s = _detection_s(rig, people, seed)
        take = simulate(study_scene(rig, people, AREA, relative_noise(given.noise)), seed, given.frames)
        sets = [with_drawn_maps(item, VGA_MAPS) for item in take.detection_sets()]
        for method, part in zip(methods, shared_out(progress, [1.0] * len(methods))):
            timed = each(sets, len(sets), part, f"{len(rig)} cameras, {method.name}")
            spent = {"detection": len(rig) * image_s, **solve(method, take.rig, SKELETON, timed).seconds}
            seconds = {stage: INSTANTS * value for stage, value in spent.items()}
            about = {"people": people, "cameras": len(rig), "method": method.name, "seconds": seconds}
            yield about | {f"{stage}_text": duration(value) for stage, value in seconds.items()}

    def head(self, result: Result) -> str:
        """See `Study`."""
        return f"One minute of capture ({INSTANTS} instants), one thread"


def seconds_per_image(context: StageContext, instants: Sequence[Sequence[ViewFrame]]) -> float:
    """Return the mean processor time (s) of the detector per image, without the first time step."""
    list(detected_sets(context, instants[:1]))
    begun = time.process_time()
    list(detected_sets(context, instants[1:]))
    return (time.process_time() - begun) / sum(len(frames) for frames in instants[1:])


def _detection_s(rig: Rig, people: int, seed: int) -> float:
    """Return the detection time (s) of one image of the rig."""
    take = simulate(study_scene(rig, people, AREA, CLEAN), seed, 1 + TIMED)
    skeleton, extras = detector_extras(MODEL, DETECTED)
    instants = list(instants_of(take, farthest_first(rig, SEEN_BY).names))
    return seconds_per_image(StageContext(take.rig, skeleton, extras), instants)


def duration(seconds: float) -> str:
    """Return a time as text in seconds, minutes or hours."""
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    return f"{seconds / 60.0:.0f} m" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"
