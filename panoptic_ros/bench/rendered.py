"""Rendered images through a detector: 2D people with the faults and the score maps of a real one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from panoptic_ros.bench.stage1.world import World, truth_of
from panoptic_ros.domain import DetectionSet, ViewFrame
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.io.detector_context import detector_extras
from panoptic_ros.simulation import Simulation
from panoptic_ros.simulation.rendering import Studio
from panoptic_ros.simulation.timing import to_stamp
from panoptic_ros.stage import StageContext

SKELETON = "panoptic19"


def rendered_world(take: Simulation, model: str) -> World:
    """The images of a take whose cameras are in step, through the detector of a model card.

    Raises:
        UserError: if the detector cannot be loaded.
    """
    skeleton, extras = detector_extras(model, SKELETON)
    context = StageContext(take.rig, skeleton, extras)
    sets = tuple(detected_sets(context, instants_of(take, take.rig.names)))
    return World(take.rig, skeleton, sets, (), truth_of(take))


def detected_sets(context: StageContext, instants: Iterable[Sequence[ViewFrame]]) -> Iterator[DetectionSet]:
    """The 2D people of each instant; the context has the extra "detector"."""
    stage = make_stage("detection", configure({})["detection"], context)
    for index, frames in enumerate(instants):
        views = tuple(view for frame in frames for view in stage.step(frame).outputs)
        yield DetectionSet(index, frames[0].stamp_ns, context.skeleton.hash, views)


def instants_of(take: Simulation, names: Sequence[str]) -> Iterator[list[ViewFrame]]:
    """The images of these cameras, instant by instant."""
    studio, ticks = Studio(take), take.schedule.ticks
    cameras = [studio.camera(name).render(ticks) for name in names]
    for index, (tick, images) in enumerate(zip(ticks, zip(*cameras))):
        yield [ViewFrame(name, to_stamp(tick), index, image.image) for name, image in zip(names, images)]
