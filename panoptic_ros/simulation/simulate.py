"""A scene and a seed become cameras, 2D people and the truth."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from panoptic_ros.domain import DetectionSet, Rig, ViewDetections
from panoptic_ros.errors import UsageError
from panoptic_ros.simulation.detector import Sightings, SimulatedDetector
from panoptic_ros.simulation.generators import Generator
from panoptic_ros.simulation.people import Person
from panoptic_ros.simulation.scenes import Scene
from panoptic_ros.simulation.skeleton import JOINTS, SKELETON
from panoptic_ros.simulation.stagings import STAGINGS, Stage
from panoptic_ros.simulation.timing import CameraClock, Schedule, camera_clocks, make_schedule, to_stamp
from panoptic_ros.simulation.walls import occluders_of

Array = np.ndarray
POSITION_DIGITS = 9


@dataclass(frozen=True, eq=False)
class Simulation:
    """One take of a scene: who and what is there, and when the cameras expose."""

    scene: Scene
    seed: tuple[int, ...]  # everything random derives from it
    rig: Rig
    people: tuple[Person, ...]
    schedule: Schedule
    clocks: tuple[CameraClock, ...] = ()  # of the cameras, where each has its own

    def sightings(self) -> Iterator[tuple[int, list[Sightings]]]:
        """Index of each set and what every camera reports, also of cameras without an image."""
        scene = self.scene
        detector = SimulatedDetector(
            (*self.seed, 4),
            scene.degradation,
            self.rig,
            self.people,
            scene.absences,
            scene.table,
            scene.walls,
        )
        for index, tick in enumerate(self.schedule.ticks):
            exposures = self.schedule.exposures[index]
            yield index, detector.detect(index, np.where(np.isnan(exposures), tick, exposures))

    def detection_sets(self, skeleton_hash: str = SKELETON.hash) -> Iterator[DetectionSet]:
        """The 2D people of every instant, in the joints of `SKELETON`."""
        for index, views in self.sightings():
            stamps = self.schedule.stamps[index]
            seen = [
                _view(camera.name, camera.image_size, index, self.stamp_ns(k, stamp), view, skeleton_hash)
                for k, (camera, stamp, view) in enumerate(zip(self.rig.cameras, stamps, views))
                if not np.isnan(stamp)
            ]
            stamp = self.master_ns(self.schedule.ticks[index])
            yield DetectionSet(index, stamp, skeleton_hash, tuple(seen))

    @property
    def seconds(self) -> float:
        """How long it is."""
        return float(self.schedule.ticks[-1])

    def master_ns(self, seconds: float) -> int:
        """Master time of a time of the schedule: that of the first generator or camera clock, if there are
        any."""
        return self.stamp_ns(0, seconds)

    def stamp_ns(self, camera: int, seconds: float) -> int:
        """What the clock of a camera shows at a time of the schedule."""
        if self.clocks:
            return self.clocks[camera].stamp_ns(seconds)
        generators = self.scene.timing.generators
        return generators[camera % len(generators)].stamp_ns(seconds) if generators else to_stamp(seconds)

    def is_ignored(self, person: Person, tick: float) -> bool:
        """Whether a result may have a person or not: bystanders, and people while nobody can detect them."""
        unseen = any(
            a.person == person.id and a.start <= tick < a.end and not a.cameras and not a.joints
            for a in self.scene.absences
        )
        return person.bystander or unseen

    def truth_document(self) -> dict[str, Any]:
        """True skeletons at the instants of the sets, as a `panoptic-skeletons-1` document.

        People who are ignored carry "ignore".
        """
        ticks = self.schedule.ticks
        joints = [np.round(person.joints(ticks), POSITION_DIGITS).tolist() for person in self.people]
        frames = []
        for index, tick in enumerate(ticks):
            skeletons = []
            for person, positions in zip(self.people, joints):
                if not person.is_present(tick):
                    continue
                entry = {"id": person.id, "joints": positions[index], "scores": [1.0] * len(JOINTS)}
                if self.is_ignored(person, tick):
                    entry["ignore"] = True
                skeletons.append(entry)
            frames.append({"index": index, "stamp_ns": self.master_ns(tick), "skeletons": skeletons})
        return {"format": "panoptic-skeletons-1", "joint_names": list(JOINTS), "frames": frames}


def simulate(scene: Scene, seed: int, frames: int | None = None) -> Simulation:
    """One take of a scene; the same scene and seed always give the same take.

    A longer take begins with a shorter one. `frames` replaces the scene's own number.

    Raises:
        UsageError: on a negative seed or no frames.
    """
    count = scene.frames if frames is None else frames
    if seed < 0 or count < 1:
        raise UsageError(f"a simulation needs a seed from 0 and frames from 1, not {seed} and {count}")
    setting = repr((scene.activities, scene.staging, scene.rig, scene.area, scene.table))
    root = (seed, zlib.crc32(setting.encode()))  # other faults of the detector: the same people
    rig = replace(scene.rig.build(np.random.default_rng([*root, 1])), occluders=occluders_of(scene.walls))
    stage = Stage(scene.activities, scene.area, scene.table)
    people = STAGINGS[scene.staging](np.random.default_rng([*root, 2]), stage)
    schedule = make_schedule((*root, 3), scene.timing, count, len(rig))
    rig = _with_clocks(rig, scene.timing.generators)
    clocks = camera_clocks((*root, 3), scene.timing, len(rig))
    return Simulation(scene, root, rig, tuple(people), schedule, clocks)


def _with_clocks(rig: Rig, generators: Sequence[Generator]) -> Rig:
    """The rig whose cameras name the generators that they are locked to."""
    if not generators:
        return rig
    clocks = [generators[k % len(generators)].clock for k in range(len(rig))]
    return replace(rig, cameras=tuple(replace(c, clock=name) for c, name in zip(rig.cameras, clocks)))


def _view(
    camera: str, image_size: tuple[int, int], index: int, stamp_ns: int, view: Sightings, skeleton_hash: str
) -> ViewDetections:
    found = (view.scores > 0.0).sum(1)
    mean = view.scores.sum(1) / np.maximum(found, 1)
    return ViewDetections(camera, stamp_ns, index, image_size, skeleton_hash, view.points, view.scores, mean)
