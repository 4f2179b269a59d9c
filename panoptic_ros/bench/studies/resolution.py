"""The study of resolution: rendered images of as many HD, VGA and QVGA cameras at the same places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from panoptic_ros.bench.rendered import SKELETON, detected_sets
from panoptic_ros.bench.stage1.world import truth_of
from panoptic_ros.bench.studies.solving import score, solve
from panoptic_ros.bench.studies.takes import Method, Takes, of_people, shared_out
from panoptic_ros.domain import Rig, ViewFrame
from panoptic_ros.evaluation import SkeletonSequence
from panoptic_ros.evaluation.studies import StudyScore
from panoptic_ros.graph.recording import HeldRecording
from panoptic_ros.io.detector_context import detector_extras
from panoptic_ros.simulation import CLEAN, Simulation, simulate
from panoptic_ros.simulation import SKELETON as TRUE_SKELETON
from panoptic_ros.simulation.rendering import Studio
from panoptic_ros.simulation.studio import nearest_pairs, scaled, study_scene
from panoptic_ros.simulation.timing import to_stamp
from panoptic_ros.stage import Progress, Recording, StageContext, each, part_of

Array = np.ndarray
AREA = 1.4  # m
COSTS = (4.0, 3.0, 2.0, 1.0)  # about, of rendering and of HD, VGA and QVGA
DETECTED = 0.95  # share of the time that detection takes; the rest is solving


@dataclass(frozen=True)
class ImageStudyConfig:
    """What `ImageStudy` needs to know."""

    methods: tuple[Method, ...] = (Method(),)


class ImageStudy:
    """The scores of a recording of images and truth, by a detector: a `stage.Pass`.

    Args:
        context: with the extra "detector".
    """

    def __init__(self, config: ImageStudyConfig, context: StageContext):
        self._config, self._context = config, context

    def run(self, recording: Recording, progress: Progress) -> tuple[StudyScore, ...]:
        """Detect in all images of an instant, instant by instant, and solve: a score for each method."""
        rig, skeleton = self._context.rig, self._context.skeleton
        truth = SkeletonSequence(TRUE_SKELETON.joint_names, tuple(recording.records("truth")))
        instants = zip(*(recording.records("image", name) for name in rig.names))
        told = part_of(progress, 0.0, DETECTED)
        told_instants = each(instants, len(truth.frames), told, f"detection in {len(rig)} views")
        sets = list(detected_sets(self._context, told_instants))
        methods, told = self._config.methods, part_of(progress, DETECTED, 1.0)
        return tuple(
            score(truth, solve(method, rig, skeleton, sets).skeletons)
            for method in each(methods, len(methods), told, "solving")
        )


def study_resolution(
    rigs: tuple[Rig, Rig],
    cameras: int,
    takes: Takes,
    methods: Sequence[Method],
    model: str,
    progress: Progress,
) -> dict[str, Any]:
    """Scores for every number of people, each resolution and each method.

    Args:
        rigs: the HD cameras and the VGA cameras. cameras: so many pairs of them at most.

    Raises:
        UserError: if the detector cannot be loaded.
    """
    hd, vga = nearest_pairs(*rigs, min(cameras, *map(len, rigs)))
    rows = []
    for number, told in zip(takes.people, shared_out(progress, takes.people)):
        rendering, *parts = shared_out(of_people(number, told), COSTS)
        scene = study_scene(Rig((*hd.cameras, *vga.cameras)), number, AREA, CLEAN)
        take = simulate(scene, takes.seed, takes.frames)
        images = _render(take, rendering)
        for (kind, rig, views), part in zip(_kinds(take, set(hd.names), images), parts):
            skeleton, extras = detector_extras(model, SKELETON)
            work = ImageStudy(ImageStudyConfig(tuple(methods)), StageContext(rig, skeleton, extras))
            scores = work.run(_recording(take, rig, views), part)
            width = rig.cameras[0].image_size[0]
            about = {"people": number, "cameras": len(rig), "kind": kind, "width": width}
            rows += [
                {**about, "method": method.name, **found.to_mapping()}
                for method, found in zip(methods, scores)
            ]
    return {
        "study": "resolution",
        "model": model,
        "frames": takes.frames,
        "seed": takes.seed,
        "rows": rows,
    }


def _render(take: Simulation, progress: Progress) -> dict[str, list[Array]]:
    """Images (H, W, 3) of every camera at all instants."""
    studio = Studio(take)
    names = take.rig.names
    return {
        name: [view.image for view in studio.camera(name).render(take.schedule.ticks)]
        for name in each(names, len(names), progress, f"rendering {len(names)} cameras")
    }


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


def _recording(take: Simulation, rig: Rig, images: dict[str, list[Array]]) -> HeldRecording:
    """The images of the cameras of a rig, and the truth."""
    stamps = [to_stamp(tick) for tick in take.schedule.ticks]
    frames: dict[str | tuple[str, str], Any] = {
        ("image", name): [ViewFrame(name, stamp, i, images[name][i]) for i, stamp in enumerate(stamps)]
        for name in rig.names
    }
    return HeldRecording({"truth": truth_of(take).frames, **frames})
