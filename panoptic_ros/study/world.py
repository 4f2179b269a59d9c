"""Input data of all studies: detection sets with their ground truth.

`simulated_world` reads the name of a simulated or rendered scene. `recorded_world` reads the paths of a
recording: a folder, a bag or single files.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import (
    DetectionSet,
    EndOfStream,
    Rig,
    ScoreMaps,
    SkeletonModel,
    ViewDetections,
    ViewFrame,
)
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.compared_skeletons import read_sequence
from panoptic_ros.io.detector_context import detector_extras
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.recorded_people import read_people
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.simulation import SCENES, SKELETON, SimulatedScene, Simulation, simulate
from panoptic_ros.simulation.drawn_maps import MapDrawing, with_drawn_maps
from panoptic_ros.simulation.rendering import Studio
from panoptic_ros.simulation.timing import to_stamp
from panoptic_ros.stage import StageContext
from panoptic_ros.study.cropping import Shares, cropped_images, cropped_people, cropped_rig, cropped_truth
from panoptic_ros.voting.volume import volume_of_rig

Array = np.ndarray
Sets = tuple[DetectionSet, ...]
HD_MAPS, VGA_MAPS = MapDrawing((512, 288)), MapDrawing((256, 192))
DETECTED = "panoptic19"  # default skeleton of rendered worlds
RENDERED_FRAMES = 25  # upper limit of rendered frames, because rendering takes most of the time
STRETCHES = 8  # parts of a recording with separate figures; their spread estimates random variation
SHORTEST = 4  # lower limit of frames in a part
EVERY_FRAME = 1_000_000_000
TRUTHS = ("truth.json.gz", "truth.json", "groundtruth3d.json.gz")
WINDOW_S = 0.01  # views closer in time than this belong to one set
VOXEL = 0.04  # m
# index of the person with score maps but no 2D pose, as if the detector's person head failed
UNLISTED_PERSON = 0
FEW = 2  # cameras of the variant "2views"
SLOW_HZ = 5.0  # sets per second of the variant "slow"


@dataclass(frozen=True, eq=False)
class World:
    """Detection sets and their ground truth.

    Args:
        bounds: lower and upper corner (m) of the volume that `exact` and `dense` search.
        given: 2D joints with the simulator's own identities; empty for recordings. Per frame: pixels (P, J,
            C, 2) and scores (P, J, C). Pixels are NaN where camera C has no detection from joint J of person
            P.
        truth: ground truth; None if unknown.
        joint_names: joint names of results, in the spelling of the recording; empty = names of the skeleton.
        stretches: number of parts of the frames with separate figures.
    """

    rig: Rig
    skeleton: SkeletonModel
    sets: tuple[DetectionSet, ...]
    bounds: tuple[float, ...]
    truth: SkeletonSequence | None = None
    given: tuple[tuple[Array, Array], ...] = ()
    joint_names: tuple[str, ...] = ()
    stretches: int = 1

    @property
    def names(self) -> tuple[str, ...]:
        """Return the joint names of results."""
        return self.joint_names or self.skeleton.joint_names

    @property
    def mapped(self) -> bool:
        """Return whether the sets have score maps."""
        return any(view.maps is not None for item in self.sets for view in item.views)


def truth_of(take: Simulation) -> SkeletonSequence:
    """Return the true skeletons at the timestamps of the sets."""
    ticks = take.schedule.ticks
    joints = np.stack([person.joints(ticks) for person in take.people], axis=1)
    there = np.stack([person.is_present(ticks) for person in take.people], axis=1)
    ids = np.array([person.id for person in take.people])
    frames = []
    for tick, here, rows in zip(ticks, there, joints):
        ignored = np.array([take.is_ignored(person, tick) for person in take.people])
        frames.append(SkeletonFrame(take.master_ns(tick), ids[here], rows[here], ignored=ignored[here]))
    return SkeletonSequence(SKELETON.joint_names, tuple(frames))


def simulated_world(
    name: str, seed: int, frames: int, model: str = "", shares: Shares | None = None
) -> World:
    """Simulate a take of a scene. Variants follow its name, e.g. "noisy-4p5v+maps".

    Args:
        model: detector of rendered scenes.
        shares: central window of the images; None = the whole images.

    Raises:
        UsageError: if the scene or a variant does not exist.
        UserError: if the detector cannot be loaded.
    """
    scene, variants = split(name)
    take = simulate(scene, seed, frames)
    if scene.rendered:
        return rendered_world(take, model, shares)
    rig, sets = take.rig, tuple(take.detection_sets())
    for word in variants:
        rig, sets = VARIANTS[word](take, rig, sets)
    world = World(rig, SKELETON, sets, (), truth_at(truth_of(take), sets))
    return world if shares is None else cropped_world(world, shares)


def cropped_world(world: World, shares: Shares) -> World:
    """Return the world of the central windows of all images, without score maps; see `cropped_people`."""
    assert world.truth is not None
    rig = cropped_rig(world.rig, shares)
    sets = tuple(cropped_people(item, world.rig, shares) for item in world.sets)
    return replace(world, rig=rig, sets=sets, truth=cropped_truth(world.truth, rig))


def truth_at(truth: SkeletonSequence, sets: Sets) -> SkeletonSequence:
    """Return the true skeletons at the frame indices of the sets."""
    indices = [item.index for item in sets]
    whole = len(indices) == len(truth.frames)
    return truth if whole else replace(truth, frames=tuple(truth.frames[index] for index in indices))


def frames_of(name: str, most: int | None) -> int:
    """Return the number of frames to use from a scene, limited to `most`.

    Raises:
        UsageError: if the scene does not exist.
    """
    scene, _ = split(name)
    own = min(scene.frames, RENDERED_FRAMES) if scene.rendered else scene.frames
    return own if most is None else min(own, most)


def split(name: str) -> tuple[SimulatedScene, list[str]]:
    """Split a name into its scene and its variants.

    Raises:
        UsageError: if the scene or a variant does not exist.
    """
    scene, *variants = name.split("+")
    unknown = [word for word in variants if word not in VARIANTS]
    if scene not in SCENES or unknown or (variants and SCENES[scene].rendered):
        raise UsageError(
            f"there is no scene {name!r}; there are {', '.join(SCENES)}, and behind those that are not "
            f"rendered {', '.join('+' + word for word in VARIANTS)}"
        )
    return SCENES[scene], variants


def _with_maps(take: Simulation, rig: Rig, sets: Sets) -> tuple[Rig, Sets]:
    """Add score maps drawn from the 2D poses."""
    return rig, tuple(with_drawn_maps(item, HD_MAPS) for item in sets)


def _with_someone_unlisted(take: Simulation, rig: Rig, sets: Sets) -> tuple[Rig, Sets]:
    """Add score maps of all persons, and remove the 2D poses of one person."""
    rig, sets = _with_maps(take, rig, sets)
    varied = []
    for item, (_, sightings) in zip(sets, take.sightings()):
        views = [
            _unlisted(view, (sightings[rig.names.index(view.camera)].sources[..., 0] == UNLISTED_PERSON))
            for view in item.views
        ]
        varied.append(replace(item, views=tuple(views)))
    return rig, tuple(varied)


def _unlisted(view: ViewDetections, theirs: Array) -> ViewDetections:
    """Return the view without the 2D poses of one person; the score maps stay unchanged.

    Args:
        theirs: (Q, J), True for joints of the person; a 2D pose with more than half of its joints is removed.
    """
    listed = 2 * theirs.sum(axis=1) <= (view.scores > 0.0).sum(axis=1)
    numbers = np.where(listed, np.cumsum(listed) - 1, -1)
    maps = view.maps
    if isinstance(maps, ScoreMaps):
        maps = replace(maps, persons=numbers[maps.persons])
    return replace(
        view,
        points=view.points[listed],
        scores=view.scores[listed],
        person_scores=view.person_scores[listed],
        maps=maps,
    )


def _with_few_views(take: Simulation, rig: Rig, sets: Sets) -> tuple[Rig, Sets]:
    """Keep only the first two cameras."""
    few = replace(rig, cameras=rig.cameras[:FEW])
    kept = [replace(item, views=tuple(v for v in item.views if v.camera in few.names)) for item in sets]
    return few, tuple(item for item in kept if item.views)


def _at_low_rate(take: Simulation, rig: Rig, sets: Sets) -> tuple[Rig, Sets]:
    """Keep about five sets per second."""
    stamps = np.array([item.stamp_ns for item in sets])
    period = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 1e9
    return rig, sets[:: max(1, round(1e9 / SLOW_HZ / period))]


VARIANTS: dict[str, Callable[[Simulation, Rig, Sets], tuple[Rig, Sets]]] = {
    "maps": _with_maps,
    "unlisted": _with_someone_unlisted,
    "2views": _with_few_views,
    "slow": _at_low_rate,
}


def rendered_world(take: Simulation, model: str, shares: Shares | None = None) -> World:
    """Render a take with synchronised cameras and run the detector of a model card on the images.

    Args:
        shares: central window of the images; None = the whole images.

    Raises:
        UserError: if the detector cannot be loaded.
    """
    skeleton, extras = detector_extras(model, DETECTED)
    rig, instants, truth = take.rig, instants_of(take, take.rig.names), truth_of(take)
    if shares is not None:
        rig, instants = cropped_rig(rig, shares), cropped_images(instants, rig, shares)
        truth = cropped_truth(truth, rig)
    sets = tuple(detected_sets(StageContext(rig, skeleton, extras), instants))
    return World(rig, skeleton, sets, (), truth)


def detected_sets(context: StageContext, instants: Iterable[Sequence[ViewFrame]]) -> Iterator[DetectionSet]:
    """Yield one detection set for the images of each time step.

    The context must have the extra "detector".
    """
    stage = make_stage("detection", configure({})["detection"], context)
    for index, frames in enumerate(instants):
        views = tuple(view for frame in frames for view in stage.step(frame).outputs)
        yield DetectionSet(index, frames[0].stamp_ns, context.skeleton.hash, views)


def instants_of(take: Simulation, names: Sequence[str]) -> Iterator[list[ViewFrame]]:
    """Yield the rendered images of these cameras, one list per time step."""
    studio, ticks = Studio(take), take.schedule.ticks
    cameras = [studio.camera(name).render(ticks) for name in names]
    for index, (tick, images) in enumerate(zip(ticks, zip(*cameras))):
        yield [ViewFrame(name, to_stamp(tick), index, image.image) for name, image in zip(names, images)]


def recorded_world(paths: Sequence[str], shares: Shares | None = None) -> World:
    """Read a recording: [folder], [bag, truth] or [rig, 2D poses, truth].

    Args:
        shares: central window of the images; None = the whole images.

    Raises:
        UserError: if a file is missing or cannot be read.
    """
    if len(paths) == 2:
        bag = Path(paths[0])
        inner = bag / "bag"  # `panoptic run` writes its bag into this folder
        world = bag_world(inner if inner.is_dir() else bag, truth=Path(paths[1]))
    else:
        rig_file, people_file, truth_file = _files(paths)
        rig = read_rig(rig_file)
        people = read_people(people_file, rig)
        truth = read_sequence(truth_file)
        world = World(rig, people.skeleton, tuple(people.sets), (), truth, (), people.joint_names)
    if shares is not None:
        world = cropped_world(world, shares)
    return replace(world, stretches=max(1, min(STRETCHES, len(world.sets) // SHORTEST)))


def _files(paths: Sequence[str]) -> tuple[Path, Path, Path]:
    """Return the paths of the rig, the 2D poses and the ground truth."""
    if len(paths) == 3:
        rig, people, truth = map(Path, paths)
        return rig, people, truth
    (folder,) = map(Path, paths)
    truths = [folder / name for name in TRUTHS if (folder / name).is_file()]
    if not truths:
        raise UsageError(f"{folder} has no truth; it needs one of {', '.join(TRUTHS)}, or name the files")
    return folder / "rig.json", folder / "detections.json.gz", truths[0]


def bag_world(
    bag: Path,
    cameras: Sequence[str] = (),
    truth: Path | None = None,
    frames: int = EVERY_FRAME,
    bounds: Sequence[float] | None = None,
) -> World:
    """Read the first detection sets of a bag that `panoptic run` wrote.

    Args:
        cameras: names of the cameras to read; empty = all.
        truth: file of the ground truth; None = unknown.
        frames: upper limit of detection sets.
        bounds: m, see `World`; None = the volume that at least two cameras see.

    Raises:
        DataError: if the bag has no rig, skeleton or detections, or is damaged.
        CalibrationError: if the bag has no camera of a given name.
    """
    with BagReader(bag) as reader:
        rig, skeleton = _latched(reader, "rig"), _latched(reader, "skeleton_model")
    if cameras:
        rig = rig.subset(list(cameras))
    config = configure({"sync": {"window_s": WINDOW_S}})["sync"]
    stage = make_stage("sync", config, StageContext(rig, skeleton))
    sets: list[DetectionSet] = []
    for item in _detections(bag, rig):
        sets += stage.step(item).outputs
        if len(sets) >= frames:
            break
    else:
        sets += stage.flush().outputs
    if not sets:
        raise DataError(f"{bag} has no detections of the cameras {', '.join(rig.names)}")
    if bounds is None:
        volume = volume_of_rig(rig, VOXEL)
        bounds = [VOXEL * float(edge) for edge in (*volume.lower, *volume.upper)]
    known = None if truth is None else read_sequence(truth)
    return World(rig, skeleton, tuple(sets[:frames]), tuple(bounds), known)


def _latched(reader: BagReader, key: str) -> Any:
    topic = "/" + TOPICS[key].name
    for _, _, message in reader.messages(topic) if topic in reader.topics else ():
        return from_message(message, TOPICS[key].record)
    raise DataError(f"{reader.path} has no message on {topic}; write the bag with `panoptic run`")


def _detections(bag: Path, rig: Rig) -> Iterator[Any]:
    """Yield the views of all cameras in the order of their timestamps, and the end of each stream."""

    def stream(order: int, camera: str) -> Iterator[tuple[int, int, Any]]:
        last = 0
        with BagReader(bag) as reader:
            topic = "/" + TOPICS["detections"].of(camera)
            for _, _, message in reader.messages(topic) if topic in reader.topics else ():
                view = from_message(message, "ViewDetections")
                last = view.stamp_ns
                yield last, order, view
        yield last + 1, order, EndOfStream(camera)

    streams = [stream(order, camera) for order, camera in enumerate(rig.names)]
    for _, _, item in heapq.merge(*streams, key=lambda row: row[:2]):
        yield item
