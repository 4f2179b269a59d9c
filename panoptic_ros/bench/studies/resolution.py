"""The study of resolution: rendered images of as many HD, VGA and QVGA cameras at the same places."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from panoptic_ros.bench.stage1.world import truth_of
from panoptic_ros.bench.studies.solving import score, solve
from panoptic_ros.domain import DetectionSet, Rig, ViewDetections, ViewFrame
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.io.detector_context import detector_extras
from panoptic_ros.simulation import CLEAN, Simulation, simulate
from panoptic_ros.simulation.rendering import Studio
from panoptic_ros.simulation.studio import nearest_pairs, scaled, study_scene
from panoptic_ros.simulation.timing import to_stamp
from panoptic_ros.stage import StageContext

Array = np.ndarray
AREA = 1.4  # m
SKELETON = "panoptic19"


def study_resolution(
    hd: Rig, vga: Rig, cameras: int, people: Sequence[int], frames: int, seed: int, model: str,
    settings: dict[str, dict[str, Any]], tell: Callable[[str], None],
) -> dict[str, Any]:  # fmt: skip
    """Scores for every number of people and each resolution.

    Raises:
        UserError: if the detector cannot be loaded.
    """
    hd, vga = nearest_pairs(hd, vga, min(cameras, len(hd), len(vga)))
    rows = []
    for number in people:
        whole = Rig((*hd.cameras, *vga.cameras))
        take = simulate(study_scene(whole, number, AREA, CLEAN), seed, frames)
        images = _render(take, tell, number)
        for kind, rig, views in _kinds(take, set(hd.names), images):
            tell(f"{number} people, {kind}: detection in {len(rig)} views")
            found = score(truth_of(take), _detect_and_solve(take, rig, views, model, settings))
            width = rig.cameras[0].image_size[0]
            rows.append({"people": number, "cameras": len(rig), "kind": kind, "width": width}
                        | found.to_mapping())  # fmt: skip
    return {"study": "resolution", "model": model, "frames": frames, "seed": seed, "rows": rows}


def _render(take: Simulation, tell: Callable[[str], None], people: int) -> dict[str, list[Array]]:
    """Images (H, W, 3) of every camera at all instants."""
    studio = Studio(take)
    images = {}
    for done, name in enumerate(take.rig.names):
        tell(f"{people} people: rendering camera {done + 1} of {len(take.rig)}")
        images[name] = [view.image for view in studio.camera(name).render(take.schedule.ticks)]
    return images


def _kinds(
    take: Simulation, hd: set[str], images: dict[str, list[Array]]
) -> list[tuple[str, Rig, dict[str, list[Array]]]]:
    high = Rig(tuple(camera for camera in take.rig.cameras if camera.name in hd))
    low = Rig(tuple(camera for camera in take.rig.cameras if camera.name not in hd))
    lowest = Rig(tuple(scaled(camera, 0.5) for camera in low.cameras))
    halved = {name: [_halved(image) for image in images[name]] for name in low.names}
    return [("HD", high, images), ("VGA", low, images), ("QVGA", lowest, halved)]


def _halved(image: Array) -> Array:
    """Means of 2 x 2 pixels."""
    height, width = (side // 2 * 2 for side in image.shape[:2])
    blocks = image[:height, :width].reshape(height // 2, 2, width // 2, 2, 3)
    halved: Array = np.rint(blocks.mean(axis=(1, 3))).astype(np.uint8)
    return halved


def _detect_and_solve(
    take: Simulation, rig: Rig, images: dict[str, list[Array]], model: str,
    settings: dict[str, dict[str, Any]],
) -> Any:  # fmt: skip
    skeleton, extras = detector_extras(model, SKELETON)
    detection = make_stage("detection", configure({})["detection"], StageContext(rig, skeleton, extras))
    sets = []
    for index, tick in enumerate(take.schedule.ticks):
        views: list[ViewDetections] = []
        for camera in rig.cameras:
            frame = ViewFrame(camera.name, to_stamp(tick), index, images[camera.name][index])
            views += detection.step(frame).outputs
        sets.append(DetectionSet(index, to_stamp(tick), skeleton.hash, tuple(views)))
    return solve(rig, skeleton, sets, settings)
