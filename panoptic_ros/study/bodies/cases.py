"""Captures of bodies with ground truth, simulated or from a folder, in the form that the solvers read."""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from panoptic_ros.domain import Camera, DetectionSet, Rig
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState, Subject, ViewPeople, ViewSeries
from panoptic_ros.errors import DataError
from panoptic_ros.evaluation.kinematic_scores import inside, score_bodies, score_joint_angles
from panoptic_ros.io.body_context import body_extras
from panoptic_ros.io.body_files import read_bodies
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.kinematic_files import read_imus
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.pose.prior import PoseStatistics, other_sides, train_prior
from panoptic_ros.kinematics.session import BodyRecording, BodySolution, solve_recording
from panoptic_ros.running.kinematics import PAPER, body_config, read_body_task
from panoptic_ros.running.simulations.body_scenes import BODY_SCENES, OTHER_BODY_SCENES, body_scene
from panoptic_ros.simulation.bodies.capture import SPARSE, BodyCapture
from panoptic_ros.simulation.bodies.group import BodyGroup, group_of, simulate_group
from panoptic_ros.simulation.bodies.motion import Clip
from panoptic_ros.study.options import add_seeds, add_settings, known_names, words
from panoptic_ros.study.people.detected import detected
from panoptic_ros.study.study import Case, Result, Study

Array = np.ndarray
SKIPPED_S = (
    3.0  # s at the beginning without a score: the T-pose, and the motion from the T-pose to the first clip
)
OURS = "ours"
METHODS = (OURS, PAPER)
# the paper's solver with our association of 2D poses, so that only the solvers differ
SAME_PEOPLE = "paper_sorting=false"


@dataclass(frozen=True, eq=False)
class BodyCase:
    """A capture: the inputs of the solver, and the ground truth of its subjects.

    Args:
        statistics: pose prior; without the motions of the capture if it is simulated.
        strangers: ground truth of other visible persons.
    """

    name: str
    seed: int
    recording: BodyRecording
    subjects: tuple[Subject, ...]
    truth: tuple[BodyState, ...]
    statistics: PoseStatistics
    strangers: tuple[BodyState, ...] = ()

    @property
    def model(self) -> SegmentModel:
        """Return the segment model of all subjects."""
        return self.subjects[0].body.model

    def with_inputs(self, cameras: int, imus: int) -> BodyCase:
        """Return the case with the first cameras, which are neighbours, and 0, 6 or 13 IMUs per subject."""
        names = self.model.names
        subjects = tuple(
            replace(
                s,
                devices=tuple(
                    d for d in s.devices if imus == 13 or (imus == 6 and names[d.segment] in SPARSE)
                ),
            )
            for s in self.subjects
        )
        worn = {device.name for subject in subjects for device in subject.devices}
        given = self.recording
        recording = replace(
            given,
            rig=given.rig if cameras else None,
            views={camera: view for camera, view in given.views.items() if camera < cameras},
            devices={name: series for name, series in given.devices.items() if name in worn},
        )
        return replace(self, recording=recording, subjects=subjects)

    def of_stature(self) -> BodyCase:
        """Return the case with segment lengths derived from the stature alone."""
        subjects = []
        for subject in self.subjects:
            body = replace(subject.body, offsets=self.model.body(subject.stature).offsets)
            subjects.append(replace(subject, body=body, measured=False))
        return replace(self, subjects=tuple(subjects))

    def solve(self, config: KinematicsConfig) -> BodySolution:
        """Solve the bodies of all subjects."""
        return solve_recording(self.recording, self.subjects, config, self.statistics)

    def score(self, config: KinematicsConfig) -> dict[str, Any]:
        """Return errors (mean over the subjects) and processor time (ms) per time step and subject."""
        began = time.process_time()
        states = self.solve(config).states
        spent = 1e3 * (time.process_time() - began)
        model, found = self.model, []
        ground = [model.index(name) for name in model.ground]
        for subject in self.subjects:
            truth, mine = ([s for s in both if s.id == subject.id] for both in (self.truth, states))
            scores = score_bodies(truth, mine, model.parents, SKIPPED_S, ground)
            scores |= score_joint_angles(truth, mine, model, SKIPPED_S)
            found.append(scores | {"inside": inside(mine, truth)})
        means = {key: float(np.mean([scores.get(key, np.nan) for scores in found])) for key in found[0]}
        return means | {"ms": spent / len(self.truth)}


class BodyStudy(Study):
    """Base of the studies of bodies: captures in folders, or simulated ones of all scenes and seeds.

    Attributes:
        scenes: default scenes.
    """

    scenes: ClassVar[Sequence[str]] = tuple(BODY_SCENES)

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--capture",
            type=Path,
            metavar="DIR",
            action="append",
            default=[],
            dest="captures",
            help="capture folder with its truth, instead of simulated ones; repeatable",
        )
        parser.add_argument(
            "--scenes",
            type=words,
            default=list(cls.scenes),
            metavar="NAME,NAME",
            help=f"scenes of bodies; default {','.join(cls.scenes)}",
        )
        add_seeds(parser, "0")
        add_settings(parser, "one parameter of our kinematics", "NAME=VALUE")

    def cases(self) -> list[Case]:
        """See `Study`."""
        if self.options.captures:
            return [Case(str(folder), folder) for folder in self.options.captures]
        names = known_names(self.options.scenes, {**BODY_SCENES, **OTHER_BODY_SCENES}, "scene")
        return [Case(f"{name} {seed}", (name, seed)) for seed in self.options.seeds for name in names]

    def capture(self, case: Case) -> BodyCase:
        """Read or simulate the capture of a case."""
        return read_case(case.request) if isinstance(case.request, Path) else simulated_case(*case.request)

    @property
    def configs(self) -> dict[str, KinematicsConfig]:
        """Return our method with the user's parameters, and the paper's solver on the same 2D poses."""
        return {OURS: body_config(settings=self.options.settings), PAPER: body_config(PAPER, (SAME_PEOPLE,))}

    def head(self, result: Result) -> str:
        """Return a line that states whether the captures are simulated.

        Captures in folders may be simulated too.
        """
        simulated = "simulated captures: no reproduction of Total Capture"
        return "captures in folders" if self.options.captures else simulated


