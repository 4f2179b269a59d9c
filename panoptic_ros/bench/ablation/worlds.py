"""What is solved: simulated people, rendered images through a detector, recordings with a truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from panoptic_ros.bench.ablation.variants import split, varied
from panoptic_ros.bench.rendered import rendered_world
from panoptic_ros.bench.stage1.recorded import recorded_world
from panoptic_ros.bench.stage1.world import World, truth_of
from panoptic_ros.errors import UsageError
from panoptic_ros.io.compared_skeletons import read_sequence
from panoptic_ros.io.recorded_people import read_people
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.simulation import SKELETON, simulate

SIMULATED = (
    "clean-4p5v",
    "noisy-4p5v+2views",
    "noisy-4p5v+maps",
    "noisy-4p5v+unlisted",
    "noisy-8p5v",
    "noisy-8p10v",
    "noisy-8p31v",
    "three-views-2p",
    "sitting-group-6p5v",
    "sitting-group-6p5v+maps",
    "crossing",
    "occluded",
    "bystanders",
    "enter-leave",
    "unsync-5v",
    "mixed-rates",
    "rendered-4p6v",
    "rendered-3p8v",
    "rendered-table-4p8v",
)
QUICK = ("noisy-4p5v+maps", "three-views-2p", "noisy-8p5v")
RENDERED_FRAMES = 25  # at most: images take most of the time
STRETCHES = 8  # into which a recording is cut, to know what is chance
SHORTEST = 4  # frames of a stretch
EVERY_FRAME = 1_000_000_000
TRUTHS = ("truth.json.gz", "truth.json", "groundtruth3d.json.gz")


@dataclass(frozen=True)
class Case:
    """People to solve, with their truth.

    Args:
        names: of the joints of what comes out.
        stretches: into so many the frames are cut, each with figures of its own.
    """

    world: World
    names: tuple[str, ...]
    stretches: int = 1


def frames_of(name: str, most: int | None) -> int:
    """How many frames of a scene are taken.

    Raises:
        UsageError: if there is no such scene.
    """
    scene, _ = split(name)
    own = min(scene.frames, RENDERED_FRAMES) if scene.rendered else scene.frames
    return own if most is None else min(own, most)


def simulated_case(name: str, seed: int, frames: int, model: str) -> Case:
    """A take of a scene with its variants; the images of a rendered one through the detector `model`."""
    scene, variants = split(name)
    take = simulate(scene, seed, frames)
    if scene.rendered:
        world = rendered_world(take, model)
        return Case(world, world.skeleton.joint_names)
    rig, sets = varied(take, variants)
    return Case(World(rig, SKELETON, sets, (), truth_of(take)), SKELETON.joint_names)


def recorded_case(paths: Sequence[str]) -> Case:
    """A recording: [folder], [bag, truth] or [rig, 2D people, truth].

    Raises:
        UserError: if something is missing or cannot be read.
    """
    if len(paths) == 2:
        bag = Path(paths[0])
        inner = bag / "bag"  # of a folder that `panoptic run` wrote
        world = recorded_world(str(inner if inner.is_dir() else bag), None, paths[1], EVERY_FRAME, None)
        names = world.skeleton.joint_names
    else:
        rig_file, people_file, truth_file = _files(paths)
        rig = read_rig(rig_file)
        people = read_people(people_file, rig)
        truth = read_sequence(truth_file)
        world, names = World(rig, people.skeleton, tuple(people.sets), (), truth), people.joint_names
    return Case(world, names, max(1, min(STRETCHES, len(world.sets) // SHORTEST)))


def _files(paths: Sequence[str]) -> tuple[Path, Path, Path]:
    """Rig, 2D people and truth."""
    if len(paths) == 3:
        rig, people, truth = map(Path, paths)
        return rig, people, truth
    (folder,) = map(Path, paths)
    truths = [folder / name for name in TRUTHS if (folder / name).is_file()]
    if not truths:
        raise UsageError(f"{folder} has no truth; it needs one of {', '.join(TRUTHS)}, or name the files")
    return folder / "rig.json", folder / "detections.json.gz", truths[0]
