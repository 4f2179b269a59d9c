"""The study `captures`: captures with less prior knowledge.

Headings, clocks or mountings are unknown, bystanders are visible, or the subject leaves the view of the
cameras. With --drawn, the seed determines the setup: cameras and their rates, noise, bodies, T-poses and
clocks. Such captures are simulated at a common multiple of all rates; each camera and device keeps its own
share of the samples.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState, ImuSeries, Subject, ViewSeries
from panoptic_ros.evaluation.kinematic_scores import inside, score_bodies
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.running.kinematics import PAPER, body_config
from panoptic_ros.running.simulations.body_scenes import BODY_SCENES, OTHER_BODY_SCENES, body_scene
from panoptic_ros.simulation.bodies.cameras import JointNoise
from panoptic_ros.simulation.bodies.capture import SPARSE, BodyScene
from panoptic_ros.simulation.bodies.group import simulate_group
from panoptic_ros.simulation.bodies.imus import ImuNoise
from panoptic_ros.simulation.bodies.motion import Clip
from panoptic_ros.stage import Progress, each
from panoptic_ros.study.bodies.cases import (
    METHODS,
    OURS,
    SKIPPED_S,
    BodyCase,
    BodyStudy,
    case_of,
    prior_without,
)
from panoptic_ros.study.study import Case, Result, Row

SORTED = "malleson-2020, its sorting"
Array = np.ndarray
RATE, SOLVED = 300, 60  # Hz, of the simulation and of the bodies
SECONDS, LEAVES_SECONDS = 11.0, 19.0
SIZES = (0.9, 1.1)  # range of the body size relative to the recorded one
LIMBS = 0.05  # relative standard deviation of a segment's length
MOUNTING_DEG = {"stated": 2.5, "T 2.5": 2.5, "T 4": 4.0}  # standard deviation per axis


@dataclass(frozen=True)
class CaptureSetup:
    """Randomly drawn setup of a capture.

    Args:
        together: Cameras share a trigger.
        joint_noise, imu_noise: Noise relative to the default.
        mounting: Key of `MOUNTING_DEG`.
        lengths, joints: The subject file states the lengths of segments, and the joint positions of the
            detector.
        heading, clock: The heading, or the clock offset, of the IMUs is unknown.
    """

    scene: str
    cameras: int
    imus: int
    camera_hz: int
    imu_hz: int
    together: bool
    joint_noise: float
    imu_noise: float
    mounting: str
    lengths: bool
    joints: bool
    heading: bool
    clock: bool

    def __str__(self) -> str:
        """Return a short text for the table."""
        known = "".join(n for n, there in (("L", self.lengths), ("J", self.joints)) if there)
        unknown = "".join(n for n, there in (("h", self.heading), ("c", self.clock)) if there)
        rate = f"{self.camera_hz}{'' if self.together else '~'}Hz"
        text = f"{self.scene[5:]} {self.cameras}+{self.imus} {rate} x{self.joint_noise:g} {self.mounting}"
        return f"{text} {known}{unknown}"


def draw(rng: np.random.Generator) -> CaptureSetup:
    """Draw the setup of one capture."""

    def pick(*values: Any) -> Any:
        return values[int(rng.integers(len(values)))]

    drawn = CaptureSetup(
        pick(*BODY_SCENES, *OTHER_BODY_SCENES),
        pick(8, 8, 4, 4, 2),
        pick(13, 13, 13, 6, 0),
        pick(25, 30, 50, 60),
        pick(60, 100),
        pick(False, True),
        pick(0.5, 0.8, 1.0, 1.3, 1.6, 2.5),
        pick(0.5, 1.0, 1.5),
        pick("stated", *MOUNTING_DEG),
        pick(True, True, False),
        pick(True, True, False),
        pick(True, False, False),
        pick(True, False, False),
    )
    told = drawn.mounting == "stated" and not body_scene(drawn.scene).mounts
    return replace(drawn, mounting="T 2.5") if told else drawn


def drawn_case(seed: int) -> BodyCase:
    """Return the capture of this seed; its name states the setup."""
    rng = np.random.default_rng([seed, 41])
    drawn, model, clips = draw(rng), read_body_model(), read_clips()
    scene = _scene(drawn)
    take = simulate_group(scene, seed, model, _other_body(rng, model, clips))
    used = [clip for person in (scene, *scene.others) for clip in person.clips]
    case = case_of(take, prior_without(used, clips, model), str(drawn), seed)
    cameras = sorted(rng.choice(len(take.rig), drawn.cameras, replace=False).tolist())
    every = RATE // drawn.camera_hz
    phases = np.zeros(len(cameras), int) if drawn.together else rng.integers(every, size=len(cameras))
    views = {}
    for n, (camera, phase) in enumerate(zip(cameras, phases.tolist())):
        seen = case.recording.views[camera]
        views[n] = ViewSeries(seen.stamps[phase::every], seen.people[phase::every])
    subjects = tuple(_stated(subject, drawn, model) for subject in case.subjects)
    worn = {device.name for subject in subjects for device in subject.devices}
    devices = {
        name: ImuSeries(*(part[:: RATE // drawn.imu_hz] for part in vars(series).values()))
        for name, series in case.recording.devices.items()
        if name in worn
    }
    rig = Rig(tuple(take.rig.cameras[camera] for camera in cameras))
    recording = replace(case.recording, rig=rig, views=views, devices=devices)
    first = min(int(view.stamps[0]) for view in views.values())
    truth, strangers = (_at_instants(states, first) for states in (case.truth, case.strangers))
    return replace(case, recording=recording, subjects=subjects, truth=truth, strangers=strangers)


def _scene(drawn: CaptureSetup) -> BodyScene:
    scene = body_scene(drawn.scene)
    seconds = LEAVES_SECONDS if scene.path else SECONDS
    known = drawn.mounting == "stated"
    shared: dict[str, Any] = {
        "rate": float(RATE),
        "seconds": seconds,
        "mounts": known,
        "t_pose": MOUNTING_DEG[drawn.mounting],
        "joints": _louder(JointNoise(), drawn.joint_noise, ("white", "correlated", "bias")),
        "imus": _louder(ImuNoise(), drawn.imu_noise, tuple(f.name for f in fields(ImuNoise))),
    }
    unknown: dict[str, Any] = {
        "heading": 180.0 if drawn.heading else scene.heading,
        "clock": 0.06 if drawn.clock else scene.clock,
    }
    others = tuple(replace(other, **shared, **unknown) for other in scene.others)
    return replace(scene, **shared, **unknown, others=others)


def _louder(noise: Any, share: float, names: tuple[str, ...]) -> Any:
    return replace(noise, **{name: share * getattr(noise, name) for name in names})


def _other_body(rng: np.random.Generator, model: SegmentModel, clips: Mapping[str, Clip]) -> dict[str, Clip]:
    """Return the clips with another body size and other segment lengths, equal on both sides."""
    size, lengths = rng.uniform(*SIZES), dict[str, float]()
    for name in model.names:
        lengths.setdefault(_side(name), 1.0 + LIMBS * rng.normal())
    share = size * np.array([lengths[_side(name)] for name in model.names])
    legs = [model.index(name) for name in ("lShin", "lFoot")]
    found = {}
    for name, clip in clips.items():
        offsets = clip.offsets * share[:, None]
        rise = float(offsets[legs, 2].sum() / clip.offsets[legs, 2].sum())
        found[name] = replace(
            clip, offsets=offsets, roots=clip.roots * rise, stature=float(clip.stature * size)
        )
    return found


def _side(name: str) -> str:
    """Return a segment's name without its side."""
    return name[1:] if name[0] in "lr" and name[1].isupper() else name


