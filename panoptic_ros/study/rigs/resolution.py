"""The study `resolution`: rendered images of equal numbers of HD, VGA and QVGA cameras at the same places."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

from panoptic_ros.domain import Rig, ViewFrame
from panoptic_ros.io.detector_context import detector_extras
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.running.arguments import within
from panoptic_ros.simulation import CLEAN, Simulation, simulate
from panoptic_ros.simulation.rendering import Studio
from panoptic_ros.simulation.studio import nearest_pairs, scaled, study_scene
from panoptic_ros.simulation.timing import to_stamp
from panoptic_ros.stage import Progress, StageContext, each
from panoptic_ros.study.rigs.cameras import MODEL, Nodes, with_curve
from panoptic_ros.study.rigs.solving import score, solve
from panoptic_ros.study.study import Case, Row, shared_out
from panoptic_ros.study.world import DETECTED, detected_sets, truth_of

Array = np.ndarray
AREA = 1.4  # m, radius of the area in which persons move
# approximate time ratios: rendering, then detection and solving of HD, VGA and QVGA
COSTS = (4.0, 3.0, 2.0, 1.0)


class Resolution(Nodes):
    """Accuracy by the resolution of cameras, through the default detector."""

    people, frames = "2,5", 5
    source = "rendered images, default detector"

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        super().add_options(parser)
        parser.add_argument(
            "--cameras",
            type=within(int, 2, 480),
            default=19,
            metavar="N",
            help="greatest number of pairs of HD and VGA cameras; default 19",
        )

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        (people, seed), given = case.request, self.options
        rigs = [read_rig(given.rig, types=(kind,)) for kind in ("hd", "vga")]
        hd, vga = nearest_pairs(rigs[0], rigs[1], min(given.cameras, *map(len, rigs)))
        scene = study_scene(Rig((*hd.cameras, *vga.cameras)), people, AREA, CLEAN)
        take = simulate(scene, seed, given.frames)
        rendering, *parts = shared_out(progress, COSTS)
        images, truth = _render(take, rendering), truth_of(take)
        for (kind, rig, views), told in zip(_kinds(take, set(hd.names), images), parts):
            skeleton, extras = detector_extras(MODEL, DETECTED)
            told_frames = each(_instants(take, rig, views), given.frames, told, f"{len(rig)} {kind} views")
            sets = list(detected_sets(StageContext(rig, skeleton, extras), told_frames))
            about = {"people": people, "seed": seed, "cameras": len(rig), "kind": kind}
            for method in self.methods:
                found = score(truth, solve(method, rig, skeleton, sets).skeletons)
                yield with_curve(about | {"method": method.name} | found.to_mapping())


def _render(take: Simulation, progress: Progress) -> dict[str, list[Array]]:
    """Return the images (H, W, 3) of every camera at all time steps."""
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
    """Return the image at half size: means of 2 x 2 pixels."""
    height, width = (side // 2 * 2 for side in image.shape[:2])
    blocks = image[:height, :width].reshape(height // 2, 2, width // 2, 2, 3)
    halved: Array = np.rint(blocks.mean(axis=(1, 3))).astype(np.uint8)
    return halved


def _instants(take: Simulation, rig: Rig, images: dict[str, list[Array]]) -> Iterator[list[ViewFrame]]:
    """Yield the images of the cameras of a rig, one list per time step."""
    for index, tick in enumerate(take.schedule.ticks):
        yield [ViewFrame(name, to_stamp(tick), index, images[name][index]) for name in rig.names]
