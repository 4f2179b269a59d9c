"""Simulation of a take: a scene and a seed determine cameras, 2D detections and ground truth."""

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
from panoptic_ros.simulation.people import SimulatedPerson
from panoptic_ros.simulation.scenes import SimulatedScene
from panoptic_ros.simulation.skeleton import JOINTS, SKELETON
from panoptic_ros.simulation.stagings import STAGINGS, StagingArea
from panoptic_ros.simulation.timing import (
    ExposureSchedule,
    SimulatedCameraClock,
    camera_clocks,
    make_schedule,
    to_stamp,
)
from panoptic_ros.simulation.walls import occluders_of

Array = np.ndarray
POSITION_DIGITS = 9


@dataclass(frozen=True, eq=False)
class Simulation:
    """One take of a scene: rig, people, exposure times and camera clocks."""

    scene: SimulatedScene
    seed: tuple[int, ...]  # root seed of all random numbers
    rig: Rig
    people: tuple[SimulatedPerson, ...]
    schedule: ExposureSchedule
    clocks: tuple[SimulatedCameraClock, ...] = ()  # one clock per camera, empty if the cameras share one

    def sightings(self) -> Iterator[tuple[int, list[Sightings]]]:
        """Yield each set's index and the detections of every camera, including cameras without an image."""
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
        """Yield the 2D detections of every instant, in the joints of `SKELETON`."""
        for index, views in self.sightings():
            stamps = self.schedule.stamps[index]
            seen = [
                view_of(camera.name, camera.image_size, index, self.stamp_ns(k, stamp), view, skeleton_hash)
                for k, (camera, stamp, view) in enumerate(zip(self.rig.cameras, stamps, views))
                if not np.isnan(stamp)
            ]
            stamp = self.master_ns(self.schedule.ticks[index])
            yield DetectionSet(index, stamp, skeleton_hash, tuple(seen))

    @property
    def seconds(self) -> float:
        """Return the duration in s, up to the last instant."""
        return float(self.schedule.ticks[-1])

    def master_ns(self, seconds: float) -> int:
        """Return the master time (ns) of a time of the schedule (s).

        This is the time of the first camera's clock or of the first generator, if there are any.
        """
        return self.stamp_ns(0, seconds)

    def stamp_ns(self, camera: int, seconds: float) -> int:
        """Return the time (ns) that a camera's clock shows at a time of the schedule (s)."""
        if self.clocks:
            return self.clocks[camera].stamp_ns(seconds)
        generators = self.scene.timing.generators
        return generators[camera % len(generators)].stamp_ns(seconds) if generators else to_stamp(seconds)

    def is_ignored(self, person: SimulatedPerson, tick: float) -> bool:
        """Return whether a result may contain a person or not.

        This holds for bystanders and for people while no camera can detect them.
        """
        unseen = any(
            a.person == person.id and a.start <= tick < a.end and not a.cameras and not a.joints
            for a in self.scene.absences
        )
        return person.bystander or unseen

    def truth_document(self) -> dict[str, Any]:
        """Return the true skeletons at the instants of the sets, as a `panoptic-skeletons-1` document.

        Ignored people have an entry "ignore".
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


def simulate(scene: SimulatedScene, seed: int, frames: int | None = None) -> Simulation:
    """Return one take of a scene; the same scene and seed always give the same take.

    A longer take begins with a shorter one.

    Args:
        frames: Number of frames. Default: that of the scene.

    Raises:
        UsageError: For a negative seed or fewer than one frame.
    """
    count = scene.frames if frames is None else frames
    if seed < 0 or count < 1:
        raise UsageError(f"a simulation needs a seed from 0 and frames from 1, not {seed} and {count}")
    setting = repr((scene.activities, scene.staging, scene.rig, scene.area, scene.table))
    # the seed ignores the detector's faults, so that other faults act on the same people
    root = (seed, zlib.crc32(setting.encode()))
    rig = replace(scene.rig.build(np.random.default_rng([*root, 1])), occluders=occluders_of(scene.walls))
    stage = StagingArea(scene.activities, scene.area, scene.table)
    people = STAGINGS[scene.staging](np.random.default_rng([*root, 2]), stage)
    schedule = make_schedule((*root, 3), scene.timing, count, len(rig))
    rig = _with_clocks(rig, scene.timing.generators)
    clocks = camera_clocks((*root, 3), scene.timing, len(rig))
    return Simulation(scene, root, rig, tuple(people), schedule, clocks)


def _with_clocks(rig: Rig, generators: Sequence[Generator]) -> Rig:
    """Return the rig with each camera's clock set to the generator that the camera is locked to."""
    if not generators:
        return rig
    clocks = [generators[k % len(generators)].clock for k in range(len(rig))]
    return replace(rig, cameras=tuple(replace(c, clock=name) for c, name in zip(rig.cameras, clocks)))


def view_of(
    camera: str, image_size: tuple[int, int], index: int, stamp_ns: int, view: Sightings, skeleton_hash: str
) -> ViewDetections:
    """Return the sightings of a camera as a record of its detector."""
    found = (view.scores > 0.0).sum(1)
    mean = view.scores.sum(1) / np.maximum(found, 1)
    return ViewDetections(camera, stamp_ns, index, image_size, skeleton_hash, view.points, view.scores, mean)