def _stated(subject: Subject, drawn: CaptureSetup, model: SegmentModel) -> Subject:
    """Return the subject with only the data that its file states."""
    names, body = model.names, subject.body
    usual = model.body(subject.stature)
    if not drawn.lengths:
        body = replace(body, offsets=usual.offsets)
    if not drawn.joints:
        body = replace(body, keypoints=usual.keypoints, own=frozenset())
    devices = tuple(
        d for d in subject.devices if drawn.imus == 13 or (drawn.imus == 6 and names[d.segment] in SPARSE)
    )
    pose = None if drawn.mounting == "stated" else subject.t_pose
    return replace(subject, body=body, measured=drawn.lengths, devices=devices, t_pose=pose)


def _at_instants(states: tuple[BodyState, ...], first: int) -> tuple[BodyState, ...]:
    """Return the truth at the timestamps of the solved bodies."""
    found = []
    for state in states:
        place = (state.stamp_ns - first) * 1e-9 * RATE
        if round(place) >= 0 and round(place) % (RATE // SOLVED) == 0:
            stamp = first + round(round(place) * 1e9 / RATE)
            found.append(BodyState(stamp, state.id, state.places, state.frames))
    return tuple(found)


class Captures(BodyStudy):
    """A row for each capture, subject and solver."""

    scenes = tuple(OTHER_BODY_SCENES)

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        super().add_options(parser)
        parser.add_argument("--drawn", action="store_true", help="draw the setup of captures by the seed")

    def cases(self) -> list[Case]:
        """See `Study`."""
        return [Case(f"drawn {s}", s) for s in self.options.seeds] if self.options.drawn else super().cases()

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        capture = drawn_case(case.request) if self.options.drawn else self.capture(case)
        configs = self.configs | {SORTED: body_config(PAPER)}
        everybody: dict[int, list[BodyState]] = {}
        for state in (*capture.truth, *capture.strangers):
            everybody.setdefault(state.stamp_ns, []).append(state)
        for method, config in each(configs.items(), len(configs), progress, "solvers"):
            solved = capture.solve(config)
            for subject in capture.subjects:
                truth, mine = (
                    [s for s in both if s.id == subject.id] for both in (capture.truth, solved.states)
                )
                scores = score_bodies(truth, mine, capture.model.parents, SKIPPED_S)
                yield (
                    {"scene": capture.name, "seed": capture.seed, "subject": subject.id, "method": method}
                    | {key: scores.get(key, float("nan")) for key in ("coverage", "mm", "deg", "acc")}
                    | {"taken": taken(mine, everybody), "inside": inside(mine, truth)}
                )

    def lines(self, result: Result) -> Iterator[str]:
        """Yield the table with one line per subject: our errors, the paper's, and the ratio of both."""
        yield f"{self.head(result)}; after the first 3 s"
        wide = max([16, *(len(row["scene"]) + 2 for row in result["rows"])])
        yield (
            f"{'capture':<{wide}}{'seed':>6}{'subject':>9}{'there':>7}{'mm':>8}{'deg':>7}{'m/s^2':>7}{'taken':>7}"
            f"{'in 95 %':>9}   paper: mm, deg, taken (with its sorting)   ours / paper: mm, deg"
        )
        methods = (*METHODS, SORTED)
        rows = {method: [row for row in result["rows"] if row["method"] == method] for method in methods}
        for ours, paper, own in zip(rows[OURS], rows[PAPER], rows[SORTED]):
            shares = ", ".join(f"{ours[key] / paper[key]:.2f}" for key in ("mm", "deg"))
            yield (
                f"{ours['scene']:<{wide}}{ours['seed']:>6}{ours['subject']:>9}{ours['coverage']:>7.2f}"
                f"{ours['mm']:>8.1f}{ours['deg']:>7.1f}{ours['acc']:>7.1f}{ours['taken']:>7}"
                f"{ours['inside']:>9.3f}   {paper['mm']:.1f}, {paper['deg']:.1f}, {paper['taken']} "
                f"({own['mm']:.1f}, {own['deg']:.1f}, {own['taken']})   {shares}"
            )
        both = [
            [ours[key] / paper[key] for ours, paper in zip(rows[OURS], rows[PAPER])] for key in ("mm", "deg")
        ]
        parts = [f"{np.nanmedian(shares):.2f} ({np.nanmax(shares):.2f})" for shares in both]
        inside = [row["inside"] for row in rows[OURS]]
        yield (
            f"ours / paper, median (worst): mm {parts[0]}, deg {parts[1]}; "
            f"in 95 %: {np.nanmean(inside):.3f} in the mean"
        )


def taken(found: Sequence[BodyState], everybody: dict[int, list[BodyState]]) -> int:
    """Return the number of time steps at which a body is nearer to another person than to its subject."""
    count = 0
    for state in found:
        others = everybody.get(state.stamp_ns, ())
        far = {o.id: np.linalg.norm(np.nan_to_num(o.places - state.places)) for o in others}
        count += bool(far) and min(far, key=lambda number: far[number]) != state.id
    return count