def simulated_case(name: str, seed: int) -> BodyCase:
    """Return the capture of `panoptic simulate NAME --seed N`, with a prior from all other motions."""
    model, clips, scene = read_body_model(), read_clips(), body_scene(name)
    capture = simulate_group(scene, seed, model, clips)
    used = [clip for person in (scene, *scene.others) for clip in person.clips]
    return case_of(capture, prior_without(used, clips, model), name, seed)


def case_of(
    capture: BodyCapture | BodyGroup, statistics: PoseStatistics, name: str = "", seed: int = 0
) -> BodyCase:
    """Return a simulated capture as a case."""
    group = capture if isinstance(capture, BodyGroup) else group_of(capture)
    truth, strangers = tuple(group.truth), tuple(group.strangers)
    return BodyCase(name, seed, recording_of(group), group.subjects, truth, statistics, strangers)


def read_case(folder: Path) -> BodyCase:
    """Read a capture from a folder.

    The folder has rig.json, imu.csv or imu.csv.gz, subject*.json and truth.json.gz, and strangers.json.gz if
    others are visible. It also has detections.json.gz, or images for the detector. The pose prior is the
    installed one.

    Raises:
        UserError: if a file is missing or cannot be used.
    """
    subjects = sorted(folder.glob("subject*.json"))
    if not subjects:
        raise DataError(f"{folder} has no subject*.json; a capture of bodies needs one for each subject")
    rig, detections = folder / "rig.json", folder / "detections.json.gz"
    imu = next((folder / n for n in ("imu.csv", "imu.csv.gz") if (folder / n).exists()), None)
    if rig.exists() and not detections.exists():
        recording, people, statistics = _from_images(folder, subjects, imu)
    else:
        seen = (rig, detections) if rig.exists() else (None, None)
        task = read_body_task(subjects, body_config(), seen[0], seen[1], imu)
        recording, people, statistics = task.recording, task.subjects, task.statistics
    names, truth = read_bodies(folder / "truth.json.gz")
    if names != people[0].body.model.names:
        raise DataError(f"{folder / 'truth.json.gz'} is of another skeleton: {', '.join(names[:4])}, ...")
    others = folder / "strangers.json.gz"
    strangers = read_bodies(others)[1] if others.exists() else []
    return BodyCase(folder.name, 0, recording, people, tuple(truth), statistics, tuple(strangers))


def _from_images(
    folder: Path, subjects: Sequence[Path], imu: Path | None
) -> tuple[BodyRecording, tuple[Subject, ...], PoseStatistics]:
    """Detect the 2D poses of a capture, and return the inputs of the solver."""
    found, extras = detected(folder, (), {}, None), body_extras(subjects)
    devices = {} if imu is None else read_imus(imu)
    names, rig = found.context.skeleton.joint_names, found.context.rig
    return (
        BodyRecording(rig, names, series_of(rig, found.sets), devices),
        found.subjects,
        extras["pose_prior"],
    )


def series_of(rig: Rig, sets: Sequence[DetectionSet]) -> dict[int, ViewSeries]:
    """Return the 2D poses of every camera by time, on the plane at distance 1, in the joints of the sets."""
    rows: dict[int, dict[int, ViewPeople]] = {}
    for view in (view for item in sets for view in item.views):
        people = _on_plane(rig.cameras[rig.names.index(view.camera)], view.points, view.scores)
        rows.setdefault(rig.names.index(view.camera), {})[view.stamp_ns] = people
    return {
        camera: ViewSeries(np.array(sorted(found)), tuple(found[stamp] for stamp in sorted(found)))
        for camera, found in rows.items()
    }


def _on_plane(camera: Camera, pixels: Array, scores: Array) -> ViewPeople:
    plane, there = np.full(pixels.shape, np.nan), np.isfinite(pixels).all(-1)
    if there.any():
        plane[there] = camera.intrinsics.undistort(pixels[there])
    return ViewPeople(plane, scores)


def recording_of(capture: BodyCapture | BodyGroup) -> BodyRecording:
    """Return the inputs of the solver from a simulated capture."""
    group = capture if isinstance(capture, BodyGroup) else group_of(capture)
    if not len(group.views):
        return BodyRecording(None, group.joint_names, {}, group.devices)
    views = {}
    for c, (camera, seen) in enumerate(zip(group.rig.cameras, group.views)):
        people = tuple(_on_plane(camera, pixels, scores) for pixels, scores in seen)
        views[c] = ViewSeries(group.stamps, people)
    return BodyRecording(group.rig, group.joint_names, views, group.devices)


def prior_without(left_out: Sequence[str], clips: Mapping[str, Clip], model: SegmentModel) -> PoseStatistics:
    """Train the pose prior on all clips except these."""
    poses = np.concatenate([clip.vectors for name, clip in clips.items() if name not in left_out])
    return train_prior(poses, other_sides(model.names))
